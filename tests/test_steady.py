"""The steady state found directly: the same lines as time integration after it has settled, or a reason why not."""

import math
import re
from pathlib import Path

import numpy as np
import pytest
from support.run_reports import run_report, run_text
from support.scenarios import heavy_scenario, random_scenario, scenario_of_any_kind
from support.steady_lines import long_run, settled_motion, worst_deviation
from support.tiers import at_a_release, sweep

import microvib as mv
from microvib.analysis.limits import transient_warnings
from microvib.analysis.lines import steady_lines
from microvib.analysis.run import run_scenario
from microvib.analysis.start import steady_state_fallback_note
from microvib.model.expected import ExpectedLine
from microvib.model.record import PASSBAND
from microvib.reports.document import Text
from microvib.reports.outcome import Pairs
from microvib.reports.run.first_page import first_page
from microvib.signals.fourier_lines import TRANSIENT, lines_of_series
from microvib.signals.line_fit import estimate_lines
from microvib.solve.batch import simulate_torques
from microvib.solve.steady.period import NotPeriodic, PeriodMap, common_period
from microvib.solve.steady.recorded import KINK, NotDifferentiable, RecordedPeriod
from microvib.solve.steady.search import CONVERGED
from microvib.solve.steady.state import find_steady, steady_state
from microvib.studies.rates import plan_rates, rate_grid

EXAMPLES = Path(__file__).parents[1] / "examples"


@pytest.fixture(scope="module")
def steady_1(state_1):
    return steady_state(state_1)


def settled(scenario, time=90.0, duration=16.0):
    return scenario.with_si({"record.settle": time, "record.duration": duration})


@pytest.mark.parametrize("name", ["state-1", "state-2", "state-3", "state-4", "state-5"])
def test_lines_are_those_of_the_settled_run_in_time(name):
    scenario = settled(mv.load_scenario(name))
    steady, in_time = (
        mv.find_lines(steady_state(scenario)),
        mv.find_lines(mv.simulate(scenario, channels=("T_d",))),
    )
    compared = 0
    for line in in_time:
        if (
            line.kind in ("array mode", "other")
            or not line.amplitude > 1e-3 * in_time["drive_1"].amplitude
        ):
            continue
        other = steady[line.name]
        compared += 1
        assert other.frequency == pytest.approx(line.frequency, rel=1e-6)
        assert other.amplitude == pytest.approx(line.amplitude, rel=0.01), line.name
        assert math.remainder(other.phase - line.phase, 2 * math.pi) == pytest.approx(
            0.0, abs=0.02
        ), line.name
        assert other.bin_amplitude == pytest.approx(line.bin_amplitude, rel=0.02, abs=2e-5), (
            line.name
        )
    assert compared > 20
    assert steady["array_mode_1"].status == TRANSIENT


@pytest.mark.parametrize("seed", sweep([4, 14, 31, 45, 52], 14))
def test_lines_of_random_sets_are_those_of_the_run_in_time(seed):
    scenario = random_scenario(seed)
    deviation, line = worst_deviation(steady_state(scenario), settled_motion(scenario))
    assert deviation < 0.01, line


@pytest.mark.parametrize(
    "changes",
    [
        {"driver.beats": 6, "driver.microsteps": 5},  # a quarter turn is not a whole number of microsteps
        {"driver.microsteps": 1},
        {"driver.integral_gain": 0.0, "driver.supply_voltage": 8.0},
        {"reducer.stiffness": "rigid"},
        {"reducer.transmission_error": [{"order": 200, "amplitude": "2 arcsec"}]},  # repeats with the detent torque
        {"friction.slip_ring.contact_pairs": 0, "friction.coulomb": 0, "friction.breakaway": 0},
        {"array.modes": [], "array.rigid_inertia": None},
    ],
)  # fmt: skip
def test_every_part_of_the_drive_is_in_the_steady_state(state_1, changes):
    scenario = settled(state_1.with_si({"tracking.rate": "-0.11 deg/s", **changes}), 60.0)
    steady, in_time = (
        mv.find_lines(steady_state(scenario)),
        mv.find_lines(mv.simulate(scenario, channels=("T_d",))),
    )
    top = max(line.amplitude for line in steady if line.amplitude > 0)
    compared = 0
    for line in in_time:
        if line.kind not in ("array mode", "other") and line.amplitude > 0.01 * top:
            compared += 1
            assert steady[line.name].amplitude == pytest.approx(line.amplitude, rel=0.01), line.name
    assert compared >= 4


