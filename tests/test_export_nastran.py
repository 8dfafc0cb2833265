"""Bulk data of Nastran: pyyeti reads it back, and it reproduces responses in closed form."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from support.tiers import sweep

import microvib as mv
from microvib.analysis.spectra import psd
from microvib.errors import MicrovibError
from microvib.export.contents import phasors
from microvib.export.source import source_at_interface
from microvib.export.subject import Subject, subject_of
from microvib.model.linear import coupled_modes
from microvib.model.rigid import COMPONENTS, rigid_motion_at
from microvib.structures.deck import UNIT_SYSTEMS

bulk = pytest.importorskip("pyyeti.nastran.bulk")
ode = pytest.importorskip("pyyeti.ode")

CRAFT = Path(__file__).parents[1] / "examples" / "spacecraft.yaml"
POSITION = np.array([0.3, -0.2, 0.7])
HUB = rigid_motion_at(POSITION)
HUB_MASS = np.diag([350.0, 350.0, 350.0, 70.0, 80.0, 60.0])


@pytest.fixture(scope="module")
def ground() -> Subject:
    """A run of drive and array of the craft on a fixed base."""
    scenario = mv.load_scenario(CRAFT).with_({"spacecraft": None, "record.duration": "4 s"})
    return subject_of(mv.run_scenario(scenario))


def exported(subject: Subject, folder: Path, **options: Any) -> Path:
    return mv.export_as(subject, "nastran", folder / "loads.bdf", **options)


def frequencies(path: Path, number: int) -> np.ndarray:
    cards = bulk.rdcards(str(path), "freq", return_var="list")
    values = [x for card in cards if card[0] == number for x in card[1:] if x not in ("", 0.0)]
    return np.unique(np.array(values, dtype=float))


def loads_at(path: Path, f: np.ndarray) -> np.ndarray:
    """Loads at the grid by its six components and frequency, (6, m), as a solver interpolates them."""
    cards = bulk.rdcards(str(path), "rload1", return_var="list")
    places = {int(card[0]): int(card[2]) for card in bulk.rdcards(str(path), "darea", return_var="list")}  # fmt: skip
    tables, found = bulk.rdtabled1(str(path)), np.zeros((6, f.size), dtype=complex)
    parts = next(
        card for card in bulk.rdcards(str(path), "dload", return_var="list") if int(card[0]) == 1000
    )
    used = {int(x) for x in parts[3::2] if x != ""}
    for card in cards:
        if int(card[0]) not in used:
            continue
        real, imaginary = (np.interp(f, *tables[int(card[k])].T) for k in (4, 5))
        found[places[int(card[1])] - 1] += real + 1j * imaginary
    return found


@pytest.mark.parametrize("units", ["SI", "mm-t-s", "in-lbf-s"])
@pytest.mark.parametrize("drive", ["powered", "locked"])
def test_cards_reproduce_the_response_of_a_hub(
    ground: Subject, units: str, drive: str, tmp_path: Path
) -> None:
    """Loads on drive and array (matrices) with a rigid hub: accelerations as in closed form, within 1e-6."""
    path = exported(ground, tmp_path, units=units, drive=drive, grid=77)
    f = frequencies(path, 1040)
    matrices = bulk.rddmig(str(path))
    rows = matrices["msrc"].index
    own = [row for row in rows if row[0] != 77]
    order = [(77, k) for k in range(1, 7)] + own
    length, mass = UNIT_SYSTEMS[units]
    scale = np.repeat([length, 1.0], 3)
    hub = (HUB.T @ HUB_MASS @ HUB) * np.outer(scale, scale) / (mass * length**2)
    M, C, K = (
        matrices[name].reindex(index=order, columns=order, fill_value=0.0).to_numpy(copy=True)
        if name in matrices
        else np.zeros((len(order), len(order)))
        for name in ("msrc", "bsrc", "ksrc")
    )
    M[:6, :6] += hub
    force = np.vstack([loads_at(path, f), np.zeros((len(own), f.size))])
    found = ode.FreqDirect(M, C, K).fsolve(force, f).a[:6] * scale[:, None]
    lines = phasors(ground.run)
    blocked = lines.known[:, [[c.name for c in lines.channels].index(n) for n in COMPONENTS]]
    source = source_at_interface(ground.scenario, drive == "powered").coupled
    AM = source.apparent_mass(lines.frequency) + HUB.T @ HUB_MASS @ HUB
    wanted = np.linalg.solve(AM, blocked[:, :, None])[:, :, 0].T
    order_of_lines = np.argsort(lines.frequency)
    assert f == pytest.approx(np.sort(lines.frequency), rel=1e-11)
    difference = np.abs(found - wanted[:, order_of_lines]).max(axis=0)
    assert np.all(difference < 1e-6 * np.abs(wanted[:, order_of_lines]).max(axis=0))


def test_between_and_beyond_lines_there_is_no_load(ground: Subject, tmp_path: Path) -> None:
    path = exported(ground, tmp_path, contents=["lines"])
    f = frequencies(path, 1040)
    between = np.concatenate([[0.01], 0.5 * (f[1:] + f[:-1]), [1.5 * f[-1]]])
    assert not np.any(loads_at(path, between))
    # Nastran goes on with the slope of the last two points beyond a table.
    for table in bulk.rdtabled1(str(path)).values():
        assert not np.any(table[[0, 1, -2, -1], 1])


def test_half_power_points_are_those_of_the_coupled_modes(ground: Subject, tmp_path: Path) -> None:
    path = exported(ground, tmp_path, contents=["lines"])
    f = frequencies(path, 1041)
    for mode in coupled_modes(ground.scenario):
        for side in (-1.0, 0.0, 1.0):
            assert np.min(np.abs(f / (mode.frequency * (1.0 + side * mode.damping)) - 1.0)) < 1e-10


def test_small_fields_hold_what_they_can(ground: Subject, tmp_path: Path) -> None:
    path = exported(ground, tmp_path, field="small", contents=["lines"])
    assert max(map(len, path.read_text().splitlines()[30:60])) <= 80
    f = frequencies(path, 1040)
    lines = phasors(ground.run)
    k = lines.names.index("drive_1")
    at = f[np.argmin(np.abs(f - lines.frequency[k]))]
    found = loads_at(path, np.array([at]))[:, 0]
    wanted = lines.known[k, [[c.name for c in lines.channels].index(n) for n in COMPONENTS]]
    assert np.max(np.abs(found - wanted)) < 1e-4 * np.max(np.abs(wanted))


def test_histories_and_densities(ground: Subject, tmp_path: Path) -> None:
    path = exported(ground, tmp_path, contents=["time", "densities"], units="mm-t-s")
    tables = bulk.rdtabled1(str(path))
    motion = ground.motion
    for k, (name, factor) in enumerate(zip(COMPONENTS, [1.0] * 3 + [1e3] * 3, strict=True)):
        table = tables[1061 + k]
        n = motion.time.size
        assert table[:n, 0] == pytest.approx(motion.time - motion.time[0], abs=1e-11)
        largest = np.abs(motion[name]).max()
        assert np.max(np.abs(table[:n, 1] - factor * motion[name])) < 1e-9 * factor * largest
        assert not np.any(table[n:, 1])
        assert table.shape[0] >= n + 2
        density = psd(motion, name)
        found = bulk.rdtabled1(str(path), "tabrnd1")[1081 + k]
        area = float(np.trapezoid(found[:, 1], found[:, 0]))
        mean_square = float(np.sum(density.density[1:]) * density.frequency[1])
        assert area == pytest.approx(factor**2 * mean_square, rel=1e-4)
    (step,) = bulk.rdcards(str(path), "tstep", return_var="list")
    assert step[1:3] == [motion.time.size - 1, pytest.approx(1.0 / motion.sample_rate)]
    assert len(bulk.rdcards(str(path), "randps", return_var="list")) == 6


def test_loads_in_a_coordinate_system_are_forces_and_moments(
    ground: Subject, tmp_path: Path
) -> None:
    path = exported(ground, tmp_path, contents=["lines"], coordinate_system=5, grid=12)
    (force, *_), (*_, moment) = (
        bulk.rdcards(str(path), name, return_var="list") for name in ("force", "moment")
    )
    assert force[1:7] == [12, 5, 1.0, 1.0, 0.0, 0.0]
    assert moment[1:7] == [12, 5, 1.0, 0.0, 0.0, 1.0]


SECOND = {
    "interface": {
        "position": ["0.35 m", "-0.9 m", "-0.2 m"],
        "drive_axis": [0, -1, 0],
        "reference": [1, 0, 0],
    }
}


@pytest.mark.parametrize("kind", sweep(["held", "driven"], "driven"))
def test_loads_of_a_second_wing_act_at_a_grid_point_of_their_own(kind: str, tmp_path: Path) -> None:
    changes = {"spacecraft.second_wing": SECOND | {"drive": kind}, "record.duration": "2 s"}
    subject = subject_of(mv.run_scenario(mv.load_scenario(CRAFT).with_(changes)))
    contents = ["lines", "time", "densities"]
    path = exported(subject, tmp_path, grid=77, second_grid=88, contents=contents)
    lines = phasors(subject.run)
    f = frequencies(path, 1040)
    names = [channel.name for channel in lines.channels]
    places = {int(c[0]): (int(c[1]), int(c[2])) for c in bulk.rdcards(str(path), "darea", return_var="list")}  # fmt: skip
    tables = bulk.rdtabled1(str(path))
    (dload,) = [c for c in bulk.rdcards(str(path), "dload", return_var="list") if c[0] == 1000]
    used = {int(x) for x in dload[3::2] if x != ""}
    cards = [c for c in bulk.rdcards(str(path), "rload1", return_var="list") if int(c[0]) in used]
    assert len(cards) == 12
    order = np.argsort(lines.frequency)
    for card in cards:
        grid, component = places[int(card[1])]
        name = COMPONENTS[component - 1] + {77: "", 88: "_2"}[grid]
        real, imaginary = (np.interp(f, *tables[int(card[k])].T) for k in (4, 5))
        wanted = lines.known[order, names.index(name)]
        assert np.max(np.abs(real + 1j * imaginary - wanted)) < 1e-9 * np.max(np.abs(wanted)), name
    (tload,) = [c for c in bulk.rdcards(str(path), "dload", return_var="list") if c[0] == 1050]
    assert len({int(x) for x in tload[3::2] if x != ""}) == 12
    assert len(bulk.rdcards(str(path), "randps", return_var="list")) == 12
    if kind == "driven":
        with pytest.raises(MicrovibError, match=r"^second_grid: missing; the second wing"):
            exported(subject, tmp_path, overwrite=True)
    else:
        text = exported(subject, tmp_path, overwrite=True).read_text()
        assert "apply them to the hub with its second wing" in text


def test_a_title_of_several_lines_stays_a_comment(ground: Subject, tmp_path: Path) -> None:
    titled = ground.scenario.model_copy(update={"title": "one\nGRID,1 <two>"})
    path = exported(Subject(titled, ground.result), tmp_path, contents=["lines"])
    assert path.read_text().startswith("$ one GRID,1 <two>: disturbance loads")


def test_a_run_with_torque_alone_loads_the_drive_axis(tmp_path: Path) -> None:
    run = mv.run_scenario(mv.load_scenario("state-1").with_({"record.duration": "2 s"}))
    path = exported(subject_of(run), tmp_path, contents=["lines"])
    (darea,) = bulk.rdcards(str(path), "darea", return_var="list")
    assert darea[1:4] == [1, 6, 1.0]
    with pytest.raises(MicrovibError, match=r"array\.rigid_body: missing"):
        mv.export_as(run, "nastran", tmp_path / "b.bdf", contents=["superelement"])
    assert not (tmp_path / "b.bdf").exists()
