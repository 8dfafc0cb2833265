"""One rule at every door: where a unit decides, text with a unit or an ``Si`` number is taken, and a bare number is refused."""

import math
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pytest
from scipy.io import savemat

import microvib as mv
from microvib.analysis.limits import Limit
from microvib.io.scenario_file import load_bench
from microvib.model.expected import expected_lines
from microvib.model.tracking import Leg, Tracking
from microvib.signals.spectrum import power_spectral_density, waterfall
from microvib.studies.angles import sweep_angles
from microvib.studies.orbit import analyse_orbit
from microvib.studies.rates import at_rate, plan_rates, rate_grid
from microvib.testdata.bench import Bench
from microvib.testdata.preparation import Preparation
from microvib.units import Si

RATE, TORQUE, HZ, SECONDS = (
    (math.radians(0.05), "0.05 deg/s"),
    (0.01, "10 mN*m"),
    (2.0, "2 Hz"),
    (3.0, "3 s"),
)

CRAFT = Path(__file__).parents[1] / "examples" / "spacecraft.yaml"
QUICK = {"record.settle": "0 s", "record.duration": "0.5 s", "record.sample_rate": "512 Hz"}


def rate_of_recording(given):
    """Of one that has no time axis."""
    with TemporaryDirectory() as folder:
        savemat(f"{folder}/bare.mat", {"Mz": np.zeros(64)})
        return mv.read_recording(f"{folder}/bare.mat", given).sample_rate


DOORS = {
    "with_": (RATE, lambda s, m, x: s.with_({"tracking.rate": x}).tracking.rate),
    "with_ of a group": (RATE, lambda s, m, x: s.with_(tracking={"rate": x}).tracking.rate),
    "load_scenario": (RATE, lambda s, m, x: mv.load_scenario("state-1", {"tracking.rate": x}).tracking.rate),
    "a part": (RATE, lambda s, m, x: Tracking(rate=x).rate),
    "a part in a part": (RATE, lambda s, m, x: Tracking(profile=(Leg(rate=x),)).profile[0].rate),
    "a part in data": (RATE, lambda s, m, x: Tracking(profile=[{"rate": x}]).profile[0].rate),
    "rate_grid": (RATE, lambda s, m, x: rate_grid(x, "0.06 deg/s", 3)[0]),
    "plan_rates": (RATE, lambda s, m, x: plan_rates(s, [x, "0.06 deg/s"], linear=True).cases[0].rate),
    "at_rate": (RATE, lambda s, m, x: at_rate(s, x, 16).rate),
    "limit of a plan": (TORQUE, lambda s, m, x: plan_rates(s, ["0.06 deg/s"], linear=True, limit=x).limit),
    "band of a plan": (HZ, lambda s, m, x: plan_rates(s, ["0.06 deg/s"], linear=True, band=(x, "5 Hz")).band[0]),
    "Limit": (TORQUE, lambda s, m, x: Limit(x).torque),
    "Limit.of": (TORQUE, lambda s, m, x: Limit.of(x, None).torque),
    "band of a limit": (HZ, lambda s, m, x: Limit("1 N*m", x).low),
    "density": (HZ, lambda s, m, x: power_spectral_density(m["T_d"], m.sample_rate, x).resolution),
    "waterfall": (HZ, lambda s, m, x: waterfall(m["T_d"], m.sample_rate, x).resolution),
    "expected_lines": (HZ, lambda s, m, x: 2.0 * len(expected_lines(s, x, 1)) / len(expected_lines(s, "2 Hz", 1))),
    "angles": ((math.radians(30.0), "30 deg"), lambda s, m, x: sweep_angles(mv.load_scenario(CRAFT, QUICK), [x]).angles[0]),
    "a recording's rate": (HZ, lambda s, m, x: rate_of_recording(x)),
    "preparation": (SECONDS, lambda s, m, x: Preparation(start=x).start),
    "bench": (SECONDS, lambda s, m, x: Bench(duration=x).duration),
}  # fmt: skip


@pytest.mark.parametrize("door", DOORS)
def test_one_rule_for_numbers(state_1, motion_1, door):
    (number, text), enter = DOORS[door]
    assert enter(state_1, motion_1, text) == pytest.approx(number, rel=1e-12)
    assert enter(state_1, motion_1, Si(number)) == pytest.approx(number, rel=1e-12)
    with pytest.raises(mv.MicrovibError, match="needs a unit, such as '"):
        enter(state_1, motion_1, number)
    for wrong in ("1 kg", "much", True, [1.0]):
        with pytest.raises(mv.MicrovibError):
            enter(state_1, motion_1, wrong)


@pytest.mark.parametrize("number", [0.05, "0.05"])
@pytest.mark.parametrize(
    "enter",
    [
        lambda s, x: s.with_({"tracking.rate": x}),
        lambda s, x: rate_grid(x, "0.06 deg/s", 3),
        lambda s, x: plan_rates(s, [x], linear=True),
        lambda s, x: at_rate(s, x, 16),
    ],
    ids=["scenario", "rate_grid", "plan_rates", "at_rate"],
)
def test_a_rate_without_a_unit_is_proposed_in_the_unit_that_people_mean(state_1, enter, number):
    with pytest.raises(mv.MicrovibError, match=r"needs a unit, such as '0\.05 deg/s'"):
        enter(state_1, number)


def test_angles_of_an_orbit_are_no_bare_numbers():
    craft = mv.load_scenario(CRAFT, QUICK)
    with pytest.raises(mv.MicrovibError, match=r"^angles: 1\.0 needs a unit, such as '1\.0 deg'"):
        analyse_orbit(craft, ["0 deg", 1.0])
    with pytest.raises(
        mv.MicrovibError, match="angles in this order are expected"
    ):  # read, and in the wrong order
        analyse_orbit(craft, ["30 deg", Si(0.0)])