def test_the_state_repeats_after_a_period_and_after_a_record(state_1, steady_1):
    period = PeriodMap(state_1, steady_1.microsteps)
    after = period.advance(steady_1.state)
    assert np.max(np.abs(after - steady_1.state) / period.sizes) < CONVERGED
    assert steady_1.distance < CONVERGED
    assert 0.9 < steady_1.multiplier < 1.0  # the array mode
    record = mv.find_lines(steady_1.motion(channels=("T_d",)))
    assert (
        record["array_mode_1"].amplitude < 1e-5
    )  # it does not ring: 4.6e-3 after a start from rest
    assert record["drive_1"].amplitude == pytest.approx(
        mv.find_lines(steady_1)["drive_1"].amplitude, rel=1e-3
    )


def test_a_record_from_the_steady_state_is_whole_from_its_first_sample(state_1):
    # many microsteps within the filter's length, and a record that starts with the command
    fast = state_1.with_si(
        {
            "tracking.rate": "0.3 deg/s",
            "driver.microsteps": 64,
            "record": {"settle": 0.0, "duration": 1.0, "sample_rate": 1024.0},
        }
    )
    state = steady_state(fast)
    motion = state.motion(channels=("T_d",))
    series = state.harmonics()[: int(0.34 * fast.record.sample_rate / state.frequency)]
    t = motion.time[:40] - fast.record.settle
    made = (
        np.exp(2j * np.pi * state.frequency * np.outer(t, np.arange(series.size))) @ series
    ).real
    assert motion["T_d"][:40] == pytest.approx(made, abs=5e-4 * np.max(np.abs(made)))


@pytest.mark.parametrize(
    "changes",
    [
        {"tracking.rate": "0.00526 deg/s"},
        {"tracking.rate": "0.01292 deg/s", "reducer.stiffness": "rigid"},
        {
            "tracking.rate": "0.001656 deg/s",
            "friction.slip_ring": None,
            "friction.coulomb": "0.02 N*m",
            "friction.breakaway": "0.02 N*m",
            "array": {"inertia": "0.25 kg*m^2", "modes": []},
        },
    ],
)
def test_lines_do_not_depend_on_the_sample_rate(state_1, changes):
    """The drive swings faster after each full step than half of these sample rates."""
    steps = state_1.with_({"driver.microsteps": 1, **changes})
    lines = {}
    for rate in ("24 Hz", "4096 Hz"):
        table = mv.find_lines(steps.with_({"record.sample_rate": rate}), start="steady")
        assert "steady" in table.source
        lines[rate] = {
            x.name: x.amplitude for x in table if x.kind == "drive" and x.amplitude > 0.0
        }
    assert len(lines["24 Hz"]) >= 4
    for name, amplitude in lines["24 Hz"].items():
        assert amplitude == pytest.approx(lines["4096 Hz"][name], rel=5e-4)


def test_the_start_of_the_search_does_not_matter(state_1, steady_1, monkeypatch):
    guess = PeriodMap.guess
    random = np.random.default_rng(5)

    def elsewhere(self):
        return guess(self) + 5.0 * random.normal(size=self.sizes.size) * self.sizes

    monkeypatch.setattr(PeriodMap, "guess", elsewhere)
    for _ in range(3):
        other = steady_state(state_1)
        assert other.microsteps == steady_1.microsteps
        found = [
            (line.name, line.amplitude) for line in mv.find_lines(other) if line.kind == "drive"
        ]
        assert [amplitude for _, amplitude in found] == pytest.approx(
            [mv.find_lines(steady_1)[name].amplitude for name, _ in found], rel=2e-3, abs=1e-6
        )


