"""What friction that sticks, and the sine of a motor's torque, make of other sources' loads: bounds against
integration in time, and in budgets."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from support.sticking_in_time import InTime, integrated, rms_in_band, without_line
from support.tiers import at_a_release
from support.turning_in_time import EXAMPLE, PLACE

import microvib as mv
from microvib.analysis.sticking import sticking_of
from microvib.io.file_access import WORKING_FOLDER
from microvib.model.drive_states import MAY_STICK, SLIDES, Sticking
from microvib.model.switching_friction import SwitchingFriction
from microvib.studies.budget.files import OtherSource, Requirement, Wheel, WheelHarmonic
from microvib.studies.budget.other_sources import contribution_of_other
from microvib.studies.budget.side_lines import SideLines, TurningDrives, anywhere_together
from microvib.studies.budget.sums import assess

STICKS = (Sticking(rotor=False, output=True), SLIDES)
TORQUE = np.array([0.0, 0.0, 0.0, 0.003, 0.01, 0.005])
BANDS = ((0.3, 400.0), (1.0, 400.0), (5.0, 400.0), (14.0, 16.0))
CONTROL = {f"array.modes.{i}.damping": 0.02 for i in range(4)}  # so that what rings dies away


@pytest.fixture(scope="module")
def example() -> mv.Scenario:
    return mv.load_scenario(EXAMPLE).with_({"motor.detent_torque": "0 N*m", **CONTROL})


def with_friction(
    scenario: mv.Scenario, microsteps: int, coulomb: float, breakaway: float
) -> mv.Scenario:
    return scenario.with_(
        {
            "driver.microsteps": microsteps,
            "friction.coulomb": f"{coulomb} N*m",
            "friction.breakaway": f"{breakaway} N*m",
        }
    )


def loaded(scenario: mv.Scenario, f: float, torque: np.ndarray) -> tuple[InTime, SideLines]:
    """Difference that a torque makes in time, and bounds on what it has beside its line."""
    turning = TurningDrives(scenario, STICKS)
    forces = turning.craft.on_hub(PLACE) @ torque
    side = turning.of_lines(np.array([f]), forces[None, :, None])
    assert side is not None
    found = integrated(scenario, f, forces, 30.0, 30.0)
    return found._replace(los=without_line(found.time, found.los, f)), side


def bound(side: SideLines, low: float, high: float) -> np.ndarray:
    """Root mean squares about x and y that may be in a band."""
    asked = [
        Requirement(name="a", metric="ape", axis=axis, lowest=f"{low} Hz", highest=f"{high} Hz", limit="1 rad")
        for axis in ("x", "y")
    ]  # fmt: skip
    return np.array([sum(one.largest(r) for one in side.anywhere) for r in asked])


@pytest.mark.long
@pytest.mark.parametrize(
    ("microsteps", "coulomb", "breakaway", "f"),
    [
        (8, 0.1, 0.1, 11.854), at_a_release(4, 0.3, 0.3, 7.7), at_a_release(8, 0.3, 0.3, 6.56),
        at_a_release(8, 0.1, 0.12, 11.854), (4, 0.3, 0.45, 5.3),
    ],
)  # fmt: skip
def test_no_more_is_beside_the_line_than_the_bound(example, microsteps, coulomb, breakaway, f):
    """Of a drive whose output sticks for a part of each step, in any band; and the bound by energy, which
    Coulomb friction has, is no more than a thousand times as much from 5 Hz up."""
    scenario = with_friction(example, microsteps, coulomb, breakaway)
    found, side = loaded(scenario, f, TORQUE)
    assert found.sticks > 0.02
    for low, high in BANDS:
        there = rms_in_band(found.time, found.los, low, high)
        assert np.all(there <= bound(side, low, high))
    if coulomb == breakaway:
        there = rms_in_band(found.time, found.los, 5.0, 400.0)
        assert np.all(bound(side, 5.0, 400.0) < 1000.0 * there)


@pytest.mark.long
def test_the_sine_of_the_motor_makes_no_more_than_the_bound(example):
    """Of a rotor that swings by some tenths of a radian (electrical), without friction."""
    f, smooth = 0.9216, {"driver.microsteps": 64, "reducer.ratio": 10.0}
    scenario = with_friction(example.with_(smooth), 64, 0.0, 0.0)
    found, side = loaded(scenario, f, 13.0 * TORQUE)
    (sine,) = side.anywhere
    assert "sine" in sine.why
    assert not side.unknown
    third = rms_in_band(found.time, found.los, 2.2, 3.2)
    assert third.max() > 1e-10
    assert np.all(third <= bound(side, 2.2, 3.2))
    assert bound(side, 2.2, 3.2).max() < 1000.0 * third.max()


@pytest.mark.long
@pytest.mark.parametrize(
    ("times", "slides"), [(800.0, False), (1500.0, True), at_a_release(3000.0, True)]
)
def test_friction_of_a_parked_drive_slides_by_the_loads_that_overcome_it(example, times, slides):
    """And makes no more of them than its bound, which is nothing while it holds the shaft."""
    scenario = with_friction(example, 16, 0.05, 0.05).with_({"tracking.rate": "0 deg/s"})
    found, side = loaded(scenario, 19.0, times * TORQUE)
    of_all = replace(side, anywhere=(*side.anywhere, *anywhere_together([side])))
    there = rms_in_band(found.time, found.los, 56.0, 58.0)
    most = bound(of_all, 56.0, 58.0)
    assert (there.min() > 1e-10) == slides
    assert np.all(there <= most)
    stands = "friction of a shaft that stands"
    assert any(one.why.startswith(stands) for one in of_all.anywhere) == slides


def source_of(kind: str, folder: Path) -> OtherSource:
    at = {"name": "cooler", "position": ["0.3 m", "-0.2 m", "0.5 m"]}
    table = folder / "table.csv"
    if kind == "lines":
        table.write_text("frequency_hz,my_n_m\n11.854,0.01\n")
        return OtherSource(**at, lines=str(table))
    if kind == "density":
        table.write_text("frequency_hz,my_n2_m2_hz\n11,1e-4\n12,1e-4\n")
        return OtherSource(**at, density=str(table))
    harmonic = WheelHarmonic(order=1.0, radial_torque="1e-6 N*m*s^2/rad^2")
    last = "720 rpm" if kind == "sweep" else None
    wheel = Wheel(speed="700 rpm", speed_to=last, axis=(0.0, 0.0, 1.0), harmonics=(harmonic,))
    return OtherSource(**at, wheel=wheel)


@pytest.mark.parametrize("kind", ["lines", "density", "wheel", "sweep"])
@pytest.mark.parametrize(
    "more",
    [{}, {"statistic": "bound"}, {"statistic": "level", "confidence": "99 percent"}, {"metric": "jitter", "window": "100 ms"}],
    ids=["rms", "bound", "level", "jitter"],
)  # fmt: skip
@pytest.mark.parametrize("breakaway", [0.1, 0.12])
def test_a_band_without_lines_does_not_pass_beside_a_drive_that_sticks(
    example, tmp_path, kind, more, breakaway
):
    """Where the limit is below what friction may make there; a drive that always slides passes, and so does
    one that sticks with a limit that is wide."""
    scenario = with_friction(example, 8, 0.1, breakaway)
    keys = {"name": "a", "metric": "ape", "lowest": "14.5 Hz", "highest": "15.1 Hz", **more}
    judged = {}
    for name, sticking in (("slides", (SLIDES, SLIDES)), ("sticks", STICKS)):
        one = contribution_of_other(source_of(kind, tmp_path), scenario, WORKING_FOLDER, sticking)
        judged[name] = assess(Requirement(**keys, limit="1e-11 rad"), [one], "rss")
        wide = assess(Requirement(**keys, limit="1 mrad"), [one], "rss")
        assert wide.verdict == "pass"
    assert judged["slides"].verdict == "pass"
    assert judged["sticks"].verdict == "not judged"
    assert any("friction that sticks" in why for why in judged["sticks"].why)
    assert judged["sticks"].value == judged["slides"].value
    assert judged["sticks"].least == 0.0


def test_a_narrow_band_between_looked_at_frequencies_has_its_part(example, tmp_path):
    """The bound does not depend on where the response was computed: in bands of 1 mHz it is about that of the
    decade around them, or less, and never nothing."""
    scenario = with_friction(example, 8, 0.1, 0.1)
    one = contribution_of_other(source_of("lines", tmp_path), scenario, WORKING_FOLDER, STICKS)
    (of_friction,) = (x for x in one.side.anywhere if "friction" in x.why)
    for low in np.random.default_rng(3).uniform(1.0, 300.0, 40):
        narrow = Requirement(name="a", metric="ape", lowest=f"{low} Hz", highest=f"{low + 1e-3} Hz", limit="1 rad")  # fmt: skip
        around = Requirement(name="a", metric="ape", lowest=f"{low / 3} Hz", highest=f"{low * 3} Hz", limit="1 rad")  # fmt: skip
        assert 0.0 < of_friction.largest(narrow) <= of_friction.largest(around)


def test_a_curve_limits_what_friction_makes(example, tmp_path):
    scenario = with_friction(example, 8, 0.1, 0.1)
    one = contribution_of_other(source_of("lines", tmp_path), scenario, WORKING_FOLDER, STICKS)
    verdicts = []
    for size in ("1e-11 rad", "1 mrad"):
        points = [{"frequency": "13 Hz", "amplitude": size}, {"frequency": "16 Hz", "amplitude": size}]  # fmt: skip
        r = Requirement(name="a", metric="ape", curve=points)
        verdicts.append(assess(r, [one], "rss").verdict)
    assert verdicts == ["not judged", "pass"]


def test_friction_that_falls_is_bounded_by_its_limits_or_in_a_steady_motion(example):
    """By energy where its torque never falls as its rate grows; else by its limits, which do not depend
    on the load, or, where the motion is a steady one, by four times the energy."""
    falls, steady = with_friction(example, 8, 0.1, 0.12), STICKS[0]._replace(repeats=True)
    by_energy, by_limits, of_steady = (
        SwitchingFriction(TurningDrives(one, (sticking, SLIDES)).craft)
        for one, sticking in (
            (with_friction(example, 8, 0.12, 0.12), STICKS[0]),
            (falls, STICKS[0]),
            (falls, steady),
        )
    )
    assert np.array_equal(by_limits.los(1e-6), by_limits.los(1e-3))
    assert np.all(by_energy.los(1e-6) <= by_limits.los(1e-6))
    np.testing.assert_allclose(of_steady.los(1e-9), 4.0 * by_energy.los(1e-9), rtol=1e-9)


def test_contacts_of_a_drive_that_stands_slide_by_any_load(example):
    parked = with_friction(example, 8, 0.1, 0.1).with_({"tracking.rate": "0 deg/s"})
    assert not TurningDrives(parked, (MAY_STICK, MAY_STICK)).friction.switches
    contacts = parked.with_({"friction.presliding": {"stiffness": "4000 N*m/rad"}})
    assert TurningDrives(contacts, (MAY_STICK, MAY_STICK)).friction.switches
    assert not TurningDrives(parked, (MAY_STICK, MAY_STICK)).unknown


class Shafts(dict[str, np.ndarray]):
    """Channels of a motion that is too short to tell rates over a turn."""

    time = np.zeros(1)

    def __init__(self, channels: dict[str, np.ndarray], scenario: mv.Scenario) -> None:
        super().__init__(channels)
        self.scenario = scenario


def test_a_shaft_that_nearly_stops_in_its_steps_is_not_turned_back_by_a_small_load(example):
    """A load that changes the rate by more than the least rate of the run makes it stick."""
    scenario = with_friction(example, 8, 0.02, 0.02)
    stands = {"stuck_rotor": np.zeros(2), "stuck_output": np.zeros(2)}
    rates = {"omega_m": np.array([0.02, 0.3]), "omega_l": np.array([1e-8, 2e-3])}
    sticking = sticking_of(Shafts({**stands, **rates}, scenario))
    assert not sticking.output
    forces = TurningDrives(scenario, STICKS).craft.on_hub(PLACE) @ TORQUE
    near, far = (
        TurningDrives(scenario, (one, SLIDES)).of_lines(np.array([11.0]), forces[None, :, None])
        for one in (sticking, sticking._replace(slowest_output=1.0))
    )
    assert any("turn it back" in why for why in near.unknown)
    assert not far.unknown
