"""What a run on a craft says of the hub: lines of its six loads and of its line of sight, and what they cost in each window."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from microvib.analysis.limits import may_ring
from microvib.analysis.lines import expected_in, lines
from microvib.errors import MicrovibError
from microvib.model.coupling import MEANINGLESS, density_of_noise
from microvib.model.expected import ExpectedLine
from microvib.model.linear import coupled_modes
from microvib.model.record import PASSBAND
from microvib.model.scenario import Scenario
from microvib.signals.fourier_lines import lines_of_series
from microvib.signals.line_fit import crowded, lines_at_known_clock, tones_beside
from microvib.signals.line_table import DRIVEN, Line, LineTable
from microvib.signals.pointing import (
    METRICS,
    Metric,
    level,
    mean_square_of_density,
    mean_square_of_lines,
    radial,
    transfer_in_window,
)
from microvib.solve.channels import INTERFACE, LOAD_COLUMNS, LOS_COLUMNS, SECOND_LOADS
from microvib.solve.motion import Motion
from microvib.solve.on_craft import OF_STATES
from microvib.solve.steady.state import SteadyState

CONFIDENCE = 0.997
NOISE = "torque noise"
"""What a ranking calls the noise of the output's friction."""
SAME = 1e-6
"""Relative distance of frequencies up to which lines are of one frequency."""
SECOND = "wing_2"
"""How names of lines begin that only a second wing's drive makes."""


