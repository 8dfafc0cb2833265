"""An orbit with the array turning: against runs at other angles, and against a craft whose array really turns."""

import csv
import itertools
import json
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from support import craft as whole
from support.craft_scenarios import scenario_of
from support.tiers import sweep

import microvib as mv
from microvib.analysis.turning import hub_response
from microvib.cli.main import main
from microvib.io.scenario_file import dump_scenario
from microvib.model.rigid import COMPONENTS
from microvib.model.scenario import Scenario
from microvib.reports.orbit import orbit_outcome
from microvib.reports.outcome import terminal_text
from microvib.signals.limit_curve import LimitCurve
from microvib.studies.angles import angles_in, sweep_angles
from microvib.studies.budget.angles import budget_over_angles
from microvib.studies.budget.files import Requirements
from microvib.studies.orbit import MAX_QUASI_STATIC_CHANGE, TOLERANCE, analyse_orbit
from microvib.testdata.recording import Recording
from microvib.units import Si

SHORT = {"record.settle": Si(2.0), "record.duration": Si(4.0)}


def near_a_mode(**changes: object) -> Scenario:
    """Full steps at 3.48 Hz, which the third mode crosses as the array turns."""
    return scenario_of(
        whole.FullCraft(bandwidth=0.02),
        **SHORT,
        **{"tracking.rate": Si(math.radians(0.0626)), **changes},
    )


def test_between_runs_it_is_what_runs_there_say() -> None:
    scenario = near_a_mode()
    orbit = analyse_orbit(scenario, angles_in("30:210:45"))
    assert orbit.interpolation < TOLERANCE
    assert orbit.time[-1] == pytest.approx(math.pi / scenario.rate)
    at = np.radians([37.3, 61.0, 94.4, 101.9, 133.7, 188.2])
    runs = sweep_angles(scenario.with_si({"record.start": "steady"}), [Si(x) for x in at.tolist()])
    for metric, window in (("ape", 1.0), ("rpe", 0.01), ("jitter", 0.001)):
        there = np.interp(at, orbit.sweep.angles, orbit.size(metric, window))
        assert there == pytest.approx(runs.rms(metric, window), rel=0.01)
    assert np.ptp(np.log(orbit.size("ape", 1.0))) > 1.0  # the line does cross the mode
    straight = np.interp(at, orbit.runs.angles[::2], orbit.runs.rms("ape", 1.0)[::2])
    assert (
        np.max(np.abs(straight / runs.rms("ape", 1.0) - 1.0)) > 0.1
    )  # and straight lines between the runs would not do


@pytest.mark.release
def test_worst_and_rms_are_those_of_the_time() -> None:
    orbit = analyse_orbit(near_a_mode(), angles_in("30:120:30"))
    whole_orbit, size = orbit.windows[0], orbit.size("ape", 1.0)
    assert whole_orbit.worst == size.max() == size[whole_orbit.at]
    assert size == pytest.approx(orbit.sweep.rms("ape", 1.0))
    one = next(w for w in orbit.windows if (w.metric, w.window) == ("jitter", 0.1))
    assert one.worst == pytest.approx(orbit.sweep.rms("jitter", 0.1).max())
    even = np.linspace(0.0, orbit.time[-1], 4001)
    assert whole_orbit.rms == pytest.approx(
        math.sqrt(np.mean(np.interp(even, orbit.time, size) ** 2)), rel=1e-3
    )
    backwards = analyse_orbit(
        near_a_mode(**{"tracking.rate": Si(-math.radians(0.0626))}), angles_in("120:30:-30")
    )
    assert backwards.windows[0].rms == pytest.approx(whole_orbit.rms, rel=1e-3)


