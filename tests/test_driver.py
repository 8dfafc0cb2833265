"""Errors of a driver's reference currents: angle errors in closed form, the lines they make, tables from files, identification."""

import math

import numpy as np
import pytest
from support import rodas4
from support.scenarios import NO_FRICTION, baseline, recorded

import microvib as mv
from microvib.analysis.lines import steady_lines
from microvib.errors import OptionError
from microvib.model.driver import quantized, references_over_electrical_period
from microvib.model.expected import angle_errors, expected_lines
from microvib.model.linear import linear_lines
from microvib.reports.identification import fit_json, fit_outcome
from microvib.reports.parameters import derived
from microvib.results import Table
from microvib.solve.batch import simulate_torques
from microvib.solve.command import Command
from microvib.solve.steady.period import common_period
from microvib.solve.steady.state import steady_state
from microvib.studies.evidence import Evidence, Observation, evidence_of, select_evidence
from microvib.studies.identify import ErrorModel, identify, parse_fit
from microvib.studies.identify.images import quarter_turn_solutions, symmetric_solutions
from microvib.studies.identify.problem import Problem

ERRORS = {"gain_b": 0.012, "offset_a": 0.006, "offset_b": -0.004, "quadrature": math.radians(0.9)}
FREE = {"sources": {}, **NO_FRICTION}


def driver_with(**errors):
    return (
        baseline()
        .with_si({f"driver.imperfections.{key}": value for key, value in errors.items()})
        .driver
    )


def angle_error(driver):
    """Angle of the current vector less theta_e, by the four-quadrant arctangent, (b n,)."""
    turn = references_over_electrical_period(driver, 0.6)
    theta_e = 2 * math.pi * np.arange(len(turn)) / len(turn)
    return np.angle(np.exp(1j * (np.arctan2(turn[:, 1], turn[:, 0]) - theta_e)))


def amplitude(x, order):
    k = np.arange(x.size)
    return 2.0 * np.mean(x * np.exp(-2j * math.pi * order * k / x.size))


@pytest.mark.parametrize(
    ("errors", "order", "expected"),
    [
        ({"gain_b": 0.01}, 2, 0.01 / 2 * -1j),  # (g/2) sin 2 theta_e
        ({"offset_b": 0.006}, 1, 0.006),  # o cos theta_e
        ({"offset_a": 0.006}, 1, 0.006 * 1j),  # -o sin theta_e
        ({"quadrature": 0.01}, 2, 0.01 / 2),  # (q/2)(1 + cos 2 theta_e)
    ],
    ids=str,
)
def test_small_errors_have_the_angle_errors_of_the_closed_forms(errors, order, expected):
    found = angle_error(driver_with(**errors))
    assert amplitude(found, order) == pytest.approx(expected, rel=0.02)
    rest = (
        found
        - found.mean()
        - np.real(amplitude(found, order) * np.exp(2j * math.pi * order * np.arange(64) / 64))
    )
    assert np.max(np.abs(rest)) < 0.02 * abs(expected)
    assert found.mean() == pytest.approx(errors.get("quadrature", 0.0) / 2, abs=1e-4)
    (said,) = (x for x in angle_errors(driver_with(**errors)) if x.amplitude > 0.1 * abs(expected))
    assert (said.order, said.causes) == (order, tuple(errors))
    assert said.amplitude == pytest.approx(abs(expected), rel=0.02)


@pytest.mark.parametrize(
    ("bits", "fourth", "rms"),
    [(6, 1.9e-3, 7.4e-3), (8, 1.6e-3, 2.3e-3), (10, 1.3e-4, 4.7e-4), (12, 5e-5, 1.5e-4)],
)
def test_rounded_references_have_the_angle_errors_of_an_independent_computation(bits, fourth, rms):
    """Figures computed outside the project, to two digits."""
    found = angle_error(driver_with(dac_bits=bits))
    assert abs(amplitude(found, 4)) == pytest.approx(fourth, rel=0.05)
    assert found.std() == pytest.approx(rms, rel=0.05)
    assert {
        x.order % 4 for x in angle_errors(driver_with(dac_bits=bits)) if x.amplitude > 1e-8
    } == {0}