@dataclass(frozen=True)
class HubLines:
    """Lines of what the hub feels and does, each with its frequency; complex amplitudes, 0-to-peak, A exp(j phase)."""

    scenario: Scenario
    names: tuple[str, ...]
    frequency: np.ndarray
    """[Hz], (k,)."""
    loads: np.ndarray
    """Fx Fy Fz [N], Mx My Mz [N m] on the hub at the interface point, hub axes, (k, 6); nan where a line is not estimated."""
    los: np.ndarray | None
    """Both angles of the line of sight [rad], (k, 2); None without ``line_of_sight``."""
    shafts: np.ndarray
    """Accelerations of output and rotor [rad/s^2], of the first drive, (k, 2)."""
    unknown: tuple[str, ...] = ()
    """Expected lines that could not be estimated in any channel."""
    second: np.ndarray | None = None
    """Loads on the hub at the second wing's interface, (k, 6); None without a second wing."""
    driven: tuple[str, ...] = ()
    """Lines that noise drives: one draw of what ``density`` has of all, so that sums leave them out."""
    rings: tuple[str, ...] = ()
    """Lines that ring after the start and die away, or may do so; sums count them with their mean."""
    drives: tuple[HubLines, ...] = ()
    """What each of two drives makes by itself, where two are added here; empty of one."""

    @property
    def windows(self) -> tuple[float, ...]:
        """Windows in which the line of sight is judged [s]."""
        los = None if self.scenario.spacecraft is None else self.scenario.spacecraft.line_of_sight
        return () if los is None else los.windows

    @cached_property
    def amplitude(self) -> np.ndarray:
        """Amplitudes of the line of sight [rad], (k, 2); 0 where a line is not estimated."""
        return np.nan_to_num(np.abs(self.los)) if self.los is not None else np.zeros((len(self.names), 2))

    @cached_property
    def lasting(self) -> np.ndarray:
        """The same without the lines that noise drives."""
        return self.amplitude * np.array([name not in self.driven for name in self.names], dtype=bool)[:, None]

    @cached_property
    def density(self) -> tuple[np.ndarray, np.ndarray] | None:
        """One-sided density (n, 2) [rad^2/Hz] of the line of sight by noise, over the frequency (n,) [Hz]; None without."""
        drives = () if self.los is None else (self.scenario, self.scenario.driven_wing)
        found = [one for one in (density_of_noise(drive) for drive in drives if drive is not None) if one is not None]
        if len(found) < 2:
            return found[0] if found else None
        grid = np.union1d(found[0][0], found[1][0])
        both = [[np.interp(grid, f, column, left=0.0, right=0.0) for column in S.T] for f, S in found]
        return grid, np.sum(both, axis=0).T

    def noise(self, metric: Metric, window: float) -> np.ndarray:
        """Mean square [rad^2] about both axes of torque noise in a ``window`` [s], (2,)."""
        if self.density is None:
            return np.zeros(2)
        f, S = self.density
        return np.array([mean_square_of_density(metric, f, column, window) for column in S.T])

    def sums(self, metric: Metric, window: float) -> np.ndarray:
        """Mean square [rad^2] of all lines and of torque noise about both axes in a ``window`` [s], (2, 2)."""
        lines = mean_square_of_lines(metric, self.frequency, self.lasting, window).sum(axis=0)
        return np.array([lines, self.noise(metric, window)])

    def mean_squares(self, metric: Metric, window: float) -> np.ndarray:
        """Mean square [rad^2] of each line about both axes in a ``window`` [s], (k, 2)."""
        return mean_square_of_lines(metric, self.frequency, self.amplitude, window)

    def ranking(self, metric: Metric, window: float) -> list[tuple[str, float]]:
        """Lines by what they cost in a window, and torque noise: name and radial rms [rad], the largest first."""
        cost = [*radial(mean_square_of_lines(metric, self.frequency, self.lasting, window)).tolist()]
        names = [*self.names]
        if self.density is not None:
            cost, names = [*cost, float(radial(self.noise(metric, window)))], [*names, NOISE]
        return [(names[k], cost[k]) for k in np.argsort(-np.array(cost), kind="stable")]

    def totals(self) -> Iterator[dict[str, Any]]:
        """For each window and metric the rms of all [rad]: about both axes and radial, phases unrelated.

        Where there is torque noise, lines and noise are also told apart.
        """
        for window in self.windows:
            for metric in METRICS:
                parts = self.sums(metric, window)
                row: dict[str, Any] = {"window_s": window, "metric": metric, **_rms(parts.sum(axis=0))}
                if self.density is not None:
                    row |= {"lines": _rms(parts[0]), "noise": _rms(parts[1])}
                yield row

    def image(self) -> Iterator[dict[str, Any]]:
        """For each window what lines and torque noise do to an image, in pixels and at half a cycle per pixel; needs ``pixel``.

        Smear is the length of the steady motion with the same mean square, jitter the rms about it, MTF about both axes.
        """
        los = None if self.scenario.spacecraft is None else self.scenario.spacecraft.line_of_sight
        if los is None or los.pixel is None:
            return
        for window in self.windows:
            smears, jitters = self.sums("smear", window), self.sums("jitter", window)
            smear = np.sqrt(12.0 * smears.sum(axis=0)) / los.pixel
            jitter = np.sqrt(jitters.sum(axis=0)) / los.pixel
            sigma, straight = np.sqrt(jitters[1]).tolist(), np.sqrt(smears[1]).tolist()
            for k, axis in enumerate("xy"):
                mtf = transfer_in_window(
                    self.frequency, self.lasting[:, k], sigma[k], window, 0.5 / los.pixel, straight[k]
                )
                yield {
                    "window_s": window, "axis": axis, "smear_px": float(smear[k]), "jitter_rms_px": float(jitter[k]),
                    "mtf_at_nyquist": float(mtf),
                }  # fmt: skip

    def costs(self) -> Iterator[dict[str, Any]]:
        """For each window and metric the five lines that cost most: radial rms and part of the mean square."""
        for window in self.windows:
            for metric in METRICS:
                whole = float(self.sums(metric, window).sum())
                ranked = self.ranking(metric, window)[:5]
                yield {
                    "window_s": window, "metric": metric,
                    "lines": [{"line": n, "radial_rad": x, "share": x**2 / whole if whole else 0.0} for n, x in ranked],
                }  # fmt: skip

    def summary(self) -> dict[str, Any]:
        """What ``summary.json`` says of the line of sight."""
        f, squares = self.frequency, 0.5 * self.lasting**2
        if self.density is not None:
            grid, S = self.density
            f = np.r_[f, 0.5 * (grid[1:] + grid[:-1])]
            squares = np.vstack([squares, 0.5 * (S[1:] + S[:-1]) * np.diff(grid)[:, None]])
        order = np.argsort(f, kind="stable")
        squares = squares[order]
        rising = np.sqrt(np.cumsum(squares, axis=0))
        falling = np.sqrt(np.cumsum(squares[::-1], axis=0)[::-1])
        sigma = np.sqrt(self.noise("ape", 1.0)).tolist()
        second = None if self.scenario.spacecraft is None else self.scenario.spacecraft.second_wing
        own = second is not None and second.clock_ratio != 1.0
        clock = np.array([int(own and name.startswith(SECOND)) for name in self.names], dtype=int)
        tones = np.zeros(self.lasting.shape) if self.los is None else np.where(self.lasting > 0.0, self.los, 0.0)
        levels = [
            level(tones[:, k], sigma[k], CONFIDENCE, frequency=self.frequency, clock=clock) for k in range(2)
        ]  # fmt: skip
        return {
            "windows": list(self.totals()),
            "image": list(self.image()),
            "ranking": list(self.costs()),
            "within": {"confidence": CONFIDENCE, "los_x_rad": levels[0], "los_y_rad": levels[1]},
            "cumulative": {
                "frequency_hz": f[order].tolist(),
                **{f"rms_{name}_los_{axis}_rad": values[:, k].tolist() for name, values in (("up", rising), ("down", falling))
                   for k, axis in enumerate("xy")},
            },
        }  # fmt: skip

    def loads_table(self, *, second: bool = False) -> tuple[list[str], list[list[Any]]]:
        """Header and rows of ``loads.csv``; ``second`` those of the second wing's interface."""
        found = self.second if second else self.loads
        assert found is not None
        header = ["line", "frequency_hz", *LOAD_COLUMNS, *(f"{name.lower()}_phase_rad" for name in INTERFACE)]
        return header, [
            [name, float(f), *np.abs(values).tolist(), *np.angle(values).tolist()]
            for name, f, values in zip(self.names, self.frequency, found, strict=True)
        ]

    def pointing_table(self) -> tuple[list[str], list[list[Any]]]:
        """Header and rows of ``pointing.csv``: amplitudes and phases, then the rms of each line in each metric and window."""
        assert self.los is not None
        header = ["line", "frequency_hz", *LOS_COLUMNS, "los_x_phase_rad", "los_y_phase_rad"]
        columns = [np.abs(self.los), np.angle(self.los)]
        for window in self.windows:
            for metric in METRICS:
                header += [f"{metric}_{_words(window)}_{axis}_rad" for axis in "xy"]
                columns.append(np.sqrt(self.mean_squares(metric, window)))
        rows = zip(self.names, self.frequency, np.hstack(columns), strict=True)
        return header, [[name, float(f), *row.tolist()] for name, f, row in rows]


