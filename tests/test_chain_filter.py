"""Filters that a recording went through and nobody stated, by its lines beside a scenario's."""

from __future__ import annotations

import cmath
import math

import numpy as np
import pytest
from scipy.signal import butter, freqs
from support.tiers import at_a_release

import microvib as mv
from microvib.signals.limit_curve import Limit
from microvib.studies.chain_filter import ChainFilter, LineRatio, find_filter
from microvib.studies.recording_limits import judge_recording
from microvib.testdata.preparation import Preparation
from microvib.testdata.recording import Recording

RATE = 2048.0


def response(f, passes: str, order: int, corner: float) -> np.ndarray:
    """Of SciPy's analog filter."""
    b, a = butter(order, 2.0 * np.pi * corner, passes, analog=True)
    return freqs(b, a, worN=2.0 * np.pi * np.asarray(f))[1]


@pytest.mark.parametrize("passes", ["low", "high"])
@pytest.mark.parametrize("order", [1, 2, 4, 8])
def test_the_response_and_what_it_takes(passes: str, order: int) -> None:
    f, one = np.geomspace(0.1, 100.0, 20), ChainFilter(passes, order, 3.0)
    assert one.response(f) == pytest.approx(response(f, passes, order, 3.0))
    (edge,) = (x for x in one.taken_from if 0.0 < x < math.inf)
    assert abs(one.response(np.array([edge]))[0]) == pytest.approx(0.95)
    zero_phase = ChainFilter(passes, order, 3.0, zero_phase=True)
    assert zero_phase.response(f) == pytest.approx(abs(one.response(f)))


LINES = np.array([10 / 3, 20 / 3, 50.0, 53.33, 56.67, 106.67, 160.0, 213.33])


def ratios(H: np.ndarray, scatter: float, seed: int = 0) -> tuple[LineRatio, ...]:
    """Lines behind a response, of a drive that differs by a ``scatter``, another start and gain."""
    rng = np.random.default_rng(seed)
    late = rng.uniform(0.0, 1.2)
    off = 1.0 + scatter * (rng.normal(size=H.size) + 1j * rng.normal(size=H.size))
    found = 0.7 * H * off * np.exp(2j * np.pi * LINES * late)
    return tuple(LineRatio(f, complex(x), 1e-3) for f, x in zip(LINES.tolist(), found, strict=True))


@pytest.mark.parametrize(
    ("passes", "order", "corner"),
    [("high", 1, 3.0), ("high", 1, 20.0), ("high", 2, 6.0), ("low", 4, 80.0)],
)
@pytest.mark.parametrize("scatter", [0.0, 0.02])
def test_a_filter_is_found_whatever_the_start_and_the_gain(passes, order, corner, scatter) -> None:
    for seed in range(5):
        lines = ratios(response(LINES, passes, order, corner), scatter, seed)
        found = find_filter(lines, 5 / 6)
        assert found is not None
        assert (found.passes, found.order) == (passes, order)
        assert found.corner == pytest.approx(corner, rel=0.15)


@pytest.mark.parametrize("scatter", [0.02, 0.1, 0.3, 1.0])
def test_no_filter_is_found_where_lines_differ_by_chance(scatter: float) -> None:
    for seed in range(20):
        assert find_filter(ratios(np.ones(LINES.size), scatter, seed), 5 / 6) is None


def test_no_filter_is_found_in_one_line_that_differs() -> None:
    for k in range(LINES.size):
        H = np.ones(LINES.size, dtype=complex)
        H[k] = 0.3 * cmath.exp(1j)
        assert find_filter(ratios(H, 0.01), 5 / 6) is None


@pytest.fixture(scope="module")
def torque() -> np.ndarray:
    """Torque of state 1 in its steady state, (16384,) at 2048 Hz."""
    record = {"record.sample_rate": "2048 Hz", "record.duration": "8 s"}
    return mv.simulate(mv.load_scenario("state-1").with_(record), start="steady")["T_d"]