class Turning:
    """The whole craft in untransformed coordinates with its array turning: d/dt(M(psi) x') + C x' + K x = F exp(i omega t)."""

    def __init__(self, scenario: Scenario, full: whole.FullCraft, frequency: float) -> None:
        # M is a trigonometric polynomial of order 2 in psi
        psi = 2.0 * np.pi * np.arange(8) / 8
        masses = np.array(
            [whole.FullCraft(angle=float(x), bandwidth=full.bandwidth).M for x in psi]
        )
        self.series = np.fft.fft(masses, axis=0) / 8
        n, self.omega = full.n, 2.0 * np.pi * frequency
        motor, reducer = scenario.motor, scenario.reducer
        K, C = full.K.copy(), full.C.copy()
        gear = np.zeros(n)
        gear[-1], gear[-2] = -1.0 / reducer.h, -1.0
        K += float(reducer.stiffness) * np.outer(gear, gear)
        C += reducer.damping * np.outer(gear, gear)
        K[-1, -1] += motor.electromagnetic_stiffness
        C[-1, -1] += motor.friction.viscous
        C[-2, -2] += scenario.friction.viscous
        self.K, self.C, self.F = K, C, np.eye(n)[-1]

    def mass(self, psi: float) -> np.ndarray:
        k = np.array([0, 1, 2, 3, 4, -3, -2, -1])
        return np.tensordot(np.exp(1j * k * psi), self.series, 1).real

    def rates(self, psi: float) -> np.ndarray:
        """Of amplitudes X and of those of the momenta, M (X' + i omega X)."""
        inverse, turn = np.linalg.inv(self.mass(psi)), 1j * self.omega * np.eye(len(self.F))
        return np.block([[-turn, inverse], [-self.K, -turn - self.C @ inverse]])

    def quasi_static(self, psi: float) -> np.ndarray:
        return np.linalg.solve(
            self.K - self.omega**2 * self.mass(psi) + 1j * self.omega * self.C,
            self.F.astype(complex),
        )

    def turned(self, psi: np.ndarray, rate: float) -> np.ndarray:
        """Amplitudes at the angles, from the first one's: implicit midpoint rule."""
        n, step = len(self.F), (psi[1] - psi[0]) / rate
        X = self.quasi_static(psi[0])
        y, F, found = (
            np.r_[X, 1j * self.omega * self.mass(psi[0]) @ X],
            np.r_[np.zeros(n), self.F],
            [X],
        )
        for a, b in itertools.pairwise(psi.tolist()):
            A = 0.5 * step * self.rates(0.5 * (a + b))
            y = np.linalg.solve(np.eye(2 * n) - A, y + A @ y + step * F)
            found.append(y[:n])
        return np.array(found)


@pytest.mark.parametrize("rate", sweep([0.06, 0.12], 0.06))
def test_what_the_turning_changes_is_of_the_stated_size(rate: float) -> None:
    """A line that the third mode crosses; the hub's angles about x and y are the line of sight."""
    scenario, f = near_a_mode(), 3.485
    other = Turning(scenario, whole.FullCraft(bandwidth=0.02), f)
    psi = np.radians(np.arange(40.0, 140.0, 0.1 * rate))  # every 0.1 s
    los = other.turned(psi, math.radians(rate))[:, 3:5]
    at = np.linspace(1000 * 0.06 / rate, psi.size - 1, 61).astype(int)
    moved = [
        hub_response(scenario.at_angle(Si(a)), np.array([f]), np.array([[1.0, 0.0]]))
        for a in psi[at].tolist()
    ]
    still, slope = np.array([m.los[0] for m in moved]), np.array([m.slope[0] for m in moved])
    wanted = np.array([other.quasi_static(a)[3:5] for a in psi[at].tolist()])
    assert np.abs(still - wanted).max() < 2e-3 * np.abs(wanted).max()
    stated = math.radians(rate) * np.abs(np.gradient(slope, psi[at], axis=0))
    found = np.abs(los[at] - wanted)
    assert 0.3 < found.max() / stated.max() < 1.0
    assert found.max() > 1e-3 * np.abs(wanted).max()


@pytest.mark.release
def test_a_mode_that_rings_too_long_does_not_allow_angles_one_by_one() -> None:
    orbit = analyse_orbit(near_a_mode(**{"array.modes.2.damping": 0.0005}), angles_in("60:120:20"))
    assert not orbit.quasi_static
    assert "quasi-static sweep does not hold here" in " ".join(orbit.notes())
    calm = analyse_orbit(near_a_mode(), angles_in("60:120:20"))
    assert calm.quasi_static
    assert not calm.notes()
    assert calm.windows[0].turning < MAX_QUASI_STATIC_CHANGE < orbit.windows[0].turning
    # 2/D of the third mode, 0.6 % at 3.1 Hz with clamped root, times the rate; the first rings longer still
    assert math.degrees(calm.turned_in_decay) > 0.0626 / (2.0 * math.pi * 3.1 * 0.006)


def test_angles_without_a_steady_state_are_said_once() -> None:
    orbit = analyse_orbit(
        near_a_mode(**{"friction.torque_noise": {"density": Si(1e-12)}}), angles_in("60:100:40")
    )
    broken = replace(orbit, runs=replace(orbit.runs, fallbacks=("it does not repeat",) * 2 + ("",)))
    noise, without = broken.notes()
    assert noise.startswith("Torque noise and roughness of the friction are left out here")
    assert without.startswith(
        "No steady state at 2 of 3 angles, from 60 to 80 deg: it does not repeat."
    )