@pytest.mark.parametrize("phases", [2, 3, 5])
@pytest.mark.parametrize("n", [1, 2, 3, 6, 8, 10, 16, 25, 48, 64, 100, 256])
def test_a_perfect_drive_stays_symmetric_when_its_references_are_rounded(phases, n):
    """Currents of a full step later are those of this one, turned, and mirrored they are themselves, at any number of bits."""
    steps = {2: 4, 3: 6, 5: 10}[phases]
    for bits in range(4, 15):
        driver = driver_with(dac_bits=bits).model_copy(update={"beats": steps, "microsteps": n})
        A, B = references_over_electrical_period(driver, 0.6, phases).T
        vector = A + 1j * B
        turned = vector * np.exp(2j * math.pi / steps)
        np.testing.assert_allclose(np.roll(vector, -n), turned, rtol=0.0, atol=1e-12)
        np.testing.assert_allclose(np.roll(vector[::-1], 1), vector.conj(), rtol=0.0, atol=1e-12)
        assert {x.order % steps for x in angle_errors(driver, phases) if x.amplitude > 1e-8} <= {0}


def test_a_half_step_of_the_rounding_goes_away_from_zero_whatever_its_noise():
    levels = 127
    half = np.array([0.5, 0.5 + 1e-16, 0.5 - 2e-16, 1.5 / levels])
    for x in (half, half * (1.0 + 3e-16), half * (1.0 - 3e-16)):
        assert np.array_equal(levels * quantized(x, levels), [64.0, 64.0, 64.0, 2.0])
        assert np.array_equal(quantized(-x, levels), -quantized(x, levels))
    assert levels * quantized(np.array([0.5 - 1e-9]), levels) == pytest.approx([63.0])


def test_a_dead_band_at_half_the_current_treats_three_phases_alike():
    driver = driver_with(dead_band=0.5).model_copy(update={"beats": 6, "microsteps": 16})
    A, B = references_over_electrical_period(driver, 1.0, 3).T
    turned = (A + 1j * B) * np.exp(1j * math.pi / 3)
    np.testing.assert_allclose(np.roll(A + 1j * B, -16), turned, rtol=0.0, atol=1e-12)


def test_an_ideal_driver_is_as_before():
    driver, motor = baseline().driver, baseline().motor
    assert driver.ideal
    assert angle_errors(driver) == ()
    k = np.arange(-200, 200)
    A, B = driver.reference_currents(motor, k)
    assert np.array_equal(A, 0.6 * np.cos(2.0 * math.pi * k / 64))
    assert np.array_equal(B, 0.6 * np.sin(2.0 * math.pi * k / 64))


def test_references_with_errors_repeat_exactly_and_are_the_formula():
    s = baseline().with_si({f"driver.imperfections.{key}": value for key, value in ERRORS.items()})
    k = np.arange(-1000, 1000)
    A, B = s.driver.reference_currents(s.motor, k)
    assert np.array_equal(A[:-64], A[64:])
    theta_e = 2 * math.pi * k / 64
    np.testing.assert_allclose(A, 0.6 * (np.cos(theta_e) + 0.006), atol=1e-14)
    np.testing.assert_allclose(
        B, 0.6 * (1.012 * np.sin(theta_e + ERRORS["quadrature"]) - 0.004), atol=1e-14
    )


def test_a_dead_band_holds_small_references_at_zero():
    A, B = references_over_electrical_period(driver_with(dead_band=0.15), 1.0).T
    assert np.array_equal(A == 0.0, np.abs(np.cos(2 * math.pi * np.arange(64) / 64)) < 0.15)
    assert np.array_equal(B == 0.0, np.abs(np.sin(2 * math.pi * np.arange(64) / 64)) < 0.15)


@pytest.mark.parametrize(
    ("errors", "after"),
    [
        (ERRORS, 64),
        ({"offset_a": 1e-6}, 64),
        ({"dac_bits": 8}, 16),
        ({"dead_band": 0.11}, 16),
        ({"gain_b": 0.01}, 64),
    ],
    ids=str,
)
def test_a_steady_state_repeats_after_an_electrical_turn_unless_the_errors_are_the_same_in_each_quarter(
    errors, after
):
    s = baseline().with_si({f"driver.imperfections.{key}": value for key, value in errors.items()})
    assert common_period(s) == (after, after)


