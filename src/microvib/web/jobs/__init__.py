"""Computations of the page: their store, their processes, their tasks."""