def test_invariants_hold_over_the_period(steady_1):
    i = steady_1.invariants
    assert i.torque_forms < 1e-12
    assert i.momentum < 1e-4
    assert i.energy_mechanical < 1e-3
    assert abs(i.energy_stored) < 1e-3 * i.energy_dissipated  # what repeats stores nothing
    assert abs(steady_1.harmonics()[0]) < 1e-4 * abs(
        steady_1.harmonics()[16]
    )  # nor does it gather momentum


def test_a_mode_without_damping_has_a_steady_state_all_the_same(state_1):
    state = steady_state(state_1.with_si({"array.modes.0.damping": 0.0}))
    assert 0.97 < state.multiplier < 1.001


@pytest.mark.parametrize(
    ("changes", "why"),
    [
        ({"tracking.rate": 0.0}, "the rate is zero"),
        (
            {"tracking": {"profile": [{"rate": 0.001, "ramp": 5.0, "hold": 1.0}, {"rate": 0.002, "ramp": 4.0}]}},
            "the rate changes in the record",
        ),
        ({"friction.position": {"harmonics": [{"order": 1, "amplitude": 0.05}]}}, "does not repeat with the command"),
    ],
)  # fmt: skip
def test_where_nothing_repeats_it_falls_back_to_time_integration(state_1, changes, why):
    scenario = state_1.with_si({"record.settle": 4.0, "record.duration": 3.0, **changes})
    with pytest.raises(NotPeriodic, match=why):
        steady_state(scenario)
    with pytest.raises(NotPeriodic, match=r"friction\.torque_noise: null leaves it out"):
        steady_state(state_1.with_si({"friction.torque_noise": {"density": 1e-6}}))
    result = steady_lines(scenario)
    assert result.state is None
    assert result.fallback
    assert result.lines.text() == mv.find_lines(simulate_torques([scenario])[0]).text()
    found, simulated = (
        [x.amplitude for x in table]
        for table in (result.lines, mv.find_lines(mv.simulate(scenario)))
    )
    assert found == pytest.approx(simulated, rel=1e-3, abs=1e-7, nan_ok=True)


@pytest.mark.parametrize(
    "scenario",
    [
        random_scenario(
            40
        ),  # stick and slip take several microsteps in turn; how many is settled at the start
        # Where this output is wound back, long and short slips alternate, and go on to: a run from rest does so, too.
        mv.load_scenario("state-1").with_({"tracking.rate": "0.01 deg/s", "driver.microsteps": 32}),
        random_scenario(
            30
        ),  # friction that falls with the rate: smooth slip, and an oscillation that sticks
        at_a_release(heavy_scenario(327)),
        at_a_release(heavy_scenario(436)),
        scenario_of_any_kind(36),  # slips that vary repeat after seven periods of the command
    ],
)
def test_of_several_motions_the_one_that_a_start_from_rest_leads_to_is_found(scenario):
    state = steady_state(scenario)
    deviation, line = worst_deviation(state, settled_motion(scenario))
    assert deviation < 0.01, line


@pytest.mark.parametrize(
    ("seed", "why"),
    [
        (
            51,
            "no periodic steady state from rest",
        ),  # small deviations grow, though its derivative does not show it
        (
            18,
            r"negative friction slope .* sustains the ringing: .* 3\d\d s .*, 1\d\.\d s by the modes' own damping",
        ),
    ],
)
def test_a_motion_that_no_run_shows_is_not_taken(seed, why):
    scenario = heavy_scenario(seed)
    with pytest.raises(NotPeriodic, match=why):
        steady_state(scenario)


