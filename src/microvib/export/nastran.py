"""Bulk data of Nastran: loads of a run by frequency, time and density at the interface grid, and drive
and array as matrices there.

pyyeti formats the cards. Tables of lines are triangles a ten-thousandth wide, so that a frequency
between lines has no load; those of time and density begin and end with zeros, since Nastran goes on
with the last slope beyond a table.
"""

from __future__ import annotations

import io
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
from pydantic import Field

from microvib.errors import MicrovibError
from microvib.export.contents import Densities, Phasors, densities, phasors
from microvib.export.source import Source, no_source, source_at_interface
from microvib.export.subject import Subject
from microvib.io.files import library
from microvib.io.tables import package_versions
from microvib.model.linear import CoupledMode, coupled_modes
from microvib.model.part import Part
from microvib.model.rigid import COMPONENTS
from microvib.model.scenario import Scenario
from microvib.solve.channels import SECOND_LOADS
from microvib.structures.deck import UNIT_SYSTEMS, UnitSystem

Content = Literal["lines", "time", "densities", "superelement"]
_WIDTH = 1e-4
"""Half width of a line in a table, over its frequency, at most."""
_GAP = 1.0 / 3.0
"""Half width over the distance to the next line, at most."""
_EDGE = 1e-4
"""Relative width of the edge of the first bin of a density."""
_MOST_IDS = 200
"""Numbers of sets and tables that a file takes, from the first on."""
_IDS_OF_WING = 100
"""Numbers from those of one wing to those of the next."""


class NastranOptions(Part):
    """Numbers, units and form of the cards."""

    contents: tuple[Content, ...] = Field(
        default=(),
        description="list of lines, time, densities, superelement; without it all but time, and on a"
        " fixed base alone the superelement",
    )
    grid: int = Field(default=1, ge=1, le=99_999_999, description="grid point of the interface")
    second_grid: int | None = Field(
        default=None,
        ge=1,
        le=99_999_999,
        description="grid point of a second wing's interface; its loads are left out without it, which"
        " only a held one allows",
    )
    coordinate_system: int | None = Field(
        default=None,
        ge=0,
        le=99_999_999,
        description="coordinate system of the loads (FORCE, MOMENT); without it that in which the grid"
        " point moves (DAREA)",
    )
    first_id: int = Field(
        default=1000,
        ge=1,
        le=99_999_000,
        description=f"first number of sets and tables, of which {_MOST_IDS} are taken",
    )
    first_scalar_point: int = Field(
        default=900_001,
        ge=1,
        le=99_000_000,
        description="first scalar point (SPOINT) of the superelement's own coordinates",
    )
    field: Literal["large", "small"] = Field(
        default="large", description="width of fields: large (16 characters) or small (8)"
    )
    units: UnitSystem = Field(default="SI", description=f"units: {', '.join(UNIT_SYSTEMS)}")
    drive: Literal["powered", "locked"] = Field(
        default="powered",
        description="hinge of the superelement: powered, held by its linearised drive, or locked",
    )


@dataclass(frozen=True)
class _Ids:
    """Numbers of sets and tables, from the first on."""

    first: int

    def load(self, component: int) -> int:
        """Set of a load by frequency; of all together with -1."""
        return self.first + 1 + component

    def place(self, component: int) -> int:
        """Set of the place where a unit load acts."""
        return self.first + 11 + component

    def table(self, component: int, imaginary: bool) -> int:
        """Table of a load by frequency."""
        return self.first + 21 + 2 * component + imaginary

    @property
    def frequencies(self) -> int:
        """Set of the lines' frequencies."""
        return self.first + 40

    @property
    def half_power(self) -> int:
        """Set of frequencies about the resonances."""
        return self.first + 41

    def in_time(self, component: int) -> int:
        """Set of a load by time; of all together with -1."""
        return self.first + 51 + component

    def time_table(self, component: int) -> int:
        """Table of a load by time."""
        return self.first + 61 + component

    @property
    def steps(self) -> int:
        """Set of the time steps."""
        return self.first + 70

    @property
    def random(self) -> int:
        """Set of the densities."""
        return self.first + 80

    def density_table(self, component: int) -> int:
        """Table of a density."""
        return self.first + 81 + component

    def unit_load(self, component: int) -> int:
        """Set of a unit load at all frequencies."""
        return self.first + 91 + component

    @property
    def unit_table(self) -> int:
        """Table of 1 at all frequencies."""
        return self.first + 99


