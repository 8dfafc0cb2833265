"""Evaluation of a run: its lines, from a motion, a steady state or a stream; limits and how far they
can be trusted.
"""
