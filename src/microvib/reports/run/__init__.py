"""The report of a run, and the folder that a run leaves."""
