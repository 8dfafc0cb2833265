"""A wheel whose waterfalls lack some of it: harmonics that are absent at some speeds, runs and channels
that failed, and bins that the analyser's filter weakens. No speed's absence bounds what others show.
"""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from support.tiers import sweep
from support.wheel_waterfalls import RPM, write_matrix

from microvib.cli.main import main
from microvib.errors import MicrovibError
from microvib.reports.outcome import Pairs
from microvib.reports.wheel import wheel_outcome, wheel_yaml
from microvib.signals.ridges import PowerMap
from microvib.signals.spectrum import window_values
from microvib.studies.wheel import MeasuredWheel, measured_wheel
from microvib.studies.wheel_fit import Coefficient, bound_coefficient

SPEEDS = RPM * np.arange(600.0, 4001.0, 100.0)
ORDERS = {1.0: 1e-7, 3.3: 3e-8, 5.8: 4e-8}
"""Coefficients [N s^2/rad^2]."""
RATE, SAMPLES = 800.0, 800
HIGHEST = RATE / 2.0

Gain = Callable[[int, float, float], float]
"""Factor on an order, by the row of the speed, the order and its frequency [Hz]."""


def spectra(
    gain: Gain, orders: dict[float, float] = ORDERS, noise: float = 1e-5, seed: int = 3
) -> np.ndarray:
    """Amplitudes, 0-to-peak, over SPEEDS and frequencies 1 Hz apart."""
    rng, window = np.random.default_rng(seed), window_values("hann", SAMPLES)
    t, rows = np.arange(SAMPLES) / RATE, []
    for i, speed in enumerate(SPEEDS):
        x = noise * rng.standard_normal(SAMPLES)
        for order, c in orders.items():
            f = order * speed / (2.0 * np.pi)
            if f < HIGHEST:
                x += (
                    gain(i, order, f)
                    * c
                    * speed**2
                    * np.cos(2.0 * np.pi * f * t + rng.uniform(0, 7))
                )
        rows.append(2.0 * np.abs(np.fft.rfft(x * window)) / window.sum())
    return np.array(rows)


def map_of(values: np.ndarray) -> PowerMap:
    frequency = np.arange(values.shape[1]) * RATE / SAMPLES
    return PowerMap(SPEEDS, frequency, 0.5 * values**2 / 1.5, 2)


def found_in(gain: Gain) -> MeasuredWheel:
    return measured_wheel({"radial_force": map_of(spectra(gain))})


def coefficients(found: MeasuredWheel, load: str = "radial_force") -> dict[float, Coefficient]:
    return {round(x.order, 1): x.coefficients[load] for x in found.harmonics}


def notes(found: MeasuredWheel) -> str:
    pairs = [x for part in wheel_outcome(found).parts for x in part.items if isinstance(x, Pairs)]
    return "\n".join(text for one in pairs for name, text in one.rows if name == "Note")


def require_held(found: MeasuredWheel, orders: dict[float, float] = ORDERS) -> None:
    for order, true in orders.items():
        c = coefficients(found)[round(order, 1)]
        assert c.value == pytest.approx(true, rel=0.01)
        assert c.least <= true <= c.most * (1.0 + 1e-3)


@pytest.mark.parametrize("rows", [[20], [34], [3, 4, 20, 33]])
def test_a_harmonic_absent_at_some_speeds_is_what_the_others_show(rows: list[int]) -> None:
    found = found_in(lambda i, order, f: float(order != 3.3 or i not in rows))
    require_held(found)
    c = coefficients(found)[3.3]
    assert c.least == 0.0
    assert c.weak == pytest.approx(SPEEDS[rows])
    [remark] = [x.remark for x in found.harmonic_rows() if round(x.order, 1) == 3.3]
    assert remark.startswith("less than half of it, or absent, at ")
    assert f"{SPEEDS[rows[-1]] / RPM:.5g} rpm" in remark
    assert coefficients(found)[1.0].weak == ()


