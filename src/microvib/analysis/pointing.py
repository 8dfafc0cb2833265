"""Hub of a run on a spacecraft: lines of its six loads and of its line of sight, and their contributions to each window."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from microvib.model.coupling import line_of_sight_noise_spectrum
from microvib.model.driven import noise_bands
from microvib.model.line_names import LineName
from microvib.model.rigid import COMPONENTS
from microvib.model.scenario import Scenario
from microvib.signals.pointing import (
    METRICS,
    Metric,
    confidence_level_angle,
    mean_square_of_density,
    mean_square_of_lines,
    radial_rms,
    transfer_in_window,
)
from microvib.solve.channels import LOAD_COLUMNS, LOS_COLUMNS

CONFIDENCE = 0.997
NOISE_LABEL = "torque noise"
"""Name of the output friction's noise in a ranking."""
FREQUENCY_TOLERANCE = 1e-6
"""Relative distance of frequencies up to which lines are of one frequency."""
LEFT_OUT = "left_out"
"""Column of a table of lines that says what is not in it, so that whoever reads the table alone
passes no requirement by lines that were not looked at.
"""
TORQUE_SPREAD = "torque_spread"
"""Column of a budget's lines: how far the drive's torque moves in a line within the ranges that its
sources note, over it."""
_NOT_SOUGHT = (
    "lines that the run did not look for, which a budget of its scenario bounds (microvib budget)"
)


