"""Pages of the documentation whose cells compute for ten seconds or more each."""

AT_A_RELEASE = (
    "howto/order-tracking",
    "howto/pointing",
    "howto/profile",
    "howto/rate",
    "howto/two-currents",
    "tutorial",
    "validation-common-sada",
    "validation-goniometer",
    "validation-sentinel-4",
    "validation-table",
)
"""Executed for a release (tests/test_docs.py); their command lines, on less work, by tests/test_command_lines.py."""