@pytest.mark.parametrize("rows", [[20], [0, 1, 20, 34]])
def test_a_speed_at_which_no_order_is_seen_is_left_out_and_named(rows: list[int]) -> None:
    found = found_in(lambda i, order, f: float(i not in rows))
    require_held(found)
    assert all(c.least > 0.99 * ORDERS[order] for order, c in coefficients(found).items())
    assert np.flatnonzero(found.failed["radial_force"]).tolist() == rows
    assert "is seen in any load at" in notes(found)
    inside = np.delete(SPEEDS, rows) / RPM
    assert f"measured_from: {inside[0]:.9g} rpm" in wheel_yaml(found)
    assert f"measured_to: {inside[-1]:.9g} rpm" in wheel_yaml(found)


def test_a_channel_that_fails_at_some_speeds_is_left_out_there_alone() -> None:
    torque = map_of(spectra(lambda i, order, f: float(i not in (20, 30)), seed=4))
    found = measured_wheel(
        {"radial_force": map_of(spectra(lambda i, order, f: 1.0)), "radial_torque": torque}
    )
    require_held(found)
    assert coefficients(found)[1.0].speeds == SPEEDS.size
    assert coefficients(found, "radial_torque")[1.0].speeds == SPEEDS.size - 2
    assert "seen in radial torque at 2600 and 3600 rpm" in notes(found)


@pytest.mark.parametrize(
    "gain",
    [lambda f: 10.0 ** (-0.4 * max(f - 370.0, 0.0)), lambda f: (1.0 + (f / 340.0) ** 32) ** -0.5],
)
def test_bins_that_a_filter_weakens_are_left_out_and_named(gain: Callable[[float], float]) -> None:
    found = found_in(lambda i, order, f: gain(f))
    require_held(found)
    assert coefficients(found)[5.8].least > 0.7 * ORDERS[5.8]
    assert 330.0 < found.highest < 390.0
    assert f"above {found.highest:.4g} Hz all orders or the noise fall off" in notes(found)
    assert f"measured_up_to: {found.highest:.6g} Hz" in wheel_yaml(found)


def test_bins_whose_noise_a_filter_takes_are_left_out() -> None:
    """An order that is not seen in a load must not be bounded by bins that show nothing."""
    force, torque = (spectra(lambda i, order, f: 1.0, seed=seed) for seed in (3, 4))
    torque[:, 351:] *= 1e-4
    found = measured_wheel({"radial_force": map_of(force), "radial_torque": map_of(torque)})
    assert found.highest == pytest.approx(350.0)


def test_whole_spectra_are_used_up_to_their_end() -> None:
    found = found_in(lambda i, order, f: 1.0)
    require_held(found)
    assert found.highest == HIGHEST
    assert not found.failed["radial_force"].any()
    said = notes(found).splitlines()  # the loads that were not measured, and that one axis was
    assert [" not measured" in said[0], "one of two axes" in said[1]] == [True, True]
    assert len(said) == 2


@pytest.mark.parametrize("shown", [range(12, 18), range(0, 35, 2), [10, 11, 12, 30, 31, 32]])
def test_a_harmonic_seen_at_a_few_speeds_may_be_as_large_at_all(shown: list[int]) -> None:
    found = found_in(lambda i, order, f: float(order != 3.3 or i in shown))
    c = coefficients(found)[3.3]
    assert c.most >= 0.999 * ORDERS[3.3]
    assert c.least == 0.0
    [remark] = [x.remark for x in found.harmonic_rows() if round(x.order, 1) == 3.3]
    assert "not seen" not in remark
    assert "rpm" in remark


def test_a_harmonic_that_is_larger_at_one_speed_may_be_so_at_all() -> None:
    found = found_in(lambda i, order, f: 3.0 if order == 3.3 and i == 25 else 1.0)
    c = coefficients(found)[3.3]
    assert c.value == pytest.approx(3e-8, rel=0.01)
    assert c.most == pytest.approx(9e-8, rel=0.01)
    assert c.large == pytest.approx(SPEEDS[[25]])


