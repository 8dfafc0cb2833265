"""How far a command is, on standard error: the one place that draws bars."""

from __future__ import annotations

import math
import sys
import time
from typing import Any

import click

_MIN_UPDATE_INTERVAL = 0.1  # seconds between two drawings of a bar
_LINE_INTERVAL = 60.0  # seconds between two lines where there is no bar
_MAX_BAR_WIDTH = 80  # columns of a terminal from which on there is room for the bar itself


class progress_bar:
    """A bar where a terminal can draw one, gone when the work is done; elsewhere a line every
    minute.

    ``lines_every`` are other seconds between lines, for what is counted in cases: then lines and
    bar say the rate, too. It begins with the first call, so that what is refused before the work
    begins is told without it. Called with what is done and the whole, in ``unit``; ``finishing``
    stands there when all is done.
    """

    def __init__(
        self,
        doing: str = "simulating",
        unit: str = "s",
        *,
        finishing: str = "finishing",
        lines_every: float | None = None,
    ) -> None:
        self._doing, self._unit, self._finishing = doing, unit, finishing
        self._every, self._rates = lines_every or _LINE_INTERVAL, lines_every is not None
        self._bar: Any = None
        self.begun = False
        self._told = -math.inf
        self._lines = 0
        self._first: tuple[float, float] | None = None

    def __enter__(self) -> progress_bar:
        return self

    def _begin(self) -> None:
        if not self.begun and sys.stderr.isatty():
            self._bar = _bar()
            if self._bar is not None:
                self._bar.start()
        self.begun = True

    def __exit__(self, *args: object) -> None:
        if self._bar is not None:
            self._bar.stop()

    def __call__(self, done: float, total: float) -> None:
        """Tell how far it is, unless it was told just now."""
        self._begin()
        now = time.monotonic()
        if self._first is None:  # what was there before counts for no rate
            self._first = now, done
            self._told = now if self._bar is None else -math.inf
            total = math.inf if self._bar is None else total
        if self._bar is None:
            pause = self._every
        else:
            pause = _MIN_UPDATE_INTERVAL
        if now - self._told < pause and (done < total or self._quiet()):
            return
        self._told = now
        amount, pace = f"{done:.0f} of {total:.0f} {self._unit}", self._pace(now, done, total)
        if self._bar is not None:
            if done > 0.0:
                doing = f"{self._doing}{pace}"
            else:
                doing = f"{self._doing} (compiles on first use)"
            if done >= total:
                text = self._finishing
            else:
                text = doing
            task, shown = self._bar.task_ids[0], {"description": text, "amount": amount}
            self._bar.update(
                task, completed=done, total=total, refresh=True, **shown
            )  # of short work, too
        else:
            self._lines += 1
            click.echo(f"{'' if self._rates else self._doing + ': '}{amount}{pace}", err=True)

    def _quiet(self) -> bool:
        """Whether short work ends without a line, as nothing is said of it before."""
        return self._bar is None and not self._rates and not self._lines

    def say(self, text: str) -> None:
        """Show a step of unknown length."""
        self._begin()
        if self._bar is not None:
            self._bar.update(self._bar.task_ids[0], description=text)
            return
        now = time.monotonic()
        self._first = self._first or (now, 0.0)
        if now - max(self._told, self._first[0]) >= self._every:
            self._told = now
            click.echo(text, err=True)

    def _pace(self, now: float, done: float, total: float) -> str:
        """Rate and time left of what is counted on lines, too."""
        begun, before = self._first or (now, done)
        if done <= before:
            return ""
        rate = (done - before) / max(now - begun, 1e-9)
        if done < total and self._bar is None:
            left = f", {_format_duration((total - done) / rate)} left"
        else:
            left = ""
        return (f", {rate:.3g} {self._unit}/s" if self._rates else "") + left


def _format_duration(seconds: float) -> str:
    if seconds < 120.0:
        return f"{seconds:.0f} s"
    return f"{seconds / 60.0:.0f} min"


def _bar() -> Any:
    """A bar that fits into the terminal; None where it can only print lines."""
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn
    from rich.table import Column

    console = Console(stderr=True)
    if console.is_dumb_terminal:
        return None
    console.width = max(
        console.width - len("^C "), 20
    )  # echoed behind the bar, it must not begin a line of its own
    one_line = Column(no_wrap=True, overflow="ellipsis", ratio=1)
    text = TextColumn("{task.description}", markup=False, table_column=one_line)
    amount = TextColumn("{task.fields[amount]}", markup=False, table_column=Column(no_wrap=True))
    columns = (
        (text, BarColumn(), amount, TimeRemainingColumn())
        if console.width >= _MAX_BAR_WIDTH
        else (text, amount)
    )
    bar = Progress(*columns, console=console, transient=True, expand=True)
    bar.add_task("", total=None, amount="")
    return bar
