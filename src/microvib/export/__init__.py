"""Handing on: the model and its results in the formats of other tools."""
