"""Sources of line-of-sight motion besides the drives: reaction wheels, lines and densities from files."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from microvib.analysis.margins import frequency_error_bound
from microvib.analysis.pointing import LEFT_OUT, TORQUE_SPREAD
from microvib.errors import MicrovibError, error_context, quoted_value
from microvib.io.file_access import FileAccess
from microvib.io.tables import dict_rows, parse_finite
from microvib.io.writing import EDITED_COPY, require_unchanged
from microvib.model.coupling import (
    line_of_sight_transfer,
    receiver_of,
    require_craft,
    resonance_frequency_grid,
)
from microvib.model.drive_states import MAY_STICK, DriveStates, Sticking, drive_states
from microvib.model.rigid import rigid_motion_at
from microvib.model.scenario import Scenario
from microvib.model.sentences import validate_part
from microvib.signals.pointing import METRICS
from microvib.solve.channels import LOAD_COLUMNS, LOS_COLUMNS
from microvib.studies.budget.errors import SourceError
from microvib.studies.budget.files import AXES, OtherSource, Wheel, WheelHarmonic
from microvib.studies.budget.side_lines import TurningDrives, turning_drives
from microvib.studies.budget.sources import (
    Contribution,
    Unobserved,
    both_errors,
    low_frequency_gap,
    natural_frequencies,
    open_gap,
    response_uncertainty,
    unseen_axes,
)
from microvib.studies.budget.wheels import WheelOnCraft, bound_over_phases
from microvib.units import Si

_LOAD_DENSITIES = ("fx_n2_hz", "fy_n2_hz", "fz_n2_hz", "mx_n2_m2_hz", "my_n2_m2_hz", "mz_n2_m2_hz")
_LOS_DENSITIES = ("los_x_rad2_hz", "los_y_rad2_hz")
_PHASES = (
    *(f"{name.split('_')[0]}_phase_rad" for name in LOAD_COLUMNS),
    "los_x_phase_rad",
    "los_y_phase_rad",
)
_BOUNDS = tuple(f"los_{axis}_{end}_rad" for end in ("least", "most") for axis in AXES[:2])
"""Between which the amplitudes of ``lines.csv`` of a budget lie."""
_METRIC_COLUMNS = rf"({'|'.join(METRICS)})_[0-9.e+-]+(s|ms|us)_[xy]_rad"
"""Rms in windows, which ``pointing.csv`` of a run has beside the amplitudes that it follows from."""


def contribution_of_other(
    source: OtherSource,
    scenario: Scenario,
    files: FileAccess,
    sticking: tuple[Sticking, Sticking] = (MAY_STICK, MAY_STICK),
) -> Contribution:
    """A source of a file of sources, on the hub of ``scenario`` with its drive and array, of which
    ``sticking`` tells the shafts that may stick; its tables are taken from ``files``.
    """
    if source.error is not None or source.periodic is not None:
        return _of_class(source)
    with error_context(f"sources: {source.name}"):
        if source.wheel is not None:
            place = _load_point_motion(source, scenario)
            given = _with_table(source.wheel, files)
            return WheelOnCraft(source.name, given, scenario, place, sticking).contribution()
        states = drive_states(scenario, sticking=sticking)
        turning = turning_drives(scenario, sticking)
        if source.lines:
            return _of_lines(source, turning, files, states)
        return _of_density(source, turning, files, states)


NEXT_TO_NOTHING = 1e-9
"""Part of its largest amplitude with which a line counts that is given as nothing."""


@dataclass(frozen=True)
class Excitation:
    """Where over frequency the loads of a source act on the hub; what is given as motion of the line
    of sight does not act on it.
    """

    low: np.ndarray
    high: np.ndarray
    """Between which frequencies [Hz] each of its lines may be, (k,)."""
    density: tuple[np.ndarray, np.ndarray] | None = None
    """Frequencies (n,) [Hz] and densities of the loads (n, 6)."""


def excitation_of(source: OtherSource, files: FileAccess) -> Excitation:
    """Where over frequency the loads of a source act, whose tables are taken from ``files``."""
    with error_context(f"sources: {source.name}"):
        if source.wheel is not None:
            harmonics = _with_table(source.wheel, files).harmonics
            low, high = np.array(
                [(h.order - h.order_error, h.order + h.order_error) for h in harmonics]
            ).T / (2.0 * math.pi)
            speed = source.wheel.speed
            return Excitation(speed * low, (source.wheel.speed_to or speed) * high)
        none = np.zeros(0)
        if source.lines is None and source.density is None:
            return Excitation(none, none)
        if source.lines:
            path = files.under("lines").path(source.lines)
            rows, chosen = _line_table(path)
            if chosen != LOAD_COLUMNS:
                return Excitation(none, none)
            f = _columns(path, rows, ("frequency_hz",))[:, 0]
            return Excitation(f, f)
        path = files.under("density").path(source.density)
        rows, chosen = _table(path, "densities", (_LOAD_DENSITIES, _LOS_DENSITIES))
        if chosen != _LOAD_DENSITIES:
            return Excitation(none, none)
        f, S = _columns(path, rows, ("frequency_hz",))[:, 0], _columns(path, rows, chosen)
        return Excitation(none, none, (f, S))


_RPM = 2.0 * math.pi / 60.0
_HARMONIC_UNITS = {
    "radial_force": "n",
    "axial_force": "n",
    "radial_torque": "n_m",
    "axial_torque": "n_m",
}
_COEFFICIENTS = {
    f"{key}{end}_{unit}_{per}": (f"{key}{end}", size)
    for end in ("", "_least", "_most")
    for per, size in (("s2_rad2", 1.0), ("rpm2", _RPM**-2))
    for key, unit in _HARMONIC_UNITS.items()
}
"""Columns of a table of harmonics: what each is, and its unit in N s^2/rad^2 or N m s^2/rad^2."""
_ORDER_ERROR = "order_error"
"""Column of by how much each order may be smaller or larger."""


def _with_table(wheel: Wheel, files: FileAccess) -> Wheel:
    """The wheel with the harmonics of its table, where it names one."""
    if wheel.table is None:
        return wheel
    path = files.under("wheel.table").path(wheel.table)
    require_unchanged(path, EDITED_COPY)
    rows = dict_rows(
        path,
        ("order", _ORDER_ERROR, *_COEFFICIENTS),
        what="harmonics of a wheel",
        needed=("order",),
    )
    columns = [name for name in _COEFFICIENTS if rows and name in rows[0]]
    keys = [_COEFFICIENTS[name][0] for name in columns]
    with error_context(path):
        if not columns:
            raise MicrovibError(
                f"is not a table of harmonics: order and one of {', '.join(_COEFFICIENTS)} are expected"
            )
        twice = next((key for key in keys if keys.count(key) > 1), None)
        if twice is not None:
            raise MicrovibError(f"has {twice} in two units; leave one of the columns out")
        harmonics = []
        for k, row in enumerate(rows, 2):
            given: dict[str, Any] = {"order": _above_zero(k, row, "order")}
            if _ORDER_ERROR in row:
                given[_ORDER_ERROR] = _above_zero(k, row, _ORDER_ERROR, allowed=True)
            for name in columns:
                key, size = _COEFFICIENTS[name]
                given[key] = Si(size * _above_zero(k, row, name, allowed=True))
            harmonics.append(validate_part(WheelHarmonic, given, origin=f"row {k}"))
    return wheel.model_copy(update={"harmonics": tuple(harmonics), "table": None})


def _above_zero(k: int, row: Mapping[str, str], name: str, *, allowed: bool = False) -> float:
    """Number of a cell of row ``k``, which is above 0, or 0 where that is ``allowed``."""
    value = parse_finite(f"row {k}: {name}", row[name])
    if value < 0.0 or (value == 0.0 and not allowed):
        least = "0 or more" if allowed else "more than 0"
        raise MicrovibError(f"row {k}: {name}: {value:g} is not allowed; {least} is expected")
    return value


_IN_WORDS = {"fixed": "known", "uniform": "uniform", "normal": "normal", "arcsine": "arcsine"}
"""How distributions of errors are told."""


def _of_class(source: OtherSource) -> Contribution:
    """An error of the line of sight by its class, the same on any craft."""
    beside = f", fully correlated with group {source.group}" if source.group else ""
    if source.periodic is None:
        assert source.error is not None
        kind = {"constant": source.constant, "random": source.random, "drift": source.drift}
        name = next(key for key, value in kind.items() if value is not None)
        how = f"{name} error, {_IN_WORDS[source.error.distribution]}{beside}"
        none = np.zeros((0, 2), dtype=complex)
        error = SourceError(source.error, source.group)
        return Contribution(source.name, how, (), np.zeros(0), none, errors=(error,))
    given = source.periodic
    clock = f"group {source.group}" if source.group else ""
    return Contribution(
        source.name,
        f"periodic error{beside}",
        ("periodic",),
        np.array([given.frequency]),
        np.array([[given.x, given.y]], dtype=complex),
        clock,
        phased=False,
    )


def _load_point_motion(source: OtherSource, scenario: Scenario) -> np.ndarray:
    """Motion of the place where loads act by the hub's coordinates, (6, n)."""
    craft = require_craft(scenario)
    n = receiver_of(scenario).root.shape[1]
    if source.point is not None:
        if source.point not in craft.spacecraft.points:
            raise MicrovibError(
                f"point: '{source.point}' is not on the hub; there are"
                f" {', '.join(craft.spacecraft.points)}"
            )
        return craft.at(source.point)[:, :n]
    if source.position is None:
        raise MicrovibError(
            "position: missing; loads need their place on the hub, position or point"
        )
    if n > 6:
        known = ", ".join(craft.spacecraft.points)
        raise MicrovibError(
            f"position: a flexible hub moves only where it has points; give point, one of {known}"
        )
    return rigid_motion_at(np.array(source.position))


