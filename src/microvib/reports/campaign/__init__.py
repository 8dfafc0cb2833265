"""A campaign as text, tables, figures and report."""
