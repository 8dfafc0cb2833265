"""Evaluation of a sampled torque: spectra and lines. Knows samples and expected lines, neither solver
nor files.
"""