class _Deck:
    """Cards as text, in the fields that are asked for."""

    def __init__(self, wide: bool) -> None:
        nastran = library("pyyeti.nastran")
        self._write: Callable[..., None] = nastran.wtcard16 if wide else nastran.wtcard8
        self._float: Callable[[float], str] = (
            nastran.bulk.format_float16 if wide else nastran.bulk.format_float8
        )
        self._wide, self.text = wide, io.StringIO()

    def comment(self, *lines: str) -> None:
        """Write comments, a line each, whatever breaks of lines a text has."""
        for line in lines:
            self.text.write(f"$ {' '.join(line.split())}\n")

    def card(self, name: str, *fields: Any) -> None:
        """Write a card; an empty text is an empty field."""
        self._write(self.text, [f"{name}*" if self._wide else name, *fields])

    def table(self, name: str, number: int, x: np.ndarray, y: np.ndarray) -> None:
        """Write a table of pairs, TABLED1 or TABRND1."""
        while (
            self._wide and _lines(x.size) % 2
        ):  # pyyeti does not read back a card with an empty line
            x, y = np.append(x, 2.0 * x[-1] - x[-2]), np.append(y, y[-1])
        pairs = [float(v) for pair in zip(x, y, strict=True) for v in pair]
        self.card(name, number, *("",) * 7, *pairs, "ENDT")

    def rounded(self, x: np.ndarray) -> np.ndarray:
        """Numbers as their fields have them."""
        return np.array([_number(self._float(float(v))) for v in x])