def test_a_motion_of_whose_stability_nothing_is_known_is_not_taken():
    """Derivatives grow by 1e26 over the period, beside which other directions are not seen."""
    tracking = {"rate": 0.0005222569844779746, "clock_ratio": 1.0}
    scenario = scenario_of_any_kind(1).with_si({"tracking": tracking})
    state, why = find_steady(scenario)
    assert why or np.isfinite(state.multiplier)


SELF_EXCITED = {
    "array": {"inertia": 16.3168, "modes": [{"frequency": 4.4206, "damping": 0.032597, "effective_inertia": 16.12997}]},
    "driver": {"beats": 6, "microsteps": 32, "proportional_gain": 274.687, "integral_gain": 2702.605},
    "friction": {
        "coulomb": 0.0621277, "breakaway": 0.1794738, "stribeck_rate": 9.16418e-05, "stribeck_shape": 1.0, "viscous": 0.66957,
    },
    "motor": {
        "phases": 3, "rotor_teeth": 50, "current": 0.894819, "torque_constant": 0.157064, "detent_torque": 0.00554932,
        "winding_resistance": 5.02129, "winding_inductance": 0.0128789, "rotor_inertia": 3.9472e-05,
        "friction": {
            "coulomb": 0.00105537, "breakaway": 0.00110551, "stribeck_rate": 0.0125231, "viscous": 0.00311438,
        },
    },
    "reducer": {"ratio": 80.0, "stiffness": 10718.1, "damping": 0.454445, "wave_generator_inertia": 5e-06},
    "tracking": {"rate": 0.00089070937},
    "record": {"settle": 60.0, "duration": 16.0, "sample_rate": 2048.0},
}  # fmt: skip
"""Smooth slip is stable; from rest friction that falls with the rate keeps the mode ringing, as large as it was at the start."""


def test_a_mode_that_friction_keeps_ringing_is_no_steady_state(state_1):
    scenario = state_1.with_si({**SELF_EXCITED, "sources": {}, "source": ""})
    with pytest.raises(NotPeriodic, match="no periodic steady state from rest"):
        steady_state(scenario)
    late = mv.find_lines(simulate_torques([scenario.with_si({"record.settle": 300.0})])[0])
    rings = max((x for x in late if x.frequency < 3.3), key=lambda x: x.amplitude)
    assert rings.amplitude == pytest.approx(0.385, rel=0.03)
    assert rings.frequency == pytest.approx(2.87, abs=0.02)
    found = max(mv.find_lines(scenario, start="steady"), key=lambda x: x.amplitude)
    assert found.amplitude == pytest.approx(rings.amplitude, rel=0.03)


SMOOTH = [
    (4, 2.026e-3, 10199.0, 0.7712, 0.04937281031371583),
    (8, 2.01e-3, 3149.8, 0.3531, 0.035468),
    (8, 0.6966e-3, 6204.0, 0.8283, 0.0445651),
]
"""Microsteps, detent torque [N m], stiffness [N m/rad] and damping [N m s/rad] of the reducer and rates
[deg/s] of drives that turn smoothly or ring, each for good.
"""


@pytest.mark.parametrize("drive", SMOOTH)
def test_a_drive_that_keeps_ringing_does_not_turn_smoothly(drive):
    """Neither where smooth turning is found first nor where a run from rest is followed."""
    names = ("driver.microsteps", "motor.detent_torque", "reducer.stiffness", "reducer.damping")
    scenario = mv.load_scenario("state-1").with_si(
        {
            **dict(zip(names, drive, strict=False)),
            "driver.microstep_ramp": 1.0,
            "tracking.rate": math.radians(drive[-1]),
            "record.duration": 16.0,
        }
    )
    for confirmed in (False, True):
        with pytest.raises(NotPeriodic):
            steady_state(scenario, confirmed=confirmed)
    late = mv.find_lines(simulate_torques([scenario.with_si({"record.settle": 300.0})])[0])
    assert max(x.amplitude for x in late if 10.0 < x.frequency < 60.0) > 0.01