def test_numbers_without_a_unit_need_none(state_1):
    assert state_1.with_({"tracking.clock_ratio": 0.994}).tracking.clock_ratio == 0.994
    assert load_bench("force-table") == load_bench("force-table")


def test_si_says_so_in_its_name(state_1):
    assert state_1.with_si({"tracking.rate": 0.001}).rate == 0.001
    assert state_1.with_si({"tracking.rate": 0.001}) == state_1.with_({"tracking.rate": Si(0.001)})


def test_bands_as_text_and_as_ends():
    assert (
        Limit.of("1 N*m", "0.5:5 Hz")
        == Limit.of("1 N*m", ("0.5 Hz", "5 Hz"))
        == Limit("1 N*m", "500 mHz", Si(5.0))
    )
    with pytest.raises(mv.MicrovibError, match=r"^band: '0\.5' needs a unit, such as '0\.5 Hz'$"):
        Limit.of("1 N*m", "0.5:5")


@pytest.mark.parametrize(
    ("key", "call"),
    [
        ("evidence", lambda s, r: mv.identify(s, r, ["reducer.stiffness"])),
        ("keys", lambda s, r: mv.identify(s, [r], "reducer.stiffness")),
        (
            "share",
            lambda s, r: mv.identify(s, [r], ["reducer.stiffness"], share="reducer.stiffness"),
        ),
        ("select", lambda s, r: mv.identify(s, [r], ["reducer.stiffness"], select="all")),
        ("rates", lambda s, r: mv.plan_rates(s, "0.06 deg/s")),
        ("microsteps", lambda s, r: mv.plan_rates(s, ["0.06 deg/s"], 16)),
        ("scenarios", lambda s, r: mv.simulate_many(s)),
    ],
)
def test_one_thing_is_not_taken_for_a_list(state_1, key, call):
    recording = mv.Recording({"Mz": np.zeros(64)}, Si(64.0), {"Mz": "N*m"})
    with pytest.raises(
        mv.ObjectError, match=rf"^{key}: .* is not a list; one is expected, such as \["
    ):
        call(state_1, recording)


WRONG = {
    "harmonics": (
        lambda s, m, x: mv.find_lines(m, harmonics=x),
        [-1, 2.5, "8", None, True, 10**400, np.zeros(2)],
    ),
    "harmonics of a run": (lambda s, m, x: mv.run_scenario(s, harmonics=x), [-1, None]),
    "harmonics of a steady state": (
        lambda s, m, x: mv.find_lines(s, start="steady", harmonics=x),
        [-1, None],
    ),
    "seeds": (lambda s, m, x: mv.run_scenario(s, seeds=x), [-1, "2", None]),
    "channel": (lambda s, m, x: mv.spectrum(m, x), [None, [], 3, np.zeros(2)]),
    "channel of lines": (lambda s, m, x: mv.find_lines(m, x), [None, [], 3]),
    "channel of a motion": (lambda s, m, x: m[x], [None, [], 3]),
    "channels": (lambda s, m, x: mv.simulate(s, channels=x), ["T_D", 3, [3]]),
    "line": (lambda s, m, x: mv.find_lines(m)[x], [None, np.zeros(2), 3]),
    "window": (lambda s, m, x: mv.spectrum(m, window=x), [[], None, "round"]),
    "key": (lambda s, m, x: s[x], [None, 3, []]),
    "changes": (lambda s, m, x: s.with_(x), ["reducer.stiffness", 3, [1], {3: "1"}]),
    "limit": (lambda s, m, x: Limit(x), [10**400, None, []]),
    "count": (lambda s, m, x: rate_grid("0.01 deg/s", "0.1 deg/s", x), [1, 2.5, "3", None]),
    "microsteps": (lambda s, m, x: plan_rates(s, ["0.06 deg/s"], x), [[], ["16"], [0], [2.5]]),
    "rates": (lambda s, m, x: plan_rates(s, x), [[]]),
    "table": (lambda s, m, x: mv.accuracy(m, x), [None, "lines", []]),
    "folder to read": (lambda s, m, x: mv.read_run(x), [None, 3, ""]),
    "scenario to write": (lambda s, m, x: mv.dump_scenario(x), [None, [], {}]),
    "drives": (lambda s, m, x: mv.pointing_budget(x), [None, 3]),
    "samples": (lambda s, m, x: mv.Recording(x, 4096.0), [None, "Mz", [np.zeros(8)]]),
    "units": (lambda s, m, x: mv.Recording({"Mz": np.zeros(8)}, 4096.0, x), [None, "N*m", ["N*m"]]),
    "data sheet": (lambda s, m, x: mv.new_scenario(holding_torque=x), [None, 0.5, [], True]),
    "phases": (lambda s, m, x: mv.new_scenario(phases=x), [None, 4, 2.5, []]),
}


@pytest.mark.parametrize("door", WRONG)
def test_what_is_of_no_use_is_refused_in_a_sentence(state_1, motion_1, door):
    enter, given = WRONG[door]
    quick = state_1.with_(QUICK)
    for wrong in given:
        with pytest.raises(mv.MicrovibError) as refused:
            enter(quick, motion_1, wrong)
        assert str(refused.value)
        assert "\n" not in str(refused.value)


def test_counts_and_ratios_of_a_data_sheet_may_be_numbers():
    given = mv.new_scenario(
        phases=3, microsteps=32, ratio=100, holding_torque="0.5 N*m", detent=0.04
    )
    assert given == mv.new_scenario(
        phases="3", microsteps="32", ratio="100", holding_torque="0.5 N*m", detent="4 percent"
    )