def _table(
    path: Path,
    what: str,
    choices: Sequence[tuple[str, ...]],
    also: Sequence[str] = (),
    ignored: str = "(?!)",
) -> tuple[list[dict[str, str]], tuple[str, ...]]:
    """Rows of a CSV file, and which of the ``choices`` of columns it has; ``also`` are columns that
    may be there beside.
    """
    require_unchanged(path, EDITED_COPY)
    rows = dict_rows(
        path,
        ("frequency_hz", *(name for c in choices for name in c), *also),
        what=what,
        ignored=ignored,
    )
    head = rows[0] if rows else {}
    chosen = [c for c in choices if any(name in head for name in c)]
    if not chosen or "frequency_hz" not in head:
        either = " or ".join(", ".join(c) for c in choices)
        raise MicrovibError(
            f"{path}: is not a table of {what}: columns frequency_hz and {either} are expected"
        )
    if len(chosen) > 1:
        loads, angles = (next(name for name in c if name in head) for c in chosen)
        raise MicrovibError(
            f"{path}: has both loads ({loads}) and line-of-sight angles ({angles}); give them as two sources, or leave one out"
        )
    return rows, chosen[0]


def _columns(path: Path, rows: list[dict[str, str]], names: tuple[str, ...]) -> np.ndarray:
    """Numbers of columns, (rows, columns), 0 where a column is missing; nan where a cell is empty."""
    with error_context(path):
        return np.array([[_cell(k, row, n) for n in names] for k, row in enumerate(rows, 2)])