@pytest.fixture(scope="module")
def distorted():
    return baseline().with_si(
        {f"driver.imperfections.{key}": value for key, value in ERRORS.items()}
    )


@pytest.fixture(scope="module")
def steady_distorted(distorted):
    return steady_lines(distorted)


def test_lines_of_the_electrical_period_are_named_by_what_makes_them(distorted, steady_distorted):
    assert steady_distorted.fallback == ""
    by_name = {x.name: x for x in steady_distorted.lines}
    assert by_name["electrical_1"].origin == "electrical period, order 1: offset_a, offset_b"
    assert by_name["electrical_2"].origin == "electrical period, order 2: gain_b, quadrature"
    assert by_name["full_step_1"].origin == "full step, order 1"
    for name in ("electrical_1", "electrical_2"):
        assert by_name[name].amplitude > 1e-4
        assert by_name[name].frequency == pytest.approx(
            int(name[-1]) * distorted.driving_frequency / 64, rel=1e-12
        )
    ideal = {x.name for x in expected_lines(baseline(), "100 Hz")}
    assert {x for x in ideal if x.startswith("electrical")} == {
        "electrical_1",
        "electrical_2",
        "electrical_3",
    }


@pytest.mark.parametrize("seed", range(4))
def test_any_driver_makes_lines_at_multiples_of_the_electrical_frequency_only(seed):
    """A run in time of ten electrical periods: nothing between its bins of ten; every table and error repeats with the turn."""
    r = np.random.default_rng(seed)
    driver = {f"driver.imperfections.{key}": float(r.uniform(-0.03, 0.03)) for key in ERRORS}
    driver |= {
        "driver.imperfections.dac_bits": int(r.integers(6, 12)),
        "driver.microstep_ramp": float(r.choice([0.0, 0.4])),
    }
    if seed % 2:
        angle = 2 * math.pi * np.arange(64) / 64 + r.uniform(-0.02, 0.02, 64)
        driver["driver.table"] = {
            "currents": np.column_stack([np.cos(angle), np.sin(angle)]).tolist()
        }
    rigid = {"array.modes": [], "array.rigid_inertia": None, "array.inertia": 0.2}
    s = baseline().with_si({**driver, **rigid, "record.settle": 10.0, "record.duration": 12.0})
    spectrum = np.abs(np.fft.rfft(mv.simulate(s, channels=("T_d",))["T_d"]))[1:4800]  # up to 400 Hz
    bins = np.arange(1, 4800)
    assert 12.0 * s.driving_frequency / 64 == pytest.approx(10.0)
    assert np.max(spectrum[bins % 10 != 0]) < 1e-3 * np.max(spectrum)
    assert np.max(spectrum[(bins % 10 == 0) & (bins % 40 != 0)]) > 5e-3 * np.max(spectrum)


def test_the_steady_state_is_that_of_a_run(distorted, steady_distorted):
    run = mv.find_lines(mv.simulate(distorted.with_si({"record.settle": 60.0}), channels=("T_d",)))
    for name in ("electrical_1", "electrical_2", "full_step_1", "drive_1", "drive_2"):
        assert run[name].amplitude == pytest.approx(
            steady_distorted.lines[name].amplitude, rel=0.01
        ), name


def test_reference_integration_finds_the_same_lines(distorted):
    changes = {"record.settle": 4.0, "driver.microstep_ramp": 0.5}
    exact = distorted.with_si(changes)
    other = mv.find_lines(rodas4.simulate(exact, channels=("T_d",)))
    found = mv.find_lines(mv.simulate(exact, channels=("T_d",)))
    for name in ("electrical_1", "electrical_2", "full_step_1", "drive_1", "drive_2"):
        assert found[name].amplitude == pytest.approx(other[name].amplitude, rel=1e-3), name