@pytest.mark.parametrize(
    "name", sweep(["state-1", "state-2", "state-3", "state-4", "state-5"], "state-1", "state-4")
)
def test_what_is_found_does_not_depend_on_the_settling_time(name):
    state = mv.load_scenario(name)
    for factor in (0.999, 1.0, 1.001):
        turning = state.with_si({"tracking.rate": factor * float(state.tracking.rate)})
        given = np.append(np.linspace(30.0, 30.33, 6), 57.3)
        found = [steady_state(turning.with_si({"record.settle": float(x)})) for x in given]
        size = float(np.std(found[0].T_d))
        for other in found[1:]:
            assert other.microsteps == found[0].microsteps
            assert (
                np.max(np.abs(np.abs(other.harmonics()) - np.abs(found[0].harmonics())))
                < 1e-5 * size
            )


TRANSMISSION_ERROR = {"reducer.transmission_error": [{"order": 2, "amplitude": 1e-4, "phase": 0.4}]}
PRESLIDING = {"friction.presliding": {"stiffness": 6000.0, "elements": 4}, "solver.refinement": 2}
BACKLASH = {"reducer.backlash": 2e-4}


@pytest.mark.parametrize(
    "changes",
    [
        TRANSMISSION_ERROR,
        at_a_release({**TRANSMISSION_ERROR, "reducer.stiffness": "rigid"}),
        PRESLIDING,
        {"reducer.hysteresis": {"loss": 2e-5, "stiffness": 4000.0}},
        BACKLASH,
        at_a_release(
            {
                **TRANSMISSION_ERROR,
                **PRESLIDING,
                "driver.imperfections": {"gain_b": 0.02, "offset_a": 0.01},
            }
        ),
    ],
)
def test_long_periods_and_frictions_with_memory_have_the_steady_state_of_a_run_from_rest(
    state_1, changes
):
    scenario = state_1.with_si({**changes, "record.sample_rate": 1024.0})
    state = steady_state(scenario)
    deviation, line = worst_deviation(state, settled_motion(scenario))
    assert deviation < 0.01, line
    record = state.motion(channels=("T_d",))["T_d"]  # goes on with what the frictions remember
    series = state.harmonics()[: int(0.35 * 1024.0 / state.frequency)]
    t = np.arange(2000) / 1024.0
    made = (
        np.exp(2j * np.pi * state.frequency * np.outer(t, np.arange(series.size))) @ series
    ).real
    ours, theirs = (np.abs(np.fft.rfft(x * np.hanning(2000)))[:600] for x in (record[:2000], made))
    assert ours == pytest.approx(theirs, abs=0.01 * float(np.max(theirs)))
    assert abs(state.invariants.energy_stored) < 1e-3 * state.invariants.energy_dissipated


@pytest.mark.release
def test_a_slow_mode_beside_a_friction_with_memory_is_waited_for(state_1):
    scenario = state_1.with_si(
        {"friction.presliding": {"stiffness": 1e5}, "array.modes.0.damping": 0.0014}
    )
    decay = min(m.decay for m in mv.coupled_modes(scenario) if m.frequency > 0.0)
    state = steady_state(scenario)
    assert state.solver["simulated_s"] < 10.0 / decay
    settled = {
        "record.settle": 7.0 / decay,
        "record.duration": math.ceil(16.0 * state.frequency) / state.frequency,
    }
    [run] = simulate_torques([scenario.with_si(settled)])
    assert np.std(state.T_d) == pytest.approx(np.std(run.T_d), rel=1e-3)
    wanted = {line.name: line.amplitude for line in mv.find_lines(run)}
    driving = [
        line
        for line in mv.find_lines(state)
        if line.name in ("drive_1", "drive_2", "full_step_1", "drive_1_minus_1")
    ]
    assert len(driving) == 4
    for line in driving:
        assert line.amplitude == pytest.approx(wanted[line.name], rel=2e-3)