def _cell(k: int, row: dict[str, str], name: str) -> float:
    if name not in row:
        return 0.0
    if not row[name]:
        return math.nan
    return parse_finite(f"row {k}: {name}", row[name])


def _line_table(path: Path) -> tuple[list[dict[str, str]], tuple[str, ...]]:
    """Rows of a table of lines, and whether loads or angles of the line of sight are given."""
    return _table(
        path,
        "lines",
        (LOAD_COLUMNS, LOS_COLUMNS),
        ("line", "source", "settled", LEFT_OUT, TORQUE_SPREAD, *_BOUNDS, *_PHASES),
        _METRIC_COLUMNS,
    )


def _of_lines(
    source: OtherSource, turning: TurningDrives, files: FileAccess, states: DriveStates | None
) -> Contribution:
    scenario, side = turning.scenario, None
    path = files.under("lines").path(source.lines)
    rows, chosen = _line_table(path)
    f, sizes = _columns(path, rows, ("frequency_hz",))[:, 0], _columns(path, rows, chosen)
    if np.any(sizes < 0.0):
        row, column = np.argwhere(sizes < 0.0)[0]
        raise MicrovibError(
            f"{path}: row {row + 2}: {chosen[column]}: {sizes[row, column]:g} is negative; an"
            " amplitude is 0 or more"
        )
    of_phases = tuple(
        name
        for name, what in zip(_PHASES, (*LOAD_COLUMNS, *LOS_COLUMNS), strict=True)
        if what in chosen
    )
    phases = _columns(path, rows, of_phases)
    phases[:, [name not in rows[0] for name in of_phases]] = np.nan
    phased = ~np.any(np.isnan(phases) & (np.nan_to_num(sizes) != 0.0), axis=1)
    if source.clock and not np.all(phased):
        raise MicrovibError(
            f"clock: its lines are added with their phases, and {path.name} lacks some of"
            f" {', '.join(of_phases)}"
        )
    if not np.all(f > 0.0):
        raise MicrovibError(f"{path}: frequency_hz: frequencies greater than 0 Hz are expected")
    tones, relative_error = sizes * np.exp(1j * np.nan_to_num(phases)), np.zeros((2, f.size, 2))
    lost = np.isnan(sizes).any(axis=1)
    if chosen == LOAD_COLUMNS:
        loads, place = tones, _load_point_motion(source, scenario)
        on_hub = turning.craft.on_hub(place) * np.nan_to_num(loads)[:, None, :]
        together = on_hub.sum(axis=2, keepdims=True)
        only = np.concatenate([together, np.zeros_like(on_hub[:, :, 1:])], axis=2)
        side = turning.of_lines(f, np.where(phased[:, None, None], only, on_hub))

        def moved(on: Scenario, at: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
            """Line of sight by the loads of the lines at frequencies (k n,), and by which part it
            may be smaller and larger.
            """
            each = np.repeat(loads, at.size // f.size, axis=0)
            parts = np.einsum("fkc,fc->cfk", line_of_sight_transfer(on, at, place), each)
            most, unsure = bound_over_phases(np.abs(parts))
            together = np.repeat(phased, at.size // f.size)[:, None]
            return np.where(together, parts.sum(axis=0), most), np.where(together, 0.0, unsure)

        tones, unsure = moved(scenario, f)
        of_response = response_uncertainty(
            [
                lambda at: np.abs(moved(scenario, at)[0]),
                *_of_states(states, loads, place, phased),
            ],
            f,
            np.asarray(frequency_error_bound(f)),
            natural_frequencies(scenario, states),
        )
        relative_error = both_errors(unsure, of_response)
    names = tuple(row.get("line") or f"{x:.5g} Hz" for row, x in zip(rows, f, strict=True))
    gaps = tuple(
        open_gap(f"{names[k]} has an empty cell", float(f[k]), float(f[k]))
        for k in np.flatnonzero(lost)
    )
    gaps += _missing_axes_gap(rows, chosen)
    if chosen == LOAD_COLUMNS:
        gaps += low_frequency_gap(scenario, f[np.nan_to_num(sizes).any(axis=1)])
    left_out = list(dict.fromkeys(filter(None, (row.get(LEFT_OUT, "").strip() for row in rows))))
    gaps += tuple(open_gap(f"{path.name} leaves out: {said}") for said in left_out)
    if chosen == LOS_COLUMNS:
        least, most = _stated_bounds(path, rows, sizes)
        # A line that is nothing as given, and may be something, counts as next to nothing.
        tones = np.where((sizes == 0.0) & (most > 0.0), NEXT_TO_NOTHING * most, tones)
        relative_error = _stated_errors(np.abs(tones), least, most)
    if left_out:  # what is not there may have changed what is
        relative_error = both_errors(relative_error, _tolerance_of_marked(rows))
    rings = None
    if "settled" in rows[0]:  # as a budget's own lines.csv says it
        rings = np.array(
            [not _parse_bool(f"{path}, row {k}", row["settled"]) for k, row in enumerate(rows, 2)]
        )
    how = f"lines of {path.name}{_missing_loads_note(rows, chosen)}"
    # a file may name its clock as it likes, and must not be taken for a drive's
    clock = f"file {source.clock}" if source.clock else ""
    return Contribution(
        source.name, how, names, f, np.nan_to_num(tones), clock, gaps=gaps, relative_error=np.nan_to_num(relative_error),
        phased=bool(np.all(phased)), rings=rings, side=side,
    )  # fmt: skip


_SAME_DIGITS = 1e-3
"""Part by which an amplitude and its bounds may be the wrong way round, since tables are rounded."""


def _stated_bounds(
    path: Path, rows: list[dict[str, str]], sizes: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Least and largest amplitudes of the lines of a table, (k, 2) each, about their ``sizes``; nan where
    it does not say. MicrovibError where an amplitude is not between them.
    """
    ends = _columns(path, rows, _BOUNDS)
    ends[:, [name not in rows[0] for name in _BOUNDS]] = np.nan
    least, most = np.split(ends, 2, axis=1)
    outside = (least > sizes * (1.0 + _SAME_DIGITS)) | (most < sizes * (1.0 - _SAME_DIGITS))
    for k, axis in np.argwhere(outside).tolist():
        found = f"los_{AXES[axis]}_rad {sizes[k, axis]:g}"
        why = _outside_of(least[k, axis], most[k, axis])
        raise MicrovibError(f"{path}, row {k + 2}: {found} is {why} of its row")
    return least, most


def _outside_of(least: float, most: float) -> str:
    """How an amplitude is outside of its bounds, of which one may be nan, in words."""
    if math.isnan(least):
        return f"above {most:g}, the most"
    if math.isnan(most):
        return f"below {least:g}, the least"
    return f"not between {least:g} and {most:g}, the least and the most"


def _stated_errors(sizes: np.ndarray, least: np.ndarray, most: np.ndarray) -> np.ndarray:
    """By which part amplitudes (k, 2) may be smaller and larger than they are given, (2, k, 2); 0
    where a bound is not said.
    """
    given = np.where(sizes > 0.0, sizes, 1.0)
    errors = np.array([1.0 - least / given, most / given - 1.0])
    return np.where(np.isfinite(errors) & (sizes > 0.0), np.maximum(errors, 0.0), 0.0)


def _tolerance_of_marked(rows: list[dict[str, str]]) -> np.ndarray:
    """Part by which lines may be smaller, (2, k, 1), beside others that are left out: all of it,
    but where the table says how small they may be.
    """
    says = all(name in rows[0] for name in _BOUNDS)
    marked = np.array([bool(row.get(LEFT_OUT, "").strip()) and not says for row in rows])
    return np.array([marked.astype(float), np.zeros(len(rows))])[:, :, None]


def _of_states(
    states: DriveStates | None, loads: np.ndarray, place: np.ndarray, phased: np.ndarray
) -> list[Callable[[np.ndarray], np.ndarray]]:
    """Smallest and largest line of sight (2, k n, 2) by the ``loads`` (k, 6) of lines at a place,
    at frequencies (k n,) [Hz], n for each line, over all states of the drives; none where these are
    known.
    """
    if states is None:
        return []

    def extremes(at: np.ndarray) -> np.ndarray:
        each = np.repeat(np.nan_to_num(loads), at.size // loads.shape[0], axis=0)
        parts = states.on_hub(place) * each[:, None, :]
        found = states.extremes(at, np.dstack([parts.sum(axis=2), parts]))
        together = np.repeat(phased, at.size // loads.shape[0])[:, None]
        return np.where(together, found[..., 0], found[..., 1:].sum(axis=-1))

    return [extremes]


def _parse_bool(where: str, text: str) -> bool:
    if text.strip().lower() not in ("true", "false"):
        raise MicrovibError(f"{where}: settled is {quoted_value(text)}; True or False is expected")
    return text.strip().lower() == "true"


def _missing_axes_gap(
    rows: Sequence[Mapping[str, str]], chosen: Sequence[str]
) -> tuple[Unobserved, ...]:
    """The gap of an axis of the line of sight about which a table says nothing."""
    missing = [axis for axis in AXES[:2] if not any(f"los_{axis}_" in name for name in rows[0])]
    if chosen[0].startswith("los_"):
        return unseen_axes(missing, "a column of it is missing")
    return ()


def _missing_loads_note(rows: Sequence[Mapping[str, str]], chosen: Sequence[str]) -> str:
    """Note on the loads that a table has, if not all."""
    if chosen[0].startswith("los_"):
        return ""
    given = [name for name in chosen if name in rows[0]]
    return ", loads on the hub" + (
        "" if len(given) == len(chosen) else f" ({', '.join(given)}; the others count as 0)"
    )


def _of_density(
    source: OtherSource, turning: TurningDrives, files: FileAccess, states: DriveStates | None
) -> Contribution:
    scenario, side = turning.scenario, None
    path = files.under("density").path(source.density)
    rows, chosen = _table(path, "densities", (_LOAD_DENSITIES, _LOS_DENSITIES))
    f, S = _columns(path, rows, ("frequency_hz",))[:, 0], _columns(path, rows, chosen)
    _check_density(path, f, S, chosen)
    gaps, bounds = _missing_axes_gap(rows, chosen), None
    if chosen == _LOAD_DENSITIES:
        place = _load_point_motion(source, scenario)
        near = [resonance_frequency_grid(scenario)]
        if states is not None:
            near += [f + width * _OFFSETS for f, width in states.natural_frequencies.tolist()]
        f, S = _refine_density(f, S, np.concatenate(near))
        at = np.maximum(f, _STATIC)
        by = line_of_sight_transfer(scenario, at, place)
        gaps = _slow_density_gap(scenario, f, S)
        sizes = np.abs(np.nan_to_num(by))
        extremes = np.array([sizes, sizes])
        if states is not None:
            extremes = states.extremes(at, states.on_hub(place)) * np.isfinite(by)
        if states is not None or np.count_nonzero(S.any(axis=0)) > 1:
            bounds = _bounds_over_correlations(extremes * np.sqrt(S)[:, None, :])
        loads, S = S, np.einsum("fkc,fc->fk", sizes**2, S)
        side = turning.of_density(at, loads, turning.craft.on_hub(place), S)
    none = np.zeros((0, 2), dtype=complex)
    return Contribution(
        source.name,
        f"density of {path.name}{_missing_loads_note(rows, chosen)}",
        (),
        np.zeros(0),
        none,
        density=(f, S),
        density_bounds=None if bounds is None else (bounds[0], bounds[1]),
        side=side,
        gaps=gaps,
    )


def _check_density(path: Path, f: np.ndarray, S: np.ndarray, names: tuple[str, ...]) -> None:
    """Raise MicrovibError unless frequencies ascend and densities are numbers of 0 or more."""
    if f.size < 2:
        raise MicrovibError(
            f"{path}: holds one frequency; a density needs two or more, between which it is linear"
        )
    if not f[0] >= 0.0:
        raise MicrovibError(
            f"{path}: row 2: frequency_hz: {f[0]:g} is not allowed; 0 Hz or more is expected"
        )
    falls = np.flatnonzero(~(np.diff(f) > 0.0))
    if falls.size:
        row = int(falls[0])
        raise MicrovibError(
            f"{path}: row {row + 3}: frequency_hz: {f[row + 1]:g} Hz is not above {f[row]:g} Hz of the row before; frequencies"
            " that ascend are expected, and a step as two of them close together"
        )
    wrong = np.argwhere(~(S >= 0.0))
    if wrong.size:
        row, column = wrong[0]
        raise MicrovibError(
            f"{path}: row {row + 2}: {names[column]}: {S[row, column]:g} is not allowed; a density is 0 or more"
        )


def _bounds_over_correlations(parts: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Smallest and largest density (n, 2) of what several loads make of which nobody says how they are
    correlated; ``parts`` (2, n, 2, c) are the roots of the densities by each at the least and at
    most.

    Loads of one cause, a force with its moment about another point, add as amplitudes, or cancel.
    """
    low, high = parts
    total = high.sum(axis=-1)
    left = np.max(low + high - total[..., None], axis=-1)  # of each what the others may leave
    return np.maximum(left, 0.0) ** 2, total**2


_OFFSETS = np.linspace(-30.0, 30.0, 241)
"""Frequencies about a resonance, in parts of its half-width."""
_GRID_SPACING = 2e-3
"""Relative distance of a grid's frequencies, apart from resonances."""
_STATIC, _SLOWEST = 1e-6, 1e-3
"""Frequencies [Hz]: of the response that a density has at 0 Hz, where nothing holds a hub in place; and
from which a grid's are apart by their spacing."""


def _slow_density_gap(scenario: Scenario, f: np.ndarray, S: np.ndarray) -> tuple[Unobserved, ...]:
    """Gap of a density of loads (n, 6) at frequencies (n,) [Hz] below those at which the motion of a hub
    without attitude control means something.
    """
    acts = np.any(S, axis=1)
    from_each, to_each = f[:-1], f[1:]
    between = acts[:-1] | acts[1:]
    return low_frequency_gap(scenario, from_each[between], to_each[between])


def _refine_density(
    f: np.ndarray, S: np.ndarray, near: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """A density on a grid that resolves the craft's resonances by frequencies ``near`` them, linear
    between what was given.
    """
    first = min(max(f[0], _SLOWEST), f[-1])
    count = int(math.log(f[-1] / first) / _GRID_SPACING) + 2
    grid = np.union1d(np.r_[f, near], np.geomspace(first, f[-1], count))
    grid = grid[(grid >= f[0]) & (grid <= f[-1])]
    return grid, np.array([np.interp(grid, f, column) for column in S.T]).T