def _rms(squares: np.ndarray) -> dict[str, float]:
    """Root of mean squares (2,) about both axes, and radial."""
    x, y = np.sqrt(squares).tolist()
    return {"los_x_rad": x, "los_y_rad": y, "radial_rad": float(radial(squares))}


def hub_lines(source: Motion | SteadyState, table: LineTable, *, los_only: bool = False) -> HubLines:
    """Lines of loads and line of sight of a run on a craft: those that are expected, and those found in T_d (its ``table``).

    Lines of the clock follow from those of the two shafts' accelerations, through the craft's linear response, which no drift leaks
    into. What rings by itself, and what is not expected, is found in each channel; of the angles in their second derivatives. With
    ``los_only`` loads are not estimated, and nan, and what rings has the frequency and decay that it has in T_d where that shows
    it, which takes a tenth of the time. Where a second wing is driven, too, lines of both drives are added (``together``).
    MicrovibError where the scenario has no spacecraft.
    """
    beside = source.beside
    own = _lines_of_one(source.alone if isinstance(source, Motion) else source, table, los_only)
    if beside is None:
        return own
    return together(own, _lines_of_one(beside, lines(beside, harmonics=table.harmonics), los_only))


def _lines_of_one(source: Motion | SteadyState, table: LineTable, los_only: bool) -> HubLines:
    """``hub_lines`` of one drive's run."""
    scenario, craft = source.scenario, source.scenario.craft
    if craft is None:
        raise MicrovibError("this run is one on firm ground; a scenario with a spacecraft is expected")
    others = [line for line in table if line.kind == "other" and np.isfinite(line.frequency_hz)]
    expected = (
        *expected_in(scenario, scenario.record.sample_rate, table.harmonics),
        *(ExpectedLine(x.line, "other", x.frequency_hz, x.frequency_hz, x.frequency_hz, x.origin) for x in others),
    )
    looks, two = craft.spacecraft.line_of_sight is not None, craft.second is not None and not los_only
    channels = (
        *(() if los_only else INTERFACE),
        *(SECOND_LOADS if two else ()),
        *(OF_STATES if looks else ()),
    )
    shafts, found = _found(source, expected, channels, table, los_only)
    frequency, ringing = _ringing(*found, expected, channels)
    own = np.array([not line.of_clock for line in expected])
    rows = [*([] if los_only else [craft.loads()]), *([craft.second_loads()] if two else [])]
    rows += [craft.line_of_sight()] if looks else []
    forced = np.hstack([np.einsum("fkj,fj->fk", craft.transfer(one, frequency), shafts) for one in rows])
    tones = np.where(own[:, None], ringing, forced)
    if los_only:
        tones = np.hstack([np.full((len(expected), 6), np.nan), tones])
    free = craft.spacecraft.attitude_control is None
    keep = np.any(np.isfinite(tones) & (tones != 0.0), axis=1) & ~(free & (frequency < MEANINGLESS))
    names = tuple(line.name for line, kept in zip(expected, keep, strict=True) if kept)
    unknown = tuple(x.name for x, lost in zip(expected, ~np.any(np.isfinite(tones), axis=1), strict=True) if lost)
    tones = tones[keep]
    los, second = tones[:, -2:] if looks else None, tones[:, 6:12] if two else None
    driven = tuple(line.line for line in table if line.status == DRIVEN)
    rings = tuple(line.line for line in table if line.line in names and may_ring(line, table, scenario))
    return HubLines(scenario, names, frequency[keep], tones[:, :6], los, shafts[keep], unknown, second, driven, rings)


