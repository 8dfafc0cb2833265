"""Parameters of a simulation: frozen, validated parameters and the formulas that belong to each. No files,
no time stepping.
"""