@pytest.mark.release
def test_a_harmonic_gear_from_the_data_sheet_has_a_steady_state_over_a_chart_of_rates():
    scenario = mv.new_scenario(gear="size 14 ratio 100")
    assert any(error.amplitude > 0.0 for error in scenario.reducer.errors)
    plan = plan_rates(scenario, rate_grid("0.05 deg/s", "0.08 deg/s", 2))
    assert plan.cases
    assert not [case.reason for case in plan.cases if case.reason]


@pytest.mark.parametrize("name", ["state-1", "state-3"])
def test_a_deviation_that_is_as_linear_as_a_small_one_is_not_waited_for(name):
    scenario = mv.load_scenario(name)
    decay = min(m.decay for m in mv.coupled_modes(scenario) if m.frequency > 0.0)
    quick, waited = (steady_state(scenario, confirmed=confirmed) for confirmed in (False, True))
    assert quick.solver["from_rest_s"] < 0.5 / decay
    assert waited.solver["from_rest_s"] > 2.0 / decay
    assert np.array_equal(quick.T_d, waited.T_d)


@pytest.mark.parametrize(
    "scenario",
    [
        heavy_scenario(9),
        at_a_release(heavy_scenario(16)),
        at_a_release(heavy_scenario(36)),
        scenario_of_any_kind(
            170
        ),  # on its way to slips that repeat after five periods it is linear for one of them
    ],
)
def test_a_start_from_rest_that_leads_elsewhere_is_seen_before_it_is_there(scenario):
    """Small deviations from the motion that the search finds die out; that of a start from rest is none, and stays."""
    quick, waited = (find_steady(scenario, confirmed=confirmed) for confirmed in (False, True))
    assert (quick[0] is None) == (waited[0] is None)
    if quick[0] is not None:
        assert "from_rest_s" not in quick[0].solver
        assert float(np.std(quick[0].T_d)) == pytest.approx(float(np.std(waited[0].T_d)), rel=0.01)


@pytest.mark.release
def test_friction_heavy_sets_that_are_found_are_what_a_run_from_rest_shows():
    found = []
    for seed in range(1, 12):
        try:
            found.append(steady_state(heavy_scenario(seed)))
        except NotPeriodic:
            continue
    assert len(found) >= 5
    for state, run in zip(found, simulate_torques([long_run(x) for x in found]), strict=True):
        assert float(np.std(run.T_d)) == pytest.approx(float(np.std(state["T_d"])), rel=0.03)


def test_a_step_on_the_way_to_an_event_is_held_to_its_tolerance_too():
    """Friction that falls steeply makes a step singular at one length: shortened to it, the rotor would jump, lose its synchronism."""
    long = heavy_scenario(27).with_si({"record.settle": 0.0, "record.duration": 140.0})
    expected = float(
        np.std(mv.simulate(long.with_si({"solver.accuracy": 2.5e-5}), channels=("T_d",))["T_d"])
    )
    assert float(np.std(mv.simulate(long, channels=("T_d",))["T_d"])) == pytest.approx(
        expected, rel=1e-3
    )
    assert float(np.std(simulate_torques([long])[0].T_d)) == pytest.approx(expected, rel=1e-3)


