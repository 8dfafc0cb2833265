"""A campaign as text, tables, pictures and report."""