def together(first: HubLines, second: HubLines) -> HubLines:
    """Lines of two drives on one craft: those of one frequency, and natural modes, with their phases; of others both.

    Each drive's run knows the same natural modes, by names that may differ where one of them is the other drive's.
    """
    ours, theirs = (sorted(coupled_modes(one.scenario), key=lambda m: m.frequency) for one in (first, second))
    partner = {b.name: a.name for a, b in zip(ours, theirs, strict=False)} if len(ours) == len(theirs) else {}
    modes = {m.name for m in theirs}
    place: dict[str, int] = {}
    for name, f in zip(second.names, second.frequency, strict=True):
        near = np.flatnonzero(np.abs(first.frequency - f) <= SAME * f)
        if name in modes:
            near = np.array([k for k, own in enumerate(first.names) if own == partner.get(name)], dtype=int)
        place[name] = (
            int(near[0]) if near.size else len(first.names) + sum(k >= len(first.names) for k in place.values())
        )
    new = [k for k, name in enumerate(second.names) if place[name] >= len(first.names)]
    to = [place[name] for name in second.names]

    def added(a: np.ndarray | None, b: np.ndarray | None) -> np.ndarray | None:
        if a is None or b is None:
            return None
        both = np.full((2, len(first.names) + len(new), a.shape[1]), np.nan, dtype=complex)
        both[0, : len(first.names)], both[1, to] = a, b
        total: np.ndarray = np.where(np.isnan(both).all(axis=0), np.nan, np.nansum(both, axis=0))
        return total

    def of_both(ours: tuple[str, ...], theirs: tuple[str, ...]) -> tuple[str, ...]:
        return tuple(dict.fromkeys([*ours, *(names[place[name]] for name in theirs if name in place)]))

    # a natural mode has the name that it has in the first's run, even if that one does not look for it
    names = (*first.names, *(partner.get(second.names[k], f"{SECOND} {second.names[k]}") for k in new))
    loads = added(first.loads, second.loads if second.second is None else second.second)
    assert loads is not None
    return replace(
        first,
        names=names,
        frequency=np.concatenate([first.frequency, second.frequency[new]]),
        loads=loads,
        los=added(first.los, second.los),
        shafts=np.vstack([first.shafts, np.zeros((len(new), 2))]),
        second=added(first.second, second.loads),
        unknown=(*first.unknown, *(f"{SECOND} {name}" for name in second.unknown)),
        driven=of_both(first.driven, second.driven),
        rings=of_both(first.rings, second.rings),
        drives=(first, second),
    )