def test_a_run_that_was_to_be_steady_and_is_not_says_so_first_and_advises_no_steady_start(state_1):
    position = {"harmonics": [{"order": 1, "amplitude": 0.05}]}
    record = {"settle": 4.0, "duration": 3.0, "sample_rate": 1024.0, "start": "steady"}
    scenario = state_1.with_si({"friction.position": position, "record": record})
    result = run_scenario(scenario)
    said = r"No steady state: friction that varies .* \(friction\.position: null leaves it out\)\. Simulated from rest instead\."
    assert re.search(said, run_text(result))
    first = " ".join(
        block.text
        for block in run_report(result.motion, result.table).first_page
        if isinstance(block, Text)
    )
    assert re.search(said, first)
    for of_motion in (mv.simulate(scenario), result.motion):
        assert re.search(said, steady_state_fallback_note(of_motion.solver))
    rings = [text for text in transient_warnings(result.table, scenario) if "decays" in text]
    assert rings
    assert not [text for text in rings if "steady" in text.replace("steady line", "")]
    from_rest = scenario.with_({"record.start": "rest"})
    assert [
        text
        for text in transient_warnings(result.table, from_rest)
        if text.endswith("or record.start: steady.")
    ]


def test_a_drive_that_does_not_move_has_no_steady_state(state_1):
    """Its torque is zero throughout, which nothing is relative to."""
    held = {"coulomb": "0.006 N*m", "breakaway": "0.2 N*m"}
    stuck = state_1.with_(
        {f"motor.friction.{key}": value for key, value in held.items()}
        | {"tracking.rate": "0.003 deg/s"}
    )
    state, why = find_steady(stuck)
    assert state is None
    assert "loss of synchronism" in why


def test_the_common_period_that_is_too_long_is_named_with_what_makes_it_so(state_1):
    errors = [{"order": 7, "amplitude": 1e-5}, {"order": 3, "amplitude": 1e-5}]
    slow = {
        "reducer.transmission_error": errors,
        "driver.microsteps": 4096,
        "tracking.rate": math.radians(1e-3),
    }
    with pytest.raises(
        NotPeriodic,
        match=r"common period .* microsteps .*reducer\.transmission_error: \[\] removes",
    ):
        steady_state(state_1.with_si(slow))


def test_repetition_in_microsteps(state_1):
    def of(**changes):
        return common_period(
            state_1.with_si({key.replace("__", "."): value for key, value in changes.items()})
        )

    assert of() == (16, 16)
    assert of(driver__beats=5, driver__microsteps=1) == (5, 5)
    assert of(driver__beats=6, driver__microsteps=1) == (3, 3)
    assert of(reducer__transmission_error=[{"order": 400, "amplitude": 1e-6}]) == (16, 16)
    assert of(reducer__transmission_error=[{"order": 2, "amplitude": 1e-6}]) == (1600, 16)


def test_lines_of_a_series_are_those_of_its_samples():
    base, rate, n = 3.31, 1024.0, 16_384
    series = np.zeros(40, dtype=complex)
    series[[0, 1, 16, 17, 32]] = 0.7, 0.02j, 0.3 - 0.2j, 0.05, 0.01 - 0.04j
    t = np.arange(n) / rate
    x = sum((a * np.exp(2j * np.pi * k * base * t)).real for k, a in enumerate(series))
    expected = [
        ExpectedLine(name, "drive", k * base, k * base, k * base, "made")
        for name, k in (("slow", 1), ("drive_1", 16), ("drive_2", 32))
    ]
    exact, estimated = (
        lines_of_series(series, base, 16, expected, n, rate),
        estimate_lines(x, rate, expected),
    )
    assert [line.name for line in exact] == ["slow", "drive_1", "drive_2", "other_1"]
    assert exact["other_1"].origin == "17/16 of the driving frequency"
    for line in exact:
        other = estimated[line.name]
        assert other.amplitude == pytest.approx(line.amplitude, rel=1e-3)
        assert other.phase == pytest.approx(line.phase, abs=1e-3)
        assert other.bin_frequency == line.bin_frequency
        assert other.bin_amplitude == pytest.approx(line.bin_amplitude, rel=1e-4)


