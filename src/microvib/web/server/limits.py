"""Limits of the server, so that it can be left running."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Limits:
    """Bounds of one server."""

    at_once: int = 2  # computations at a time; further ones wait
    waiting: int = 20
    wall_s: float = 1200.0  # time of one computation [s]
    quick_s: float = (
        120.0  # time of what a page waits for: reading a recording, writing a report [s]
    )
    check_s: float = 30.0  # time of reading a scenario [s]
    checks: int = 12  # scenarios that wait to be read
    memory: int = 2_500_000_000
    """Address space of one computation, beyond what is loaded [bytes]; bounded on Linux only."""
    record: int = 400_000_000  # samples of one run, all channels [bytes]
    cases: int = 4000  # rates times microstep counts of a plan
    campaign: int = 2000  # cases of a campaign
    kept: int = 100  # ended computations that are kept; the one not used for longest goes first
    stored: int = 2_000_000_000  # their files [bytes]
    body: int = 2_000_000  # a request [bytes], unless it is a recording
    structure: int = 20_000  # what of it may stand outside of strings [bytes]
    recording: int = 1_000_000_000
    """A recording [bytes]: ten million samples of six channels are 480 MB, of one as CSV 310 MB."""
    recordings: int = 30  # recordings that are kept
    recorded: int = 12_000_000_000  # their files and samples [bytes]
    receiving: int = 8  # recordings that are taken in at a time
    # how long what a client sends may pause, and how far it may fall behind ``slowest`` [s]
    pause_s: float = 10.0
    slowest: float = 50_000.0  # what a client sends at least, in the long run [bytes/s]
    connections: int = 384  # connections at a time
    strangers: int = (
        256  # connections that have shown no token; the oldest makes room for a further one
    )
    stranger_s: float = 10.0  # how long one lasts that shows no token [s]
    reading_s: float = 60.0  # how long an answer waits for its reader [s]