@pytest.mark.parametrize(
    ("errors", "name", "error"),
    [
        ({"offset_a": 0.006}, "electrical_1", 0.006),
        ({"gain_b": 0.01}, "electrical_2", 0.005),
        ({"quadrature": 0.01}, "electrical_2", 0.005),
    ],
    ids=str,
)
def test_a_slow_angle_error_turns_the_apparent_inertia(errors, name, error):
    """T = apparent inertia x omega^2 x d/(z h): far below the drive's resonances, of a rigid load without dry friction and detent."""
    s = baseline().with_si(
        FREE
        | {f"driver.imperfections.{key}": value for key, value in errors.items()}
        | {
            "motor.detent_torque": 0.0,
            "array.modes": [],
            "array.rigid_inertia": None,
            "array.inertia": 0.2,
        }
    )
    order = int(name[-1])
    omega = 2 * math.pi * order * s.driving_frequency / 64
    seen_by_table = 0.2 - s.rotor_inertia * s.reducer.ratio  # the rotor turns the other way
    found = mv.find_lines(s, start="steady")[name].amplitude
    assert found == pytest.approx(seen_by_table * omega**2 * error / (50 * 100), rel=0.02)


def test_a_table_against_the_detent_torque_removes_its_line():
    free = FREE | {"array.modes": [], "array.rigid_inertia": None, "array.inertia": 0.2}
    s = baseline().with_si({**free, "tracking.rate": math.radians(0.006)})
    e = s.motor.detent_torque / (s.motor.torque_constant * s.motor.current)
    table = {
        "harmonics": [{"order": 4, "amplitude": e}]
    }  # theta_e + e sin 4 theta_e, for a small e
    with_table = s.with_si({"driver.table": table})
    before, after = (mv.find_lines(x, start="steady")["full_step_1"] for x in (s, with_table))
    assert after.amplitude < 0.1 * before.amplitude
    assert after.origin == "full step, order 1: table"


@pytest.mark.parametrize("ramp", [0.3, 0.8])
def test_a_ramp_weakens_driving_lines_by_its_spectrum(ramp):
    smooth = FREE | {"motor.detent_torque": 0.0, "driver.microstep_ramp": ramp}
    s = baseline().with_si(smooth)
    table = mv.find_lines(s, start="steady")
    stepped = {
        x.order: abs(x.amplitude) for x in linear_lines(s.with_si({"driver.microstep_ramp": 0.0}))
    }
    for line in linear_lines(s, 3):
        assert abs(line.amplitude) == pytest.approx(  # but for what a chord lacks of its arc
            stepped[line.order] * abs(np.sinc(line.order * ramp)), rel=2e-3
        )
        assert abs(line.amplitude) == pytest.approx(
            table[f"drive_{line.order}"].amplitude, rel=0.03
        )


@pytest.mark.parametrize("microsteps", [4, 8, 16])
def test_lines_of_a_ramp_over_the_whole_microstep_are_those_of_its_chords(microsteps):
    ramped = {"driver.microstep_ramp": 1.0, "driver.microsteps": microsteps}
    loaded = {"motor.detent_torque": 0.0, "motor.friction.viscous": 0.02}
    s = baseline().with_si(FREE | ramped | loaded)
    s = s.with_si({"tracking.rate": math.radians(0.3)})
    table = mv.find_lines(s, start="steady")
    for line in linear_lines(s, 3):
        found = table[f"drive_{line.order}"].amplitude
        assert abs(line.amplitude) == pytest.approx(found, rel=0.08)  # currents follow at once


def test_a_ramp_ends_where_the_next_microstep_comes():
    s = baseline().with_si(
        {"driver.microstep_ramp": 1.0, "record.settle": 0.5, "record.duration": 1.0}
    )
    motion = mv.simulate(s)
    k = Command(s).count(motion.time)
    found = motion["i_ref_A"] + 1j * motion["i_ref_B"]
    # half a microstep behind the command; along a chord the vector strays by a part of the microstep's square
    expected = 0.6 * np.exp(2j * math.pi * (k - 0.5 * np.sign(k)) / 64)
    assert (
        np.max(np.abs(found - expected)[50:-50]) < 0.6 * (2 * math.pi / 64) ** 2 / 7
    )  # a chord's sagitta is an eighth


def test_a_delay_moves_everything_by_itself():
    s = baseline().with_si(
        {"record.settle": 0.25, "record.duration": 1.0, "record.sample_rate": 2048.0}
    )
    late = s.with_si({"driver.delay": 0.125, "record.settle": 0.375})
    now, then = (mv.simulate(x, channels=("T_d",))["T_d"] for x in (s, late))
    assert np.max(np.abs(now - then)) < 1e-3 * np.max(np.abs(now))
    t, _ = Command(s).microsteps(0.0, 1.0)
    delayed, _ = Command(late).microsteps(0.0, 1.125)
    np.testing.assert_allclose(delayed, t + 0.125)


