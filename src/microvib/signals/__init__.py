"""What a sampled torque says: spectra and lines. Knows samples and expected lines, neither solver
nor files.
"""
