"""Geometry to modes: meshes, elements, sparse eigen-solution, modal models."""