def test_a_steady_state_with_ramps_is_found(distorted):
    s = distorted.with_si({"driver.microstep_ramp": 1.0, "record.settle": 40.0})
    state = steady_state(s)
    assert state.microsteps == 64
    run, found = mv.find_lines(simulate_torques([s])[0]), mv.find_lines(state)
    for name in ("electrical_1", "electrical_2", "full_step_1"):
        assert run[name].amplitude == pytest.approx(found[name].amplitude, rel=0.01), name


def test_show_lists_the_orders_with_their_causes(distorted):
    said = "\n".join(derived(distorted))
    assert (
        "angle error of the references, electrical_1 at 0.833333 Hz 0.00717 rad (offset_a, offset_b)"
        in said
    )
    assert "angle error of the references, electrical_2 at 1.66667 Hz" in said
    assert "angle error" not in "\n".join(derived(baseline()))


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("order,amplitude_deg,phase_deg\n4,0.5,10\n1,-0.1,0\n", "harmonics"),
        ("order,amplitude_rad\n4,0.01\n", "harmonics"),
        ("angle_deg\n" + "0.5\n" * 64, "currents"),
        ("i_A, i_B\n" + "1,0\n" * 64, "currents"),
        ("i_a,i_b\n" + "1,0\n" * 64 + "\n\n", "currents"),
    ],
)
def test_tables_are_read_and_written_with_the_scenario(tmp_path, text, expected):
    (tmp_path / "table.csv").write_text(text)
    (tmp_path / "mine.yaml").write_text(
        mv.dump_scenario(baseline()).replace("driver:\n", "driver:\n  table: table.csv\n")
    )
    s = mv.load_scenario(tmp_path / "mine.yaml")
    assert getattr(s.driver.table, expected)
    assert s.source_of("driver.table") == "table.csv"
    (tmp_path / "again.yaml").write_text(mv.dump_scenario(s))
    (tmp_path / "table.csv").unlink()
    assert mv.load_scenario(tmp_path / "again.yaml") == s
    if "angle" in text:
        np.testing.assert_allclose(angle_error(s.driver), math.radians(0.5), atol=1e-15)
    changed = baseline().with_({"driver.table": {expected: getattr(s.driver.table, expected)}})
    assert changed.driver == s.driver


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("x,y\n1,2\n", "is not a table of currents; its first line must be i_a,i_b"),
        ("", "is not a table of currents"),
        ("i_a,i_b\n1,x\n", "row 2: i_b 'x' is not a number"),
        ("i_a,i_b\n1\n", "row 2: i_b '' is not a number"),
        (
            "i_a,i_b\n1,0\n",
            "driver.table.currents: has 1 rows; one for each microstep of an electrical turn is expected",
        ),
        (
            "i_a,i_b\n1,0\n-3,0\n",
            "table.csv, row 3: i_a is -3; a number from -2 to 2 is expected, 2 times the current I",
        ),
        (
            "i_a_of_511,i_b_of_511\n511,0\n510,1023\n",
            "table.csv, row 3: i_b_of_511 is 1023; a number from -1022 to 1022 is expected",
        ),
        (
            "i_a_of_511,i_b_of_511\n511,0\n510.5,50\n",
            "table.csv, row 3: i_a_of_511 is 510.5; a whole number is expected",
        ),
        ("i_a,i_b\n", "table.csv: has no rows below its first line"),
        ("i_a,i_b\n1,0\n0,9,0,1\n", "table.csv, row 3: has 4 cells; 2 are expected"),
        (
            "order,amplitude_deg\n1.5,1\n",
            "driver.table.harmonics.0.order: 1.5 is not allowed; a whole number from 1 to",
        ),
    ],
)
def test_bad_tables_get_a_sentence(tmp_path, text, sentence):
    (tmp_path / "table.csv").write_text(text)
    with pytest.raises(mv.ScenarioError) as error:
        mv.load_scenario("state-1", {"driver.table": str(tmp_path / "table.csv")})
    assert sentence in str(error.value)


