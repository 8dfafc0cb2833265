"""Doors to files: scenario files, the catalog, results."""
