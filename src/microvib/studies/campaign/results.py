"""Results of a campaign as one labelled data set, written chunk by chunk so that memory stays
bounded.
"""

from __future__ import annotations

import shlex
from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from microvib.errors import MicrovibError
from microvib.io.hdf5 import open_hdf5
from microvib.io.named import read_text
from microvib.io.netcdf import new_netcdf
from microvib.io.tables import package_versions
from microvib.io.writing import digest_of, write_file
from microvib.model.expected import expected_lines
from microvib.studies.campaign.cases import (
    FIGURES,
    LINE_OF_SIGHT,
    RECORDS,
    SCALARS,
    VERDICTS,
    Chunk,
)
from microvib.studies.campaign.folder import Campaign
from microvib.studies.campaign.variation import keys_of
from microvib.units import Si

RESULTS, DIGEST = "results.nc", "results.sha256"
MISSING, DONE, FAILED = 0, 1, 2
"""States of a case."""
_VARIABLES = {
    "amplitude": ("N*m", "amplitude of the line, 0-to-peak"),
    "frequency": ("Hz", "frequency of the line"),
    "bin_amplitude": ("N*m", "amplitude of the nearest bin, rectangular window"),
    "phase": ("rad", "phase of the cosine at the first sample"),
    "decay": ("1/s", "decay rate of the tone"),
    "peak": ("N*m", "largest disturbance torque of the record"),
    "rms": ("N*m", "RMS of the disturbance torque about its mean"),
    "stuck_output": ("1", "part of the time that the shaft sticks"),
    "status": ("1", "status"),
    "los_x": ("rad", "amplitude of the first angle of the line of sight, 0-to-peak"),
    "los_y": ("rad", "amplitude of the second angle of the line of sight, 0-to-peak"),
}
"""Stored variables of lines and cases: unit and meaning."""
_TEXT_VARIABLES = {
    "reasons": ("reason", "why the case failed; empty where it did not"),
    "notes": ("note", "notes on the case"),
    "gaps": ("gaps", "what of the case could not be judged against the study's limit"),
}
"""Texts of each case in a chunk: their variable in the file, and its meaning."""
_CLOCK_KEYS = (
    "tracking", "driver", "motor", "reducer", "driver.microsteps", "driver.beats", "reducer.ratio",
    "motor.rotor_teeth", "motor.phases",
)  # fmt: skip
"""Keys by which lines of the clock move, besides those of the tracking."""
_ANY_FREQUENCY = 1e9
_CASES_PER_BLOCK = 4096
"""Cases of one block of the file."""


@dataclass(frozen=True)
class Merged:
    """Result of a merge."""

    cases: int
    done: int
    failed: int
    lines: tuple[str, ...]
    path: Path


def merge(campaign: Campaign) -> Merged:
    """Write ``results.nc`` of all chunks that are there; the same results give the same numbers
    whoever computed them.

    Cases that are not computed yet are marked as missing. OutputError where the file cannot be
    written.
    """
    lines = tuple(dict.fromkeys(name for _, chunk in campaign.results() for name in chunk.lines))
    statuses = tuple(sorted({text for _, chunk in campaign.results() for text in chunk.statuses}))
    path = campaign.folder / RESULTS
    state = np.full(campaign.design.cases, MISSING, dtype=np.int8)
    write_file(path, lambda new: _write(campaign, new, lines, statuses, state), overwrite=True)
    write_file(campaign.folder / DIGEST, f"{digest_of(path)}  {RESULTS}\n", overwrite=True)
    return Merged(
        campaign.design.cases, int(np.sum(state == DONE)), int(np.sum(state == FAILED)), lines, path
    )


def _write(
    campaign: Campaign,
    path: Path,
    lines: tuple[str, ...],
    statuses: tuple[str, ...],
    state: np.ndarray,
) -> None:
    """Write the merged file and fill in ``state`` of each case, (cases,)."""
    design = campaign.design
    with new_netcdf(path) as f:
        f.dimensions = {"case": design.cases, "line": len(lines)}
        f.attrs["title"] = design.study.title or "microvib campaign"
        f.attrs["campaign_sha256"] = campaign.identity
        f.attrs["microvib_version"] = package_versions()["microvib"]
        _text(f, "line", "line", np.array(lines, dtype=object), "name of the line")
        _parameters(f, campaign)
        kept = {*FIGURES, *(name for _, chunk in campaign.results() for name in chunk.figures)}
        figures = _Figures(f, lines, statuses, kept)
        texts = {name: np.full(design.cases, "", dtype=object) for name in _TEXT_VARIABLES}
        verdict, record = (np.zeros(design.cases, dtype=np.int8) for _ in range(2))
        for cases, chunk in campaign.results():
            here = slice(cases.start, cases.stop)
            state[here] = [FAILED if reason else DONE for reason in chunk.reasons]
            verdict[here], record[here] = chunk.verdict, chunk.record
            figures.write(here, chunk)
            for name, values in texts.items():
                values[here] = getattr(chunk, name)
        for name, (variable, meaning) in _TEXT_VARIABLES.items():
            _text(f, variable, "case", texts[name], meaning)
        for name, data, flags in (
            ("verdict", verdict, VERDICTS),
            ("record", record, RECORDS),
            ("state", state, ("not computed", "done", "failed")),
        ):
            f.create_variable(name, ("case",), data=data).attrs["flag_meanings"] = _flags(flags)