@pytest.mark.parametrize(
    ("key", "value", "sentence"),
    [
        ("driver.imperfections.gain_b", 0.7, "must be at least -0.5 and at most 0.5"),
        ("driver.imperfections.quadrature", 0.9, "needs a unit, such as '0.9 deg'"),
        ("driver.imperfections.dac_bits", 1, "a whole number from 2 to 24 is expected"),
        (
            "driver.imperfections.gain",
            0.1,
            "unknown key; did you mean driver.imperfections.gain_b?",
        ),
        (
            "driver.table",
            {"currents": [[3.0, 0.0]] * 64},
            "currents.0: 3, 0 is not allowed; currents over I from -2 to 2 are expected",
        ),
        ("driver.microstep_ramp", 1.5, "must be at least 0 and at most 1"),
        ("driver.delay", "-1 ms", "must be at least 0 s"),
        ("driver.table", "nowhere.csv", "cannot be read: No such file or directory"),
    ],
)
def test_bad_keys_get_a_sentence(key, value, sentence):
    with pytest.raises(mv.ScenarioError) as error:
        mv.load_scenario("state-1", {key: value})
    assert key in str(error.value) or "nowhere" in str(error.value)
    assert sentence in str(error.value)


def test_the_supply_must_drive_the_largest_reference():
    s = {"driver.supply_voltage": 3.65, "driver.imperfections.offset_a": 0.05}
    with pytest.raises(mv.ScenarioError, match=r"supply_voltage 3\.65 V cannot drive 0\.63 A"):
        baseline().with_si(s)


# ---- Identification ----

SHORT = {"record.settle": 4.0, "record.duration": 16.0}


def test_phases_of_electrical_lines_do_not_depend_on_the_first_sample(distorted):
    """Half an electrical turn later: what tells the turns apart is the phase at the first sample alone."""
    settled = distorted.with_si({"record.settle": 60.0})
    f_e = settled.driving_frequency / 64
    told = [
        {(o.line, o.form): o for o in evidence_of(recorded(s), baseline()).observations}
        for s in (
            settled,
            settled.with_si({"record.settle": 60.0 + 0.5 / f_e}),
            settled.with_si({"record.settle": 60.37}),
        )
    ]
    for name in ("electrical_1", "electrical_2"):
        phases = np.array([each[name, "phase"].value for each in told])
        assert np.max(np.abs(np.angle(np.exp(1j * (phases - phases[0]))))) < 0.02
    branches = np.array([each["electrical_2", "branch"].value for each in told])
    assert np.max(np.abs(np.angle(np.exp(1j * (branches - branches[0]))))) < 0.02
    assert ("electrical_2", "turn") not in told[0]  # one is all that relative phases do not tell
    turns = np.array([each["electrical_1", "turn"].value for each in told])
    moved = 2 * math.pi * f_e * np.array([0.0, 0.5 / f_e, 0.37])
    assert np.max(np.abs(np.angle(np.exp(1j * (turns - turns[0] - moved))))) < 0.02


def test_half_an_electrical_turn_later_both_offsets_have_the_other_sign(distorted):
    """The ambiguity that identification speaks of: the same lines, each turned by its order times half a turn."""
    fine = distorted.with_si({"solver.accuracy": 3e-5})
    other = fine.with_si(
        {"driver.imperfections.offset_a": -0.006, "driver.imperfections.offset_b": 0.004}
    )
    a, b = (steady_state(s) for s in (fine, other))
    one, two = a.harmonics(), b.harmonics()
    k = np.arange(one.size)
    strong = np.abs(one) > 1e-4 * np.max(np.abs(one[1:]))
    strong[0] = False
    np.testing.assert_allclose((two * (-1.0) ** k)[strong], one[strong], rtol=3e-4)


def test_what_may_be_of_either_sign_needs_no_range():
    assert parse_fit(baseline(), "driver.imperfections.gain_b").range == (
        -0.5,
        0.5,
    )  # over the width of 0.1
    key = parse_fit(driver_scenario(offset_a=-0.03), "driver.imperfections.offset_a")
    assert (key.low, key.high) == (-0.12, 0.12)
    with pytest.raises(OptionError, match="starts at 0; give its range"):
        parse_fit(baseline(), "driver.imperfections.dead_band")