@pytest.mark.parametrize("scale", [0.0, 1e-5])
def test_spectra_of_a_silent_channel_bound_no_order(scale: float) -> None:
    """An order that is not seen in a load is not bounded by the noise that spectra of zeros lack."""
    force = map_of(spectra(lambda i, order, f: 1.0))
    torque = spectra(lambda i, order, f: 1.0, {1.0: 1e-7}, seed=4)
    whole = measured_wheel({"radial_force": force, "radial_torque": map_of(torque)})
    silent = torque.copy()
    silent[[20, 34]] *= scale
    found = measured_wheel({"radial_force": force, "radial_torque": map_of(silent)})
    for order in (3.3, 5.8):
        most = [coefficients(x, "radial_torque")[order].most for x in (whole, found)]
        assert most[1] > 0.5 * most[0]


def test_a_load_that_is_zero_throughout_is_refused() -> None:
    force = map_of(spectra(lambda i, order, f: 1.0))
    with pytest.raises(MicrovibError, match="axial_force: its spectra are zero at all speeds"):
        measured_wheel(
            {"radial_force": force, "axial_force": replace(force, power=0.0 * force.power)}
        )


def test_a_wheel_that_hardly_any_speed_shows_in_all_loads_is_refused() -> None:
    even, odd = (
        map_of(spectra(lambda i, order, f, part=part: float(i % 2 == part or i < 3), seed=part))
        for part in (0, 1)
    )
    with pytest.raises(MicrovibError, match="only 3 of 35 speeds show the orders in all loads"):
        measured_wheel({"radial_force": even, "radial_torque": odd})


def test_an_axis_that_misses_a_harmonic_at_a_speed_widens_the_interval_of_both() -> None:
    whole = spectra(lambda i, order, f: 1.0)
    lacking = spectra(lambda i, order, f: float(order != 3.3 or i != 20), seed=4)
    powers = tuple(map_of(x).power for x in (whole, lacking))
    both = replace(map_of(whole), power=np.mean(powers, axis=0), axes=powers)
    found = measured_wheel({"radial_force": both})
    require_held(found)
    c = coefficients(found)[3.3]
    assert c.least == 0.0
    assert c.weak == pytest.approx(SPEEDS[[20]])


def test_a_masked_order_is_not_bounded_by_speeds_that_show_nothing() -> None:
    one = map_of(spectra(lambda i, order, f: float(i not in (5, 15, 25, 30)), {2.0: 1e-7}))
    assert 1e-7 <= bound_coefficient(one, 2.002, np.ones(SPEEDS.size)) <= 1.2e-7


@pytest.mark.parametrize("seed", sweep(range(20), 0, 1, 2))
@pytest.mark.parametrize("which", ["one", "all"])
def test_intervals_hold_drawn_wheels_that_are_absent_at_one_to_four_speeds(
    which: str, seed: int
) -> None:
    rng = np.random.default_rng(seed)
    others = 1.6 + np.cumsum(rng.uniform(0.4, 2.0, int(rng.integers(1, 4))))
    drawn = {
        order: 10.0 ** rng.uniform(-7.5, -6.5) for order in (1.0, *np.round(others, 3).tolist())
    }
    rows = rng.choice(SPEEDS.size, int(rng.integers(1, 5)), replace=False)
    lacking = rng.choice(list(drawn))
    values = spectra(
        lambda i, order, f: float(i not in rows or (which == "one" and order != lacking)), drawn,
        10.0 ** rng.uniform(-6.0, -4.3), seed,
    )  # fmt: skip
    found = measured_wheel({"radial_force": map_of(values)})
    for order, true in drawn.items():
        [c] = [
            x.coefficients["radial_force"] for x in found.harmonics if abs(x.order - order) < 0.01
        ]
        assert c.least <= true * 1.001
        assert c.most >= true * 0.999
        assert c.value == pytest.approx(true, rel=0.05)


def test_the_command_names_the_speeds(tmp_path: Path) -> None:
    values = spectra(lambda i, order, f: float(order != 3.3 or i != 20))
    path = write_matrix(tmp_path / "a.csv", SPEEDS, values, np.arange(401.0))
    options = ["--speeds", "rpm", "--window", "hann", "--force-unit", "N", "--amplitude", "peak"]
    done = CliRunner().invoke(main, ["wheel", "--radial-force", str(path), *options])
    assert done.exit_code == 0, done.output
    assert "less than half of it, or absent, at 2600 rpm" in done.output