@dataclass(frozen=True)
class HubLines:
    """Lines of what the hub feels and does, each with its frequency; complex amplitudes, 0-to-peak,
    A exp(j phase).
    """

    scenario: Scenario
    names: tuple[str, ...]
    frequency: np.ndarray
    """[Hz], (k,)."""
    loads: np.ndarray
    """Fx Fy Fz [N], Mx My Mz [N m] on the hub at the interface point, hub axes, (k, 6); nan where a
    line is not estimated.
    """
    los: np.ndarray | None
    """Both angles of the line of sight [rad], (k, 2); None without ``line_of_sight``."""
    shafts: np.ndarray
    """Accelerations of output and rotor [rad/s^2], of the first drive, (k, 2)."""
    unknown: tuple[str, ...] = ()
    """Expected lines that could not be estimated in any channel."""
    second: np.ndarray | None = None
    """Loads on the hub at the second wing's interface, (k, 6); None without a second wing."""
    driven: tuple[str, ...] = ()
    """Lines that noise drives: one draw of what ``density`` has of all, so that sums leave them
    out.
    """
    rings: tuple[str, ...] = ()
    """Lines that ring after the start and die away, or may do so; sums count them with their mean."""
    drives: tuple[HubLines, ...] = ()
    """Lines of each of two drives alone, if two are added here; empty for one."""

    @property
    def windows(self) -> tuple[float, ...]:
        """Windows in which the line of sight is judged [s]."""
        if self.scenario.spacecraft is None:
            los = None
        else:
            los = self.scenario.spacecraft.line_of_sight
        if los is None:
            return ()
        return los.windows

    @property
    def left_out(self) -> tuple[str, ...]:
        """Parts that are not among these lines, in words: in ``left_out`` of their tables."""
        drives = (self.scenario, self.scenario.driven_wing)
        keys = dict.fromkeys(
            key for drive in drives if drive is not None for key in noise_bands(drive)
        )
        return (*(f"{key}, which makes a density" for key in keys), _NOT_SOUGHT)

    @property
    def settled(self) -> list[bool]:
        """Which lines belong to the settled motion: they neither ring nor are driven by noise."""
        return [name not in (*self.rings, *self.driven) for name in self.names]

    @cached_property
    def amplitude(self) -> np.ndarray:
        """Amplitudes of the line of sight [rad], (k, 2); 0 where a line is not estimated."""
        if self.los is not None:
            return np.nan_to_num(np.abs(self.los))
        return np.zeros((len(self.names), 2))

    @cached_property
    def lasting(self) -> np.ndarray:
        """Lines without those that noise drives."""
        return (
            self.amplitude
            * np.array([name not in self.driven for name in self.names], dtype=bool)[:, None]
        )

    @cached_property
    def density(self) -> tuple[np.ndarray, np.ndarray] | None:
        """One-sided density (n, 2) [rad^2/Hz] of the line of sight by noise, over the frequency
        (n,) [Hz]; None without.
        """
        if self.los is None:
            return None
        return noise_spectrum_of_wings(self.scenario)

    def noise(self, metric: Metric, window: float) -> np.ndarray:
        """Mean square [rad^2] about both axes of torque noise in a ``window`` [s], (2,)."""
        if self.density is None:
            return np.zeros(2)
        f, S = self.density
        return np.array([mean_square_of_density(metric, f, column, window) for column in S.T])

    def sums(self, metric: Metric, window: float) -> np.ndarray:
        """Mean square [rad^2] of all lines and of torque noise about both axes in a ``window`` [s],
        (2, 2).
        """
        lines = mean_square_of_lines(metric, self.frequency, self.lasting, window).sum(axis=0)
        return np.array([lines, self.noise(metric, window)])

    def mean_squares(self, metric: Metric, window: float) -> np.ndarray:
        """Mean square [rad^2] of each line about both axes in a ``window`` [s], (k, 2)."""
        return mean_square_of_lines(metric, self.frequency, self.amplitude, window)

    def ranking(self, metric: Metric, window: float) -> list[tuple[str, float]]:
        """Lines by what they cost in a window, and torque noise: name and radial rms [rad], the
        largest first.
        """
        cost = [
            *radial_rms(mean_square_of_lines(metric, self.frequency, self.lasting, window)).tolist()
        ]
        names = [*self.names]
        if self.density is not None:
            cost, names = (
                [*cost, float(radial_rms(self.noise(metric, window)))],
                [*names, NOISE_LABEL],
            )
        return [(names[k], cost[k]) for k in np.argsort(-np.array(cost), kind="stable")]

    def totals(self) -> Iterator[dict[str, Any]]:
        """For each window and metric the rms of all [rad]: about both axes and radial, phases
        unrelated.

        Where there is torque noise, lines and noise are also told apart.
        """
        for window in self.windows:
            for metric in METRICS:
                parts = self.sums(metric, window)
                row: dict[str, Any] = {
                    "window_s": window,
                    "metric": metric,
                    **_rms(parts.sum(axis=0)),
                }
                if self.density is not None:
                    row |= {"lines": _rms(parts[0]), "noise": _rms(parts[1])}
                yield row

    def image(self) -> Iterator[dict[str, Any]]:
        """For each window what lines and torque noise do to an image, in pixels and at half a cycle
        per pixel; needs ``pixel``.

        Smear is the length of the steady motion with the same mean square, jitter the rms about it,
        MTF about both axes.
        """
        if self.scenario.spacecraft is None:
            los = None
        else:
            los = self.scenario.spacecraft.line_of_sight
        if los is None or los.pixel is None:
            return
        for window in self.windows:
            smears, jitters = self.sums("smear", window), self.sums("jitter", window)
            smear = np.sqrt(12.0 * smears.sum(axis=0)) / los.pixel
            jitter = np.sqrt(jitters.sum(axis=0)) / los.pixel
            sigma, straight = np.sqrt(jitters[1]).tolist(), np.sqrt(smears[1]).tolist()
            for k, axis in enumerate("xy"):
                mtf = transfer_in_window(
                    self.frequency,
                    self.lasting[:, k],
                    sigma[k],
                    window,
                    0.5 / los.pixel,
                    straight[k],
                )
                yield {
                    "window_s": window, "axis": axis, "smear_px": float(smear[k]), "jitter_rms_px": float(jitter[k]),
                    "mtf_at_nyquist": float(mtf),
                }  # fmt: skip

    def costs(self) -> Iterator[dict[str, Any]]:
        """For each window and metric the five lines that cost most: radial rms and part of the mean
        square.
        """
        for window in self.windows:
            for metric in METRICS:
                whole = float(self.sums(metric, window).sum())
                ranked = self.ranking(metric, window)[:5]
                yield {
                    "window_s": window, "metric": metric,
                    "lines": [{"line": n, "radial_rad": x, "share": x**2 / whole if whole else 0.0} for n, x in ranked],
                }  # fmt: skip

    def summary(self) -> dict[str, Any]:
        """Line of sight in ``summary.json``."""
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
        if self.scenario.spacecraft is None:
            second = None
        else:
            second = self.scenario.spacecraft.second_wing
        own = second is not None and second.clock_ratio != 1.0
        clock = np.array(
            [int(own and LineName.parse(name).second_wing) for name in self.names], dtype=int
        )
        if self.los is None:
            tones = np.zeros(self.lasting.shape)
        else:
            tones = np.where(self.lasting > 0.0, self.los, 0.0)
        levels = [
            confidence_level_angle(tones[:, k], sigma[k], CONFIDENCE, frequency=self.frequency, clock=clock) for k in range(2)
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

    def loads_table(
        self, left_out: Sequence[str] = (), *, second: bool = False
    ) -> tuple[list[str], list[list[Any]]]:
        """Header and rows of ``loads.csv``; ``second`` those of the second wing's interface.

        What is ``left_out`` besides what these lines know of is said in each row.
        """
        found = self.second if second else self.loads
        assert found is not None
        header = [
            "line",
            "frequency_hz",
            *LOAD_COLUMNS,
            *(f"{name.lower()}_phase_rad" for name in COMPONENTS),
        ]
        if self.second is not None:
            left_out = ("loads at the interface of the other wing", *left_out)
        columns = np.hstack([np.abs(found), np.angle(found)])
        return self._with_what_is_left_out(header, columns, left_out)

    def pointing_table(self, left_out: Sequence[str] = ()) -> tuple[list[str], list[list[Any]]]:
        """Header and rows of ``pointing.csv``: amplitudes and phases, then the rms of each line in
        each metric and window, whether it is settled, and what is left out.

        What is ``left_out`` besides what these lines know of is said in each row.
        """
        assert self.los is not None
        header = ["line", "frequency_hz", *LOS_COLUMNS, "los_x_phase_rad", "los_y_phase_rad"]
        columns = [np.abs(self.los), np.angle(self.los)]
        for window in self.windows:
            for metric in METRICS:
                header += [f"{metric}_{_window_label(window)}_{axis}_rad" for axis in "xy"]
                columns.append(np.sqrt(self.mean_squares(metric, window)))
        return self._with_what_is_left_out(header, np.hstack(columns), left_out)

    def _with_what_is_left_out(
        self, header: list[str], columns: np.ndarray, left_out: Sequence[str]
    ) -> tuple[list[str], list[list[Any]]]:
        """Header and rows of a table of these lines, whose last columns say which are settled and
        what is left out; in each row, since rows are sorted and taken out.
        """
        said = "; ".join(dict.fromkeys((*left_out, *self.left_out)))
        rows = zip(self.names, self.frequency, columns, self.settled, strict=True)
        return [*header, "settled", LEFT_OUT], [
            [name, float(f), *row.tolist(), settled, said] for name, f, row, settled in rows
        ]


def noise_spectrum_of_wings(scenario: Scenario) -> tuple[np.ndarray, np.ndarray] | None:
    """One-sided density (n, 2) [rad^2/Hz] of the line of sight by the noise of both wings' drives
    that step, over the frequency (n,) [Hz]; None without.
    """
    drives = (scenario, scenario.driven_wing)
    spectra = [line_of_sight_noise_spectrum(drive) for drive in drives if drive is not None]
    found = [one for one in spectra if one is not None]
    if len(found) < 2:
        return found[0] if found else None
    grid = np.union1d(found[0][0], found[1][0])
    both = [[np.interp(grid, f, column, left=0.0, right=0.0) for column in S.T] for f, S in found]
    return grid, np.sum(both, axis=0).T


def _rms(squares: np.ndarray) -> dict[str, float]:
    """Root of mean squares (2,) about both axes, and radial."""
    x, y = np.sqrt(squares).tolist()
    return {"los_x_rad": x, "los_y_rad": y, "radial_rad": float(radial_rms(squares))}


def _window_label(window: float) -> str:
    if window >= 1.0:
        return f"{window:g}s"
    if window >= 1e-3:
        return f"{1e3 * window:g}ms"
    return f"{1e6 * window:g}us"