Found = tuple[np.ndarray, np.ndarray, np.ndarray]
"""Tones, frequencies [Hz] and decays [1/s] of lines in channels, (k, channels) each."""


def _found(
    source: Motion | SteadyState,
    expected: tuple[ExpectedLine, ...],
    channels: tuple[str, ...],
    table: LineTable,
    fast: bool,
) -> tuple[np.ndarray, Found]:
    """Tones of the expected lines in the accelerations of both shafts, (k, 2), and what is found in the ``channels``.

    Where it has to be ``fast``, what rings does so as in T_d, and only what T_d does not show is sought.
    """
    shafts, rows = ("alpha_l", "alpha_m"), table if fast else crowded(table)
    if not fast or isinstance(source, SteadyState):
        return _each(source, expected, shafts, rows)[0], _each(source, expected, channels, rows)
    tones, frequency, decay = tones_beside(
        [source[name] for name in (*shafts, *channels)], source.sample_rate, expected, table
    )
    if any(x.is_mode and not x.seen and np.isfinite(x.amplitude_n_m) for x in table):
        return tones[:, :2], _each(source, expected, channels, rows)
    each = np.ones((1, len(channels)))
    return tones[:, :2], (tones[:, 2:], frequency[:, None] * each, decay[:, None] * each)


def _each(
    source: Motion | SteadyState, expected: tuple[ExpectedLine, ...], channels: tuple[str, ...], table: LineTable | None
) -> Found:
    """Channel by channel."""
    columns = [lines_in(source, name, expected, table) for name in channels]
    frequency = np.array([[line.frequency_hz for line in column] for column in columns]).T
    decay = np.array([[line.decay_per_s for line in column] for column in columns]).T
    return np.array([tones_of(column) for column in columns]).T, frequency, decay


def _ringing(
    tones: np.ndarray,
    found: np.ndarray,
    decay: np.ndarray,
    expected: tuple[ExpectedLine, ...],
    channels: tuple[str, ...],
) -> tuple[np.ndarray, np.ndarray]:
    """Frequencies (k,) [Hz] of the expected lines, and their tones in each channel, (k, channels), of accelerations the angles."""
    given = np.array([line.frequency for line in expected])
    # One frequency a line: that of the channel in which it stands out most, over what stands in the channel.
    size = np.nan_to_num(np.abs(tones))
    best = np.argmax(size / np.maximum(size.max(axis=0), 1e-300), axis=1)
    shared = found[np.arange(given.size), best]
    root = -np.nan_to_num(decay) + 2j * np.pi * np.where(np.isfinite(found), found, given[:, None])
    angles = [name in OF_STATES for name in channels]
    tones[:, angles] /= root[:, angles] ** 2
    return np.where(np.isfinite(shared), shared, given), tones


def tones_of(lines: list[Line]) -> np.ndarray:
    """Complex amplitudes."""
    return np.array([line.amplitude_n_m * np.exp(1j * line.phase_rad) for line in lines])


def lines_in(
    source: Motion | SteadyState, channel: str, expected: tuple[ExpectedLine, ...], table: LineTable | None = None
) -> list[Line]:
    """The expected lines in one channel, in their order; with the ``table`` of T_d, modes ring as there."""
    rate, samples = source.scenario.record.sample_rate, source.scenario.record.samples
    if isinstance(source, SteadyState):
        series = source.harmonics(channel)[: int(PASSBAND * rate / source.frequency) + 1]
        found = lines_of_series(series, source.frequency, source.microsteps, expected, samples, rate)
    else:
        found = lines_at_known_clock(source[channel], rate, expected, table)
    return [found[line.name] for line in expected]


def _words(window: float) -> str:
    return f"{window:g}s" if window >= 1.0 else f"{1e3 * window:g}ms" if window >= 1e-3 else f"{1e6 * window:g}us"