class _Figures:
    """Variables of what is kept of every line and of every case."""

    def __init__(
        self, f: Any, lines: tuple[str, ...], statuses: tuple[str, ...], kept: set[str]
    ) -> None:
        names = [name for name in (*FIGURES, *LINE_OF_SIGHT) if name in kept]
        self._of_lines = {name: _variable(f, name, ("case", "line")) for name in names}
        self._of_cases = {name: _variable(f, name, ("case",)) for name in SCALARS}
        self._status = _variable(f, "status", ("case", "line"), np.int16, -1)
        self._status.attrs["flag_meanings"] = _flags(statuses) or "none"
        self._position = {name: k for k, name in enumerate(lines)}
        self._statuses = statuses

    def write(self, here: slice, chunk: Chunk) -> None:
        """Write the cases of a chunk."""
        where, width = [self._position[name] for name in chunk.lines], len(self._position)
        for name, values in chunk.figures.items():
            self._of_lines[name][here, :] = _scatter_columns(values, where, width, np.nan)
        for name, variable in self._of_cases.items():
            variable[here] = chunk.scalars[name]
        numbers = np.array(
            [*(self._statuses.index(text) for text in chunk.statuses), -1], dtype=np.int16
        )
        self._status[here, :] = _scatter_columns(numbers[chunk.status], where, width, -1)


def _flags(meanings: Iterable[str]) -> str:
    return "; ".join(f"{k}: {text}" for k, text in enumerate(meanings))


def _scatter_columns(values: np.ndarray, where: list[int], width: int, empty: float) -> np.ndarray:
    """Columns of a chunk at the places that they have in the whole."""
    whole = np.full((values.shape[0], width), empty, dtype=values.dtype)
    whole[:, where] = values
    return whole


def _parameters(f: Any, campaign: Campaign) -> None:
    design = campaign.design
    quantities = {name: quantity for name, _, quantity in design.base.entries()}
    for key in design.keys:
        values, quantity = design.column(key), quantities.get(keys_of(design.base, key)[0])
        meaning = quantity.meaning if quantity else key
        if values.dtype == object:
            _text(f, key, "case", values, meaning)
        else:
            variable = f.create_variable(key, ("case",), data=values)
            if quantity:
                variable.attrs["units"] = quantity.unit or "1"
            else:
                variable.attrs["units"] = "1"
            variable.attrs["long_name"] = meaning


def _variable(
    f: Any, name: str, dims: tuple[str, ...], dtype: Any = float, empty: float = np.nan
) -> Any:
    sizes = [f.dimensions[dim].size for dim in dims]
    blocks = (
        min(_CASES_PER_BLOCK, max(sizes[0], 1)),
        *(1 for _ in sizes[1:]),
    )  # a column is read at once, without the others
    variable = f.create_variable(
        name, dims, dtype=dtype, fillvalue=empty, chunks=blocks if min(sizes) else None
    )
    variable.attrs["units"], variable.attrs["long_name"] = _VARIABLES[name]
    return variable


def _text(f: Any, name: str, dim: str, values: np.ndarray, meaning: str) -> None:
    import h5py

    variable = f.create_variable(name, (dim,), dtype=h5py.string_dtype(), data=values)
    variable.attrs["long_name"] = meaning