def test_command_writes_what_it_says(tmp_path: Path) -> None:
    (tmp_path / "craft.yaml").write_text(dump_scenario(near_a_mode()))
    arguments = [
        "run",
        str(tmp_path / "craft.yaml"),
        "--orbit",
        "--angles",
        "60:100:20",
        "--limit",
        "1 uN*m",
        "--out",
        str(tmp_path / "o"),
    ]
    done = CliRunner().invoke(main, arguments, prog_name="microvib")
    assert done.exit_code == 0, done.output
    said = json.loads((tmp_path / "o" / "orbit.json").read_text())
    rows = list(csv.DictReader((tmp_path / "o" / "orbit.csv").read_text().splitlines()))
    assert [said["from_deg"], said["to_deg"]] == pytest.approx([60.0, 100.0])
    count = len(said["angles_run_deg"])
    assert f"FAIL at {count} of {count} angles" in done.output
    assert said["judgement"]["verdict"] == "fail"
    assert [one["angle_deg"] for one in said["judgement"]["angles"]] == said["angles_run_deg"]
    assert float(rows[-1]["time_s"]) == pytest.approx(40.0 / 0.0626)
    size = [float(row["ape_radial_rad"]) for row in rows]
    assert said["windows"][0]["worst_rad"] == pytest.approx(max(size), rel=1e-6)
    assert f" {1e6 * said['windows'][0]['rms_rad']:.4g} " in done.output
    lines = list(csv.DictReader((tmp_path / "o" / "orbit_lines.csv").read_text().splitlines()))
    first = [row for row in lines if row["time_s"] == "0"]
    squares = sum(float(row["los_x_rad"]) ** 2 + float(row["los_y_rad"]) ** 2 for row in first)
    assert math.sqrt(0.5 * squares) == pytest.approx(size[0], rel=1e-6)
    assert (tmp_path / "o" / "orbit.png").stat().st_size > 10_000


def test_an_orbit_is_judged_where_it_is_run_and_passes_nothing_that_is_expected_between() -> None:
    """The third mode is nearest to the full steps at 96 deg, where no run is."""
    scenario, angles = near_a_mode(), angles_in("80:100:20")
    orbit = analyse_orbit(scenario, angles)
    mx = COMPONENTS.index("Mx")
    at_runs = max(np.abs(one.loads[:, mx]).max() for one in orbit.runs.lines)
    between = max(np.abs(one.loads[:, mx]).max() for one in orbit.sweep.lines)
    assert 1.001 * at_runs < between
    allowed = math.sqrt(at_runs * between)
    curve = LimitCurve((0.01, 500.0), (allowed, allowed))
    limit = mv.Limit.of_curves(None, {"Mx": curve}, "allowed")
    judged = analyse_orbit(scenario, angles, limit=limit)
    assert judged.judged is not None
    for angle, verdict in zip(judged.runs.angles, judged.judged.judgements, strict=True):
        there = scenario.with_si({"spacecraft.array_angle": float(angle), "record.start": "steady"})
        own = mv.run_scenario(there, limit=limit).judgement
        assert own is not None
        assert (verdict.verdict, verdict.all_gaps) == (own.verdict, own.all_gaps)
        assert verdict.verdict != "fail"
    assert judged.excess is not None
    assert judged.excess.component == "Mx"
    assert judged.excess.allowed == pytest.approx(allowed)
    found = scenario.with_si(
        {"spacecraft.array_angle": judged.excess.angle, "record.start": "steady"}
    )
    assert mv.run_scenario(found, limit=limit).judgement.verdict == "fail"
    outcome = orbit_outcome(judged)
    assert outcome.verdict == "not judged"
    assert "of Mx" in terminal_text(outcome)
    assert "the orbit does not pass" in terminal_text(outcome)
    assert "Nothing is judged between these angles" in terminal_text(outcome)


def test_an_array_that_does_not_turn_this_way_is_refused() -> None:
    with pytest.raises(mv.MicrovibError, match="in this order"):
        analyse_orbit(near_a_mode(), angles_in("90:0:-30"))
    with pytest.raises(mv.MicrovibError, match="a constant rate"):
        analyse_orbit(near_a_mode(**{"tracking.rate": Si(0.0)}))
    with pytest.raises(mv.MicrovibError, match="spacecraft: missing"):
        analyse_orbit(mv.load_scenario("state-1"))