def _lines(pairs: int) -> int:
    """Lines of a wide table with so many pairs: four fields each, eight before the pairs, one after."""
    return -(-(9 + 2 * pairs) // 4)


def _number(text: str) -> float:
    """Value of a field of Nastran, whose exponent may stand without E."""
    text = text.strip()
    for k in range(len(text) - 1, 0, -1):
        if text[k] in "+-" and text[k - 1] not in "eE":
            return float(f"{text[:k]}e{text[k:]}")
    return float(text)


@dataclass(frozen=True)
class _Loads:
    """Loads of a wing at its grid point: numbers, channels, their places among the six components, and
    their factors into the deck's units."""

    ids: _Ids
    grid: int
    names: tuple[str, ...]
    components: tuple[int, ...]
    factors: np.ndarray

    @classmethod
    def of_wings(
        cls, scenario: Scenario, names: Sequence[str], options: NastranOptions
    ) -> tuple[_Loads, ...]:
        """Loads of the wings whose channels have these names; MicrovibError where a second wing that
        is driven has no grid point.
        """
        chosen: tuple[str, ...] = COMPONENTS
        places: tuple[int, ...] = tuple(range(6))
        if not set(COMPONENTS) <= set(names):  # T_d alone is known
            chosen, places = ("T_d",), (3 + "xyz".index(scenario.array.drive_axis),)
        force, moment = load_factors(options.units)
        factors = np.array([force if place < 3 else moment for place in places])
        first = cls(_Ids(options.first_id), options.grid, chosen, places, factors)
        if not set(SECOND_LOADS) <= set(names):
            return (first,)
        if options.second_grid is not None:
            ids = _Ids(options.first_id + _IDS_OF_WING)
            second = cls(ids, options.second_grid, tuple(SECOND_LOADS), places, factors)
            return (first, second)
        if scenario.driven_wing is not None:
            raise MicrovibError(
                "second_grid: missing; the second wing is driven, and its loads need the number of a"
                " grid point"
            )
        return (first,)

    def columns(self, names: Sequence[str], values: np.ndarray) -> np.ndarray:
        """Columns of these loads among ``values`` (k, channels), in the deck's units."""
        return np.asarray(values[:, [names.index(n) for n in self.names]] * self.factors)


def load_factors(units: UnitSystem) -> tuple[float, float]:
    """Force and moment of a unit system by those in SI."""
    length, mass = UNIT_SYSTEMS[units]
    return 1.0 / (mass * length), 1.0 / (mass * length**2)


def write_nastran(subject: Subject, path: Path, options: Any) -> None:
    """Write bulk data of a run.

    Raises
    ------
    MicrovibError
        Where the superelement is asked for and the array has no mass properties or the drive no current
        loop, a driven second wing has no grid point, or pyyeti is not installed.
    """
    deck, scenario = _Deck(options.field == "large"), subject.scenario
    chosen = options.contents or tuple(_without_asking(scenario))
    if "superelement" in chosen:
        _check_superelement(scenario, options)
    lines = phasors(subject.run)
    wings = _Loads.of_wings(scenario, [channel.name for channel in lines.channels], options)
    _comment_on_all(deck, subject, options)
    if {"lines", "time", "densities"} & set(chosen):
        _write_places(deck, wings, options)
    if "lines" in chosen:
        _write_lines(deck, wings, lines, coupled_modes(scenario))
    if "time" in chosen:
        _write_histories(deck, wings, subject)
    if "densities" in chosen:
        _write_densities(deck, wings, densities(subject.motion))
    if "superelement" in chosen:
        _write_superelement(
            deck, source_at_interface(scenario, options.drive == "powered"), options
        )
    path.write_text(deck.text.getvalue(), encoding="ascii", errors="replace", newline="\n")


def _without_asking(scenario: Scenario) -> Iterator[Content]:
    yield "lines"
    yield "densities"
    if scenario.spacecraft is None and scenario.array.mass is not None:
        yield "superelement"


def _check_superelement(scenario: Scenario, options: NastranOptions) -> None:
    """MicrovibError with what else can be written, where a scenario has no matrices."""
    refusal = no_source(scenario, options.drive == "powered")
    if refusal and scenario.array.mass is not None:
        refusal += (
            "; drive=locked has those of a locked hinge, contents=[lines, densities] loads alone"
        )
    if refusal:
        raise MicrovibError(refusal)


def _comment_on_all(deck: _Deck, subject: Subject, options: NastranOptions) -> None:
    scenario = subject.scenario
    if scenario.spacecraft is None:
        kind = (
            "blocked loads, of drive and array on a fixed base, in the array's axes",
            "apply them to the hub with drive and array on it (superelement), not to the bare hub",
        )
    else:
        kind = (
            "loads of drive and array as coupled to their hub, in hub axes",
            _receiver_in_words(scenario, options),
        )
    length, mass = UNIT_SYSTEMS[options.units]
    deck.comment(
        f"{scenario.title or 'drive'}: disturbance loads, by microvib {package_versions()['microvib']}",
        f"On the spacecraft at grid point {options.grid}: {kind[0]};",
        f"{kind[1]}.",
        f"Units {options.units}: length {length:g} m, mass {mass:g} kg, seconds.",
        "Amplitudes are 0-to-peak, phases those of a cosine at the first sample of the record.",
    )


def _receiver_in_words(scenario: Scenario, options: NastranOptions) -> str:
    """Where loads of a coupled run belong."""
    craft = scenario.spacecraft
    if craft is None or craft.second_wing is None:
        return "apply them to the bare hub, without drive and array"
    if options.second_grid is None:
        return "apply them to the hub with its second wing, without this drive and its array"
    return (
        f"those of the second wing act at grid point {options.second_grid}; apply both to the bare hub,"
        " without drives and arrays"
    )


def _write_places(deck: _Deck, wings: Sequence[_Loads], options: NastranOptions) -> None:
    """Unit loads at the grid points, a set each."""
    for wing in wings:
        for k, place in enumerate(wing.components):
            if options.coordinate_system is None:
                deck.card("DAREA", wing.ids.place(k), wing.grid, place + 1, 1.0)
                continue
            along = [float(place % 3 == axis) for axis in range(3)]
            name = "FORCE" if place < 3 else "MOMENT"
            deck.card(name, wing.ids.place(k), wing.grid, options.coordinate_system, 1.0, *along)


def _sets_of(wings: Sequence[_Loads], number: Callable[[_Ids, int], int]) -> list[float]:
    """Factors and sets of a DLOAD: all loads of all wings."""
    return [x for wing in wings for k in range(len(wing.names)) for x in (1.0, number(wing.ids, k))]


def _write_lines(
    deck: _Deck, wings: Sequence[_Loads], lines: Phasors, modes: Sequence[CoupledMode]
) -> None:
    names, ids = [channel.name for channel in lines.channels], wings[0].ids
    f = np.unique(deck.rounded(lines.frequency))
    if not f.size:
        raise MicrovibError("this run has no lines; there is nothing to write as RLOAD1")
    deck.comment(
        "", "Lines: DLOAD of RLOAD1, real and imaginary part; the loads are 0 between them."
    )
    deck.comment(
        f"FREQUENCY = {ids.frequencies} has the lines and no more, DLOAD = {ids.load(-1)}."
    )
    deck.card("DLOAD", ids.load(-1), 1.0, *_sets_of(wings, _Ids.load))
    for wing in wings:
        _write_loads_by_frequency(deck, wing, lines.frequency, wing.columns(names, lines.known))
    deck.comment("Lines")
    for one, frequency, forced in zip(lines.names, lines.frequency, lines.of_clock, strict=True):
        rings = "" if forced else ", not of the clock: it may ring and die away"
        deck.comment(f"{one}: {frequency:.9g} Hz{rings}")
    _write_frequencies(deck, ids.frequencies, f)
    points = sorted(
        {
            m.frequency * (1.0 + side * m.damping)
            for m in modes
            if m.frequency > 0.0
            for side in (-1.0, 0.0, 1.0)
        }
    )
    deck.comment(
        f"Resonances of drive and array with their half-power points, FREQUENCY = {ids.half_power}:"
    )
    deck.comment("for transfer functions by unit loads; the lines have no load there.")
    _write_frequencies(deck, ids.half_power, np.unique(deck.rounded(np.array(points))))


def _write_loads_by_frequency(
    deck: _Deck, wing: _Loads, frequency: np.ndarray, values: np.ndarray
) -> None:
    """RLOAD1 of each load of a wing, with its tables, by lines at ``frequency`` (k,)."""
    ids = wing.ids
    f, merged = _merged(deck.rounded(frequency), values)
    x, at = _triangles(f)
    for k, name in enumerate(wing.names):
        deck.comment(name)
        real, imaginary = ids.table(k, False), ids.table(k, True)
        deck.card("RLOAD1", ids.load(k), ids.place(k), "", "", real, imaginary, "LOAD")
        for number, part in ((real, merged[:, k].real), (imaginary, merged[:, k].imag)):
            y = np.zeros(x.size)
            y[at] = part
            deck.table("TABLED1", number, x, y)


def _write_frequencies(deck: _Deck, number: int, f: np.ndarray) -> None:
    for first in range(0, f.size, 7):  # a card without continuation
        deck.card("FREQ", number, *f[first : first + 7].tolist())


def _merged(f: np.ndarray, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Lines that fields make one, added."""
    at, place = np.unique(f, return_inverse=True)
    summed = np.zeros((at.size, values.shape[1]), dtype=complex)
    np.add.at(summed, place, values)
    return at, summed


def _triangles(f: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Frequencies of a table with a narrow triangle at each line, zeros beside it, and the lines'
    places.
    """
    gap = np.diff(f, prepend=0.0, append=2.0 * f[-1])
    half = np.minimum(_WIDTH * f, _GAP * np.minimum(gap[:-1], gap[1:]))
    x = np.concatenate([[0.0], np.column_stack([f - half, f, f + half]).ravel(), [2.0 * f[-1]]])
    return x, 2 + 3 * np.arange(f.size)


def _write_histories(deck: _Deck, wings: Sequence[_Loads], subject: Subject) -> None:
    motion, ids = subject.motion, wings[0].ids
    rate, count = motion.sample_rate, motion.time.size
    deck.comment(
        "",
        f"Histories: DLOAD = {ids.in_time(-1)}, TSTEP = {ids.steps}; time begins with the record.",
    )
    deck.card("DLOAD", ids.in_time(-1), 1.0, *_sets_of(wings, _Ids.in_time))
    t = np.arange(count + 2) / rate
    for wing in wings:
        for k, name in enumerate(wing.names):
            values, number = motion[name] * wing.factors[k], wing.ids.time_table(k)
            deck.comment(name)
            deck.card("TLOAD1", wing.ids.in_time(k), wing.ids.place(k), "", "LOAD", number)
            deck.table("TABLED1", number, t, np.append(values, [0.0, 0.0]))
    deck.card("TSTEP", ids.steps, count - 1, 1.0 / rate, 1)


def _write_densities(deck: _Deck, wings: Sequence[_Loads], found: Densities) -> None:
    f, ids = found.frequency[1:], wings[0].ids
    names = [channel.name for channel in found.channels]
    subcases = sum(len(wing.names) for wing in wings)
    deck.comment(
        "",
        f"Densities, one-sided: RANDOM = {ids.random}; subcases 1 to {subcases} with the unit loads below.",
        f"Bins of {f[0]:g} Hz ({found.window} window); a line is a peak of that width, whose area is its mean square.",
        "Loads count as unrelated: their cross densities are left out.",
    )
    edge = 0.5 * f[0]  # of the first bin
    ends = np.array([f[-1] + f[0], f[-1] + 2.0 * f[0]])
    x = np.concatenate([[0.0, (1.0 - _EDGE) * edge, edge], f, ends])
    each = [(wing, k) for wing in wings for k in range(len(wing.names))]
    for subcase, (wing, k) in enumerate(each, 1):
        name, own = wing.names[k], wing.ids
        deck.comment(f"{name}: subcase {subcase}, DLOAD = {own.unit_load(k)}")
        deck.card("RLOAD1", own.unit_load(k), own.place(k), "", "", ids.unit_table, "", "LOAD")
        deck.card("RANDPS", ids.random, subcase, subcase, 1.0, 0.0, own.density_table(k))
        values = found.values[names.index(name)][1:] * wing.factors[k] ** 2
        y = np.concatenate([[0.0, 0.0, values[0]], values, [0.0, 0.0]])
        deck.table("TABRND1", own.density_table(k), x, y)
    deck.table("TABLED1", ids.unit_table, np.array([0.0, 2.0 * f[-1]]), np.ones(2))


def _write_superelement(deck: _Deck, source: Source, options: NastranOptions) -> None:
    """Matrices of drive and array by the interface's motion and scalar points of their own (DMIG)."""
    nastran = library("pyyeti.nastran")
    pandas = library("pandas")
    matrices = source.matrices_in(options.units)
    own = options.first_scalar_point + np.arange(len(source.names))
    rows = [(options.grid, k + 1) for k in range(6)] + [(int(point), 0) for point in own]
    index = pandas.MultiIndex.from_tuples(rows, names=["id", "dof"])
    deck.comment(
        "",
        f"Drive and array at grid point {options.grid}, {options.drive} hinge, in {source.axes}.",
        "Case control: M2GG = MSRC, B2GG = BSRC, K2GG = KSRC",
        "Scalar points: "
        + ", ".join(f"{point} {name}" for point, name in zip(own, source.names, strict=True)),
    )
    if own.size:
        nastran.wtspoints(deck.text, own)
    frames = {
        name: pandas.DataFrame(0.5 * (matrix + matrix.T), index=index, columns=index)
        for name, matrix in zip(("MSRC", "BSRC", "KSRC"), matrices, strict=True)
        if np.any(matrix)
    }
    nastran.wtdmig(deck.text, frames)