@dataclass(frozen=True)
class Results:
    """Merged results, read column by column; what each column is looked up by is read once."""

    campaign: Campaign
    path: Path

    @property
    def dataset(self) -> Any:
        """All of them as an ``xarray.Dataset`` with dimensions ``case`` and ``line``, read when
        looked at.
        """
        import xarray as xr

        with open_hdf5(self.path) as root:
            root.members()  # none of them leads out of the file, where xarray would follow
        return xr.open_dataset(self.path, engine="h5netcdf")

    @cached_property
    def lines(self) -> tuple[str, ...]:
        """Names of the lines."""
        return tuple(self._texts("line"))

    @cached_property
    def clock_lines(self) -> dict[str, np.ndarray]:
        """Frequency [Hz] that each line of the clock is expected at in every case, whatever its record
        shows, (cases,) by name; nan where a case has no such line.
        """
        design = self.campaign.design
        count, found = design.cases, dict[str, np.ndarray]()
        columns = [design.column(key) for key in design.keys if _moves_the_clock(key)]
        alike: dict[tuple[str, ...], list[int]] = {}
        for k in range(count):
            alike.setdefault(tuple(str(x[k]) for x in columns), []).append(k)
        rates = np.ones(count)
        if "tracking.rate" in design.keys:
            rates = np.abs(design.column("tracking.rate").astype(float))
        for cases in alike.values():
            scenario = design.base.with_si(design.changes(cases[0]))
            scale = rates[cases] / rates[cases[0]]
            for one in expected_lines(scenario, Si(_ANY_FREQUENCY), design.study.harmonics):
                if one.of_clock:
                    of_line = found.setdefault(one.name, np.full(count, np.nan))
                    of_line[cases] = one.frequency * scale
        return found

    @cached_property
    def state(self) -> np.ndarray:
        """MISSING, DONE or FAILED of each case, (cases,)."""
        return self._read("state")

    @property
    def reasons(self) -> list[str]:
        """Why a case failed, (cases,)."""
        return self._texts("reason")

    @property
    def notes(self) -> list[str]:
        """Notes on each case, (cases,)."""
        return self._texts("note")

    @property
    def verdicts(self) -> np.ndarray:
        """Verdict on each case against the study's limit, an index in
        VERDICTS, (cases,).
        """
        return self._read("verdict")

    @cached_property
    def records(self) -> np.ndarray:
        """Kind of each case's record, an index in RECORDS, (cases,)."""
        return self._read("record")

    @property
    def gaps(self) -> list[str]:
        """Gaps in the judgement of each case, (cases,)."""
        return self._texts("gaps")

    def scalar(self, name: str) -> np.ndarray:
        """A figure of each case, (cases,): ``peak``, ``rms``, ``stuck_output``, or a number that
        varies, by its key.
        """
        return self._read(name)

    def of(self, line: str, figure: str = "amplitude") -> np.ndarray:
        """One figure of one line over all cases, (cases,); nan where a case has no such line."""
        return self._read(figure, self.lines.index(line))

    def status(self, line: str) -> np.ndarray:
        """Status of one line in each case, texts (cases,); empty where a case has no such line."""
        numbers = self._read("status", self.lines.index(line)).astype(int)
        return np.array([*self._statuses, ""], dtype=object)[numbers]

    @cached_property
    def _statuses(self) -> list[str]:
        with open_hdf5(self.path) as root:
            meanings = str(root.dataset("status").attribute("flag_meanings"))
        return [text.partition(": ")[2] for text in meanings.split("; ")]

    def _read(self, name: str, column: int | None = None) -> np.ndarray:
        with open_hdf5(self.path) as root:
            return root.dataset(name).numbers(column)

    def _texts(self, name: str) -> list[str]:
        with open_hdf5(self.path) as root:
            return root.dataset(name).texts()


def _moves_the_clock(key: str) -> bool:
    """Whether lines of the clock are at other orders of the rate by a key, or it is one of the clock
    besides the rate.
    """
    if key == "tracking.rate":
        return False
    return key in _CLOCK_KEYS or key.startswith("tracking.")


def open_results(campaign: Campaign) -> Results:
    """Merged results of a campaign; MicrovibError where they are not merged, were changed since, or
    are of another campaign.
    """
    path = campaign.folder / RESULTS
    if not path.is_file():
        raise MicrovibError(
            f"{path}: is not there yet; merge them with: microvib campaign merge"
            f" {shlex.quote(str(campaign.folder))}"
        )
    again = f"microvib campaign merge {shlex.quote(str(campaign.folder))}"
    digest = campaign.folder / DIGEST
    if digest.is_file() and read_text(digest, "digest", ()).split()[:1] != [digest_of(path)]:
        raise MicrovibError(f"{path}: was changed since it was merged; merge again: {again}")
    with open_hdf5(path) as root:
        if root.attribute("campaign_sha256") != campaign.identity:
            raise MicrovibError(f"{path}: is of another campaign; merge again: {again}")
    return Results(campaign, path)
