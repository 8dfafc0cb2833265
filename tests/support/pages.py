"""Pages of the documentation whose cells take a minute or more each."""

AT_A_RELEASE = ("howto/rate", "howto/two-currents")
"""Executed for a release (tests/test_docs.py); their command lines, on less work, by tests/test_command_lines.py."""