def driver_scenario(**errors):
    return baseline().with_si(
        {f"driver.imperfections.{key}": value for key, value in errors.items()}
    )


def fitted(errors, seed, late=0.0, **how):
    """Errors fitted to a recording with noise, from a driver that has none; it began ``late`` [s] after the time assumed."""
    truth = driver_scenario(**errors).with_si(
        SHORT | {"record.settle": SHORT["record.settle"] + late, "tracking.clock_ratio": 0.9962}
    )
    return identify(
        baseline().with_si(SHORT),
        [recorded(truth, seed)],
        [f"driver.imperfections.{key}" for key in errors],
        **how,
    )


def estimates(errors, seed, **how):
    """Errors with their signs, where the time before the recording is known; all must be identifiable."""
    fit = fitted(errors, seed, settle_error="50 ms", **how)
    assert fit.usable
    assert all(e.identifiable for e in fit.estimates), [e.verdict for e in fit.estimates]
    return {e.key.rpartition(".")[2]: e for e in fit.estimates}


def check(found, errors):
    for key, e in found.items():
        assert abs(e.estimate - errors[key]) < max(
            0.05 * abs(errors[key]), 2.0 * e.standard_error
        ), e
        assert e.standard_error < 0.05 * abs(errors[key]), e


def test_a_search_looks_at_the_other_quarters_of_the_electrical_turn(distorted):
    """The lines of the driver turned by half a turn differ in the phase at the first sample alone; by a quarter, hardly in more."""
    truth = distorted.with_si({**SHORT, "record.settle": 60.0})
    keys = [parse_fit(baseline(), f"driver.imperfections.{key}") for key in ERRORS]
    told = select_evidence(
        [evidence_of(recorded(truth), truth)], truth, without=["array_mode_1"]
    )  # the start is another
    problem = Problem(truth, [(told[0], {})], keys, ErrorModel(0.004))
    x = np.array([key.coordinate(ERRORS[key.key.rpartition(".")[2]]) for key in keys])
    quarter, half, *_ = symmetric_solutions(problem, x)
    assert [key.value(c) for key, c in zip(keys, half, strict=True)] == pytest.approx(
        [0.012, -0.006, 0.004, ERRORS["quadrature"]]
    )
    assert [key.value(c) for key, c in zip(keys, quarter, strict=True)] == pytest.approx(
        [1.0 / 1.012 - 1.0, -0.004 / 1.012, -0.006 / 1.012, -ERRORS["quadrature"]]
    )
    here, there, aside = (r[: problem.figures] for r in problem.residuals([x, half, quarter]))
    turn = np.array([o.form == "turn" for _, o in problem.observed])
    assert (
        np.max(np.abs(there - here)[~turn]) < 1.0
    )  # standard deviations; 0.54, as what rings from the start
    assert np.max(np.abs(there)[turn]) > 5.0
    assert np.max(np.abs(aside)[turn]) > 2.0
    assert len(quarter_turn_solutions(problem, x)) == 3
    alone = Problem(
        truth, [(told[0], {})], keys[1:3], ErrorModel(0.004)
    )  # gain and quadrature are known: they tell quarters
    (half,) = quarter_turn_solutions(alone, x[1:3])
    assert half == pytest.approx(-x[1:3])
    positive = [parse_fit(baseline(), "driver.imperfections.offset_a=0.001:0.05"), *keys[2:3]]
    assert (
        len(
            quarter_turn_solutions(
                Problem(baseline(), [(told[0], {})], positive, ErrorModel(0.004)),
                np.log([0.006, 1.0]),
            )
        )
        == 0
    )
    problem = Problem(
        truth, [(told[0], {})], [parse_fit(truth, "reducer.stiffness")], ErrorModel(0.004)
    )
    assert (
        symmetric_solutions(problem, problem.start)
        == quarter_turn_solutions(problem, problem.start)
        == []
    )