def recorded(torque: np.ndarray, passes: str, order: int, corner: float) -> Recording:
    """Torque behind a filter, and little noise."""
    f = np.fft.rfftfreq(torque.size, 1.0 / RATE)
    H = np.ones(f.size, dtype=complex)
    H[1:] = response(f[1:], passes, order, corner)
    x = np.fft.irfft(np.fft.rfft(torque - torque.mean()) * H, torque.size)
    x += 1e-5 * np.random.default_rng(0).normal(size=x.size)
    return Recording({"Mz": x}, RATE, {"Mz": "N*m"}, "made")


@pytest.mark.parametrize(
    ("passes", "order", "corner", "band", "limit"),
    [
        ("high", 1, 6.0, ("1 Hz", "20 Hz"), "4 mN*m"),
        at_a_release("high", 2, 4.0, ("1 Hz", "20 Hz"), "4 mN*m"),
        ("low", 4, 55.0, ("40 Hz", "60 Hz"), "40 mN*m"),
        at_a_release("low", 1, 100.0, ("40 Hz", "60 Hz"), "45 mN*m"),
    ],
)
def test_a_line_of_which_a_filter_took_a_part_passes_no_limit(
    torque, passes, order, corner, band, limit
) -> None:
    """State 1 has 5.1 mN m at 3.3 Hz and 48 at 53 Hz; what is read is below the limit."""
    read = recorded(torque, passes, order, corner)
    judge = {"limit": Limit(limit, *band), "scenario": "state-1"}
    judged = judge_recording(read, **judge)
    assert judged.verdict == "not judged"
    assert f"behind a {passes}-pass" in str(judged.all_gaps)
    alone = judge_recording(read, Limit(limit, *band))
    assert alone.verdict != "fail"  # nothing tells there
    stage = {"kind": "butterworth", "order": order, "corner": f"{corner} Hz", "passes": passes}
    assert judge_recording(Preparation(response=[stage]).apply(read), **judge).verdict == "fail"
    if passes == "high":
        flat = Preparation(response="flat").apply(read)
        assert judge_recording(flat, **judge).verdict == "pass"  # as its owner says


def test_lines_where_a_filter_passes_all_are_judged(torque) -> None:
    read = recorded(torque, "high", 1, 6.0)
    for limit, verdict in (("60 mN*m", "pass"), ("40 mN*m", "fail")):
        judged = judge_recording(read, Limit(limit, "25 Hz", "350 Hz"), scenario="state-1")
        assert judged.verdict == verdict


@pytest.mark.parametrize(
    "changes",
    [
        {"reducer.stiffness": 1.2},
        {"array.rigid_inertia": 0.8},
        {"motor.detent_torque": 0.5},
        {"reducer.damping": 2.0, "array.rigid_inertia": 1.1},
    ],
)
def test_another_drive_than_the_scenario_is_no_filter(changes) -> None:
    scenario = mv.load_scenario("state-1")
    units = {"reducer.stiffness": "N*m/rad", "array.rigid_inertia": "kg*m^2"}
    units |= {"motor.detent_torque": "N*m", "reducer.damping": "N*m*s/rad"}
    record = {"record.sample_rate": "2048 Hz", "record.duration": "8 s"}
    for key, factor in changes.items():
        owner, name = key.split(".")
        value = getattr(getattr(scenario, owner), name)
        record[key] = f"{factor * value} {units[key]}"
    x = mv.simulate(scenario.with_(record), start="steady")["T_d"]
    x = x + 1e-5 * np.random.default_rng(0).normal(size=x.size)
    read = Recording({"Mz": x}, RATE, {"Mz": "N*m"}, "made")
    judged = judge_recording(read, Limit("0.2 N*m", "1 Hz", "350 Hz"), scenario="state-1")
    assert judged.verdict == "pass"