def test_friction_over_the_angle_turns_with_the_array():
    example = Path(__file__).parents[1] / "examples" / "spacecraft.yaml"
    factor = [
        {"order": 1, "amplitude": 0.5, "phase": "180 deg"},
        {"order": 7, "amplitude": 0.1, "phase": "20 deg"},
    ]
    first = mv.load_scenario(str(example)).with_({"friction.position": {"harmonics": factor}})
    harmonics = first.friction.position.harmonics
    there = first.at_angle("100 deg")
    turn = math.radians(100.0) - first.spacecraft.array_angle
    for before, after in zip(harmonics, there.friction.position.harmonics, strict=True):
        expected = before.phase + before.order * turn
        assert math.remainder(after.phase - expected, math.tau) == pytest.approx(0.0, abs=1e-12)
    back = there.at_angle(Si(first.spacecraft.array_angle))
    for before, after in zip(harmonics, back.friction.position.harmonics, strict=True):
        assert math.remainder(after.phase - before.phase, math.tau) == pytest.approx(0.0, abs=1e-12)


SOURCES = {
    "line": "lines: lines.csv",
    "wheel": "wheel: {speed: 192.793242 rpm, axis: [0, 0, 1],"
    " harmonics: [{order: 1, radial_torque: 2.453e-6 N*m*s^2/rad^2}]}",
}


@pytest.mark.parametrize("source", sweep(SOURCES, "wheel"))
def test_an_orbit_looks_for_other_sources_between_its_angles(tmp_path: Path, source: str) -> None:
    """A mode that moves with the angle meets the source at 48.75 degrees, between those judged."""
    example = Path(__file__).parents[1] / "examples" / "spacecraft.yaml"
    light = {
        "tracking.rate": "0.0041667 deg/s",
        "friction.coulomb": "0 N*m",
        "friction.breakaway": "0 N*m",
        "motor.detent_torque": "0 N*m",
        "array.modes.2.frequency": "2.849645 Hz",
        "array.modes.2.damping": 0.0006,
        "spacecraft.hub.inertia": [f"{x} kg*m^2" for x in (90, 150, 210, 4, -6, 3)],
        "record.start": "steady",
    }
    craft = mv.load_scenario(str(example)).with_(light)
    (tmp_path / "lines.csv").write_text("frequency_hz,mx_n_m,mx_phase_rad\n3.2132207,0.001,0\n")
    files = tmp_path / "sources.yaml"
    files.write_text(f"sources: [{{name: a, position: [0 m, 0 m, 0 m], {SOURCES[source]}}}]")
    asked = tmp_path / "asked.yaml"
    asked.write_text(
        "requirements: [{name: x, metric: ape, axis: x, lowest: 3.21272 Hz, highest: 3.21372 Hz,"
        " limit: 0.15 urad}]"
    )
    angles = ["30 deg", "45 deg", "60 deg"]
    [over] = budget_over_angles(craft, asked, angles=angles, orbit=True, sources=files).judged
    [there] = mv.pointing_budget(craft.at_angle("48.75 deg"), asked, sources=files).judged
    assert there.value == pytest.approx(190e-9, rel=0.02)
    assert over.verdict == "fail"
    assert there.value <= over.most


@pytest.mark.release
def test_an_orbit_of_a_recording_looks_where_the_recording_is_worst() -> None:
    """Recorded slower than the scenario says, full steps meet a mode at another angle, 50.4 degrees."""
    light = whole.FullCraft(bandwidth=0.02, damping=np.full(4, 5e-5))
    keys = {"tracking.rate": Si(math.radians(0.0626)), "record.start": "steady"}
    scenario = scenario_of(light, **SHORT, **keys)
    slower = {"tracking.rate": 0.9975 * scenario.rate, "spacecraft": None, "record.duration": 40.0}
    ground = mv.simulate(scenario.with_si(slower))
    units = {"Fx": "N", "Fy": "N", "Fz": "N", "Mx": "N*m", "My": "N*m", "Mz": "N*m"}
    channels = {name: ground[name] for name in units}
    recording = Recording(channels, scenario.record.sample_rate, units, "table")
    band = {"metric": "ape", "lowest": "3.2 Hz", "highest": "3.8 Hz", "limit": "1 rad"}
    asked = Requirements(requirements=[band])
    over = budget_over_angles(
        scenario, asked, angles=["42 deg", "70 deg"], orbit=True, recording=recording
    )
    [there] = mv.pointing_budget(scenario.at_angle("50.4 deg"), asked, recording=recording).judged
    assert min(abs(math.degrees(angle) - 50.4) for angle in over.angles) < 0.3
    assert over.judged[0].most > there.value == pytest.approx(3.49e-5, rel=0.01)