def test_an_order_beside_an_array_mode_is_left_where_no_line_names_it():
    """The line nearest to a mode is the one that the mode amplifies: it counts against a limit."""
    series = np.zeros(40, dtype=complex)
    series[[11, 16]] = 0.002, 0.3
    expected = [
        ExpectedLine("drive_1", "drive", 16.0, 16.0, 16.0, "made"),
        ExpectedLine("array_mode_1", "array mode", 11.003, 10.9, 11.1, "made"),
    ]
    table = lines_of_series(series, 1.0, 16, expected, 1024, 64.0)
    assert [line.name for line in table] == ["drive_1", "array_mode_1"]
    assert table.rest.within(10.9, 11.1) == (11.0, pytest.approx(0.002))


def test_attitude_control_does_not_swing_in_a_steady_state_that_a_run_settled_to():
    """Stick-slip with references in steps of a converter, which is followed from rest until its
    torque repeats: the hub swung by 46 nrad at 0.009 Hz still.
    """
    craft = mv.load_scenario(EXAMPLES / "spacecraft.yaml").with_(
        {
            "tracking.rate": "0.3 deg/s",
            "driver.microsteps": 2,
            "driver.imperfections": {"dac_bits": 9, "gain_b": -0.05},
            "motor.current": "0.5 A",
            "motor.detent_torque": "0.002 N*m",
            "reducer.damping": "1.5 N*m*s/rad",
            "friction.coulomb": "0.54 N*m",
            "friction.breakaway": "1.02 N*m",
            "record": {
                "start": "steady",
                "settle": "1 s",
                "duration": "120 s",
                "sample_rate": "256 Hz",
            },
        }
    )
    found = steady_state(craft)
    assert found.solver["search"].startswith("run from rest")
    motion = found.motion()
    block = 6 * 256  # 25 periods of the motion, whose mean is 0
    assert 6.0 * found.frequency == pytest.approx(25.0)
    for axis in ("los_x", "los_y"):
        los = motion[axis]
        means = los[: los.size // block * block].reshape(-1, block).mean(axis=1)
        assert np.ptp(means) < 1e-4 * np.ptp(los)


def test_a_report_says_how_long_a_run_from_rest_takes_to_repeat():
    """Its motion is irregular for minutes, although deviations of the one it comes to die out in half a minute."""
    scenario = scenario_of_any_kind(161).with_si({"record.sample_rate": 512.0})
    found = run_scenario(scenario, start="steady", lines_only=True)
    assert found.state is not None
    solver = found.state.solver
    assert solver["arrived_s"] > 4.0 * solver["settling_s"]
    [simulated] = [item for item in first_page(found, None) if isinstance(item, Pairs)]
    said = dict(simulated.rows)["Steady state"]
    assert said.endswith(f"; a run from rest repeated within {solver['arrived_s']:.3g} s")


def test_a_fourier_series_does_not_depend_on_the_sample_rate() -> None:
    changes = {"tracking.rate": "0.02 deg/s", "driver.microsteps": 4}
    series = []
    for rate in ("512 Hz", "8192 Hz"):
        state = steady_state(mv.load_scenario("state-1", {**changes, "record.sample_rate": rate}))
        series.append(np.abs(state.harmonics("T_d", int(PASSBAND * 512.0 / state.frequency) + 1)))
    coarse, fine = series
    shown = fine > 1e-3 * np.max(fine[1:])
    assert np.count_nonzero(shown[fine.size // 2 :]) > 20
    assert coarse[shown] == pytest.approx(fine[shown], rel=1e-3)


def test_where_steps_cannot_be_taken_again_lines_are_those_by_means(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    state = steady_state(mv.load_scenario("state-1"))
    orders = np.array([1, 4, 16, 32])
    by_steps = state.integrated_harmonics(orders)

    def kink(*_: object) -> None:
        raise NotDifferentiable(KINK)

    monkeypatch.setattr(RecordedPeriod, "record", kink)
    by_means = state.integrated_harmonics(orders)
    assert not np.array_equal(by_means, by_steps)
    largest = float(np.max(np.abs(by_steps)))
    assert by_means == pytest.approx(by_steps, rel=1e-3, abs=1e-4 * largest)
