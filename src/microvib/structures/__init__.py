"""Structures on the drive: descriptions of arrays and simulators, their modal models and checks."""