@pytest.mark.parametrize(
    ("phases", "beats", "given", "count"),
    [
        (2, 4, {"gain_b": 0.03, "offset_a": 0.02, "offset_b": -0.01}, 3),
        (3, 6, {"offset_a": 0.02, "offset_b": -0.01}, 5),
        (3, 6, {"gain_b": 0.03, "quadrature": 0.01, "offset_a": 0.02, "offset_b": -0.01}, 1),
        (5, 10, {"offset_a": 0.02, "offset_b": -0.01}, 9),
    ],
)
def test_references_of_another_part_of_the_turn_are_the_same_later(phases, beats, given, count):
    """Against the currents themselves, microstep by microstep; gains of three phases have images half a turn away only."""
    true = driver_scenario(**given).with_si({"motor.phases": phases, "driver.beats": beats})
    evidence = Evidence(
        "made", (Observation("drive_1", "amplitude", 1.0, 0.1),), None, 16.0, 4096.0
    )
    keys = [parse_fit(true, f"driver.imperfections.{key}") for key in given]
    problem = Problem(true, [(evidence, {})], keys, ErrorModel(0.004))
    found = quarter_turn_solutions(problem, problem.start)
    assert len(found) == count
    for point in found:
        other = true.with_si(dict(problem.changes(point, 0)))
        one, its = (
            references_over_electrical_period(s.driver, 1.0, phases) @ (1.0, 1j)
            for s in (true, other)
        )
        apart = []
        for k in range(1, true.motor.detent_periods):
            later = np.roll(one, -k * one.size // true.motor.detent_periods)
            later = later * np.exp(-2j * math.pi * k / true.motor.detent_periods)
            larger = np.real(np.vdot(its, later)) / np.sum(np.abs(its) ** 2)
            apart.append(np.max(np.abs(later - larger * its)))
        assert min(apart) < 1e-12


@pytest.mark.parametrize(
    "late",
    [pytest.param(0.0, marks=pytest.mark.release), pytest.param(0.75, marks=pytest.mark.long)],
)
def test_without_the_time_before_a_recording_offsets_have_no_signs(late):
    """0.75 s are 0.62 of the electrical turn: a fit that believed the time would have both signs wrong."""
    errors = {"offset_a": 0.006, "offset_b": -0.004}
    fit = fitted(errors, 7, late, starts=4, finishes=1)
    assert not any(e.identifiable for e in fit.estimates)
    assert all("from another quarter of the electrical turn" in e.verdict for e in fit.estimates)
    found = {(e.key.rpartition(".")[2]): e.estimate for e in fit.estimates}
    quarters = [found] + [
        {key.rpartition(".")[2]: v for key, v in other.items()} for other in fit.alternatives
    ]
    assert len(quarters) == 4
    assert any(
        all(abs(one[key] - errors[key]) < 0.05 * abs(errors[key]) for key in errors)
        for one in quarters
    )
    assert fit_json(fit)["alternatives"] == list(fit.alternatives)
    shown = [item for item in fit_outcome(fit).parts[0].items if isinstance(item, Table)]
    (others,) = (x for x in shown if x.name == "alternatives")
    assert len(others.texts()) == 3


@pytest.mark.release
def test_offsets_are_identified_with_their_signs():
    errors = {"offset_a": 0.006, "offset_b": -0.004}
    found = estimates(errors, seed=7, starts=4, finishes=1)
    check(found, errors)
    assert "record.settle being right within 0.05 s" in found["offset_a"].verdict


def test_a_settling_time_is_fitted_or_its_error_is_stated():
    one = Evidence("made", (Observation("drive_1", "amplitude", 1.0, 0.1),), None, 16.0, 4096.0)
    with pytest.raises(
        OptionError, match=r"^settle_error: record\.settle is fitted; fit it or state its error"
    ):
        identify(baseline(), [one], ["record.settle"], settle_error="0.1 s")


@pytest.mark.release
def test_all_errors_of_the_phases_are_identified():
    check(estimates(ERRORS, seed=1, starts=32, finishes=2), ERRORS)


@pytest.mark.parametrize("ramp", [0.9, 0.999, 0.9999, 1.0])
def test_energy_is_balanced_however_long_ramps_are(ramp: float) -> None:
    """Ramps that follow each other without a pause leave step control little to see."""
    short = {"record.settle": "3 s", "record.duration": "1 s"}
    for name in ("state-1", "state-4"):
        scenario = mv.load_scenario(name).with_({**short, "driver.microstep_ramp": ramp})
        motion = mv.simulate(scenario)
        assert motion.invariants.broken == ()
        assert motion.invariants.energy < 5e-6
