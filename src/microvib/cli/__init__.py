"""The command line: one file a subject. Commands import what they need when they run, so that help
is instant.
"""
