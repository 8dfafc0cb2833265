"""Search for a quieter drive: levers, what they are judged by, drawn cases, several starts."""
