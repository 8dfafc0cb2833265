"""Orders of a wheel that are not known exactly: those that a run-up shows against known ones, and the bounds of a
budget against wheels of all orders that they may have.
"""

from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from support import craft as whole
from support.craft_scenarios import scenario_of
from support.tiers import sweep
from support.wheel_waterfalls import RPM, KnownWheel

import microvib as mv
from microvib.errors import MicrovibError, ScenarioError
from microvib.io.file_access import NO_FILES, WORKING_FOLDER
from microvib.io.recordings import write_recording
from microvib.reports.wheel import harmonics_csv
from microvib.signals.ridges import PowerMap
from microvib.signals.spectrum import Window, noise_bandwidth
from microvib.studies.budget.files import OtherSource, Requirement
from microvib.studies.budget.other_sources import contribution_of_other
from microvib.studies.budget.sums import Assessment, assess
from microvib.studies.wheel import MeasuredWheel, measured_wheel
from microvib.studies.wheel_maps import LOBES, maps_of_recording

# ---- Orders that a run-up shows ----

RATE, LOW, HIGH = 2048.0, 1000.0, 3000.0
TRUE = {1.0: 1e-6, 4.0: 2e-7}


def ramp(first: float, last: float, duration: float) -> np.ndarray:
    """Speeds of a run-up or run-down [rpm]."""
    return np.linspace(first, last, int(RATE * duration))


def stairs(number: int, hold: float) -> np.ndarray:
    """Speeds that are held one after the other [rpm]."""
    return np.repeat(np.linspace(LOW, HIGH, number), int(RATE * hold))


RUNS = {
    "up in 8 s": (ramp(LOW, HIGH, 8.0), 1e-3),
    "down in 8 s": (ramp(HIGH, LOW, 8.0), 1e-3),
    "up in 20 s, noisy": (ramp(LOW, HIGH, 20.0), 1e-2),
    "21 held": (stairs(21, 2.0), 1e-3),
    "down in 40 s": (ramp(HIGH, LOW, 40.0), 1e-3),
    "up in 5 s": (ramp(LOW, HIGH, 5.0), 1e-3),
}


def of_run(path: Path, rpm: np.ndarray, noise: float) -> MeasuredWheel:
    """The wheel that a recording shows, with a tacho whose edges are known to a sample."""
    speed, rng = RPM * rpm, np.random.default_rng(2)
    angle = np.cumsum(speed) / RATE
    channels = {}
    for name, turned in (("Fx", 0.0), ("Fy", -0.5 * np.pi)):
        x = noise * rng.standard_normal(rpm.size)
        for order, c in TRUE.items():
            x += c * speed**2 * np.cos(order * angle + order + turned)
        channels[name] = x
    channels["tacho"] = 5.0 * ((angle / (2.0 * np.pi)) % 1.0 < 0.1)
    units = {"Fx": "N", "Fy": "N", "tacho": "V"}
    write_recording(mv.Recording(channels, RATE, units, "run"), path)
    return measured_wheel(maps_of_recording(str(path), {"radial_force": ["Fx", "Fy"]}, "tacho"))


@pytest.mark.parametrize("name", sweep([*RUNS], "up in 8 s", "down in 8 s", "21 held"))
def test_orders_of_a_run_are_those_of_the_wheel(tmp_path: Path, name: str) -> None:
    rpm, noise = RUNS[name]
    found = of_run(tmp_path / "run.mat", rpm, noise)
    assert len(found.harmonics) == len(TRUE)
    for one, (order, c) in zip(found.harmonics, TRUE.items(), strict=True):
        assert abs(one.order - order) <= 2.0 * one.uncertainty
        assert abs(one.order - order) < 2e-4 * order
        assert one.uncertainty < 3e-3 * order  # a run-up of 5 s does not exclude others as near
        assert one.coefficients["radial_force"].least < c < one.coefficients["radial_force"].most
    low, high = (x / RPM for x in found.speeds)
    assert low >= LOW * (1.0 - 5e-4)
    assert high <= HIGH * (1.0 + 5e-4)


@pytest.mark.parametrize("window", ["hann", "flat-top", "rectangular"])
@pytest.mark.parametrize("weaker", [1.0, 0.5])
def test_orders_that_share_bins_are_told_apart(window: Window, weaker: float) -> None:
    near = 1.0 - {"hann": 0.057, "flat-top": 0.09, "rectangular": 0.057}[window]
    sizes = {1.0: 1e-6, near: weaker * 1e-6, 1.786: 7e-7}
    wheel = KnownWheel(
        {"radial_force": sizes}, radial=None, mains=0.0, ways=dict.fromkeys(sizes, 1.0)
    )
    speeds = RPM * np.linspace(500.0, 3000.0, 40)
    rng = np.random.default_rng(7)
    f, values = wheel.waterfall("radial_force", speeds, 512.0, 512, rng, averages=8, window=window)
    power = 0.5 * values**2 / noise_bandwidth(window)
    found = measured_wheel(
        {"radial_force": PowerMap(speeds, f, power, LOBES[window], window=window)}
    )
    for order in sizes:
        assert any(abs(x.order - order) <= 4.0 * x.uncertainty for x in found.harmonics)
    assert len(found.harmonics) == len(sizes)


