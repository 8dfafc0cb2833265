"""Pages of the documentation whose cells are executed at a release, and pages whose command lines run then."""

AT_A_RELEASE = (
    "howto/notebook",
    "howto/order-tracking",
    "howto/pointing",
    "howto/profile",
    "howto/pulses",
    "howto/rate",
    "howto/two-currents",
    "theory/lines",
    "tutorial",
    "validation-common-sada",
    "validation-goniometer",
    "validation-sentinel-4",
    "validation-table",
)
"""Executed for a release (tests/test_docs.py); their command lines, on less work, by tests/test_command_lines.py."""
LINES_AT_A_RELEASE = (
    "docs/campaigns.md",
    "docs/howto/pointing.md",
    "docs/howto/quiet.md",
    "docs/howto/two-currents.md",
)
"""Lines that take a quarter of a minute or more even so; their commands are in the tables of tests/test_commands.py."""