def test_the_table_for_a_budget_has_four_standard_uncertainties(tmp_path: Path) -> None:
    found = of_run(tmp_path / "run.mat", *RUNS["up in 8 s"])
    (tmp_path / "harmonics.csv").write_text(harmonics_csv(found))
    given = {"speed": "1200 rpm", "axis": [0, 0, 1], "table": str(tmp_path / "harmonics.csv")}
    source = OtherSource(name="w", wheel=given, position=PLACE)
    one = contribution_of_other(source, scenario_of(CRAFT), WORKING_FOLDER)
    for k, harmonic in enumerate(found.harmonics):
        about = 20.0 * (4.0 * harmonic.uncertainty + 1e-4 * harmonic.order)
        assert one.off[k] == pytest.approx(about, rel=0.05)


# ---- A budget ----

PLACE = ["0.2 m", "-0.3 m", "0.1 m"]
CRAFT = whole.FullCraft(bandwidth=0.2, damping=[0.003] * 4)
FORCE = "N*s^2/rad^2"
ERROR = 0.004
SPEED = 600.0
"""[rpm], 10 Hz."""


def budget_of(
    requirement: dict[str, Any], orders: tuple[float, ...], error: float, **keys: Any
) -> Assessment:
    harmonics = [
        {"order": x, "radial_force": f"1e-6 {FORCE}", **({"order_error": error * x} if error else {})}
        for x in orders
    ]  # fmt: skip
    given = {"speed": f"{SPEED} rpm", "axis": [0, 0, 1], "harmonics": harmonics, **keys}
    source = OtherSource(name="w", wheel=given, position=PLACE)
    one = contribution_of_other(source, scenario_of(CRAFT), NO_FILES)
    return assess(Requirement.model_validate({"limit": "1 mrad", **requirement}), [one], "rss")


def modes() -> list[float]:
    """Natural frequencies of the craft [Hz]."""
    from microvib.model.linear import coupled_modes

    return [x.frequency for x in coupled_modes(scenario_of(CRAFT))]


MODE = max(f for f in modes() if f < 60.0)
NOTCH = [
    {"frequency": f"{f} Hz", "amplitude": f"{a} urad"}
    for f, a in ((5, 100), (10.01, 100), (10.012, 1), (10.014, 100), (200, 100))
]
ASKED = {
    "end of a band": {"highest": "9.98 Hz"},
    "beginning of a band": {"lowest": "10.02 Hz"},
    "window": {"metric": "mpe", "window": "20 s"},
    "bound": {"statistic": "bound", "metric": "rpe", "window": "10 s"},
    "notch": {"limit": None, "curve": NOTCH},
    "mode": {"axis": "x"},
}
RANGES = {"one speed": {}, "range": {"speed_to": "605 rpm"}}


def orders_of(name: str) -> tuple[float, ...]:
    return (0.1 * MODE * 1.003, 2.0) if name == "mode" else (1.0, 2.0)


CASES = [f"{name}, {range_}" for range_ in RANGES for name in ASKED]
WIDE = ("window, range", "bound, range", "bound, one speed", "window, one speed")
"""Cases in which bounds are wider than what some orders show."""
SHORT = [f"{name}, one speed" for name in ASKED]


@pytest.mark.parametrize("case", sweep(CASES, *SHORT, "end of a band, range", "mode, range"))
def test_a_budget_holds_wheels_of_all_orders_that_there_may_be(case: str) -> None:
    name, range_ = case.split(", ")
    asked = {k: x for k, x in ASKED[name].items() if x is not None}
    if "curve" in asked:
        asked["limit"] = None
    keys, orders = RANGES[range_], orders_of(name)
    unknown = budget_of(asked, orders, ERROR, **keys)
    assert unknown.most is not None
    assert unknown.least is not None
    many = range_ == "one speed" and name != "bound"
    parts = np.r_[np.linspace(-0.999, 0.999, 13 if many else 3), 0.3]  # 0.3 meets the notch
    sizes = []
    for first, second in product(parts, (-1.0, 0.0, 1.0)):
        exact = tuple(
            x * (1.0 + ERROR * part) for x, part in zip(orders, (first, second), strict=True)
        )
        one = budget_of(asked, exact, 0.0, **keys)
        size = one.value / one.limit  # of a curve the limit is that where the worst line is
        assert size <= unknown.most / unknown.limit * (1.0 + 1e-6), (first, second)
        assert size >= unknown.least / unknown.limit * (1.0 - 1e-6), (first, second)
        sizes.append(size)
    if case not in WIDE:
        assert unknown.most / unknown.limit < 1.02 * max(sizes)


def test_orders_without_an_error_are_known_as_well_as_clocks() -> None:
    given = {
        "speed": f"{SPEED} rpm", "axis": [0, 0, 1], "harmonics": [{"order": 3.0, "axial_force": f"1e-6 {FORCE}"}]
    }  # fmt: skip
    source = OtherSource(name="w", wheel=given, position=PLACE)
    one = contribution_of_other(source, scenario_of(CRAFT), NO_FILES)
    assert one.off == pytest.approx([30.0 * 1e-4], rel=1e-9)


@pytest.mark.parametrize(
    ("error", "says"), [("0.3", "order_error: 0.3 is more than 0.1 of order"), ("-1", "order_error")]
)  # fmt: skip
def test_an_error_that_is_no_error_is_refused(error: str, says: str) -> None:
    harmonic = {"order": 1.0, "order_error": error, "radial_force": f"1e-6 {FORCE}"}
    with pytest.raises((MicrovibError, ScenarioError, ValueError), match=says):
        OtherSource(
            name="w",
            wheel={"speed": "600 rpm", "axis": [0, 0, 1], "harmonics": [harmonic]},
            position=PLACE,
        )
