"""A reaction wheel from its measured waterfalls: orders, coefficients with intervals and modes of a
wheel that is known, nothing in noise, what numbers must be said to be, and the budget of the result.
"""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner
from support import craft as whole
from support.craft_scenarios import scenario_of
from support.wheel_waterfalls import COEFFICIENTS, KINDS, RPM, KnownWheel, write_matrix

from microvib.cli.main import main
from microvib.errors import MicrovibError, OptionError
from microvib.io.file_access import NO_FILES
from microvib.io.waterfall_files import LAYOUTS, read_waterfall
from microvib.model.sentences import validate_part
from microvib.signals.ridges import PowerMap, Ridge, find_ridges
from microvib.signals.spectrum import noise_bandwidth
from microvib.studies.budget.files import OtherSource, Requirement, Wheel
from microvib.studies.budget.other_sources import contribution_of_other
from microvib.studies.budget.sums import assess
from microvib.studies.wheel import MeasuredWheel, measured_wheel
from microvib.studies.wheel_fit import bound_coefficient, fit_coefficient, read_order
from microvib.studies.wheel_maps import LOBES, Given, maps_of_files, maps_of_recording

SPEEDS = RPM * np.linspace(300.0, 4000.0, 60)
RATE, SAMPLES, HIGHEST = 1024.0, 1024, 400.0


def spectra(wheel: KnownWheel, kind: str, seed: int, **how: Any) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng([seed, KINDS.index(kind)])
    f, values = wheel.waterfall(kind, SPEEDS, RATE, SAMPLES, rng, **how)
    return f[f <= HIGHEST], values[:, f <= HIGHEST]


def power_map(wheel: KnownWheel, kind: str, seed: int, averages: int = 4) -> PowerMap:
    f, values = spectra(wheel, kind, seed, averages=averages)
    return PowerMap(SPEEDS, f, 0.5 * values**2 / noise_bandwidth("hann"), LOBES["hann"])


@pytest.fixture(scope="module")
def known() -> MeasuredWheel:
    wheel = KnownWheel(scatter=0.03, excited=0.3)
    return measured_wheel({kind: power_map(wheel, kind, 1) for kind in KINDS})


def test_orders_are_found_within_a_bin(known: MeasuredWheel) -> None:
    found = [x.order for x in known.harmonics]
    assert len(found) == 4
    bin_width = 1.0 / (SPEEDS[-1] / (2.0 * np.pi))
    assert found == pytest.approx([1.0, 2.0, 3.16, 5.6], abs=0.2 * bin_width)


def test_coefficients_are_those_of_the_wheel(known: MeasuredWheel) -> None:
    seen = 0
    for harmonic in known.harmonics:
        for kind, c in harmonic.coefficients.items():
            true = [
                x for order, x in COEFFICIENTS[kind].items() if abs(order - harmonic.order) < 0.01
            ]
            assert (c.value > 0.0) == bool(true)
            if true:
                seen += 1
                assert c.value == pytest.approx(true[0], rel=0.05)
                assert c.least <= c.value <= c.most
            else:
                assert c.most < 0.05 * max(COEFFICIENTS[kind].values())
    assert seen == sum(len(x) for x in COEFFICIENTS.values())


def test_modes_are_those_of_the_wheel(known: MeasuredWheel) -> None:
    by_motion = {x.motion: x for x in known.modes}
    assert len(known.modes) == 3
    for motion, (f0, damping) in {
        "rocking": (85.0, 0.01), "radial": (190.0, 0.01), "axial": (120.0, 0.012)
    }.items():  # fmt: skip
        assert by_motion[motion].frequency == pytest.approx(f0, rel=0.005)
        assert by_motion[motion].damping == pytest.approx(damping, rel=0.2)
    assert by_motion["rocking"].inertia_ratio == pytest.approx(1.6, abs=0.03)


def test_mains_are_named_and_no_harmonic(known: MeasuredWheel) -> None:
    constant = [x for x in known.unexplained if x.what.startswith("constant")]
    assert [x.frequency for x in constant] == pytest.approx([50.0], abs=1.0)
    assert "mains of 50 Hz" in constant[0].what


def test_whirl_that_noise_excites_is_found_without_any_harmonic() -> None:
    """A ridge that does not pass the origin."""
    wheel = KnownWheel(coefficients={}, mains=0.0, excited=0.4)
    found = measured_wheel({"radial_torque": power_map(wheel, "radial_torque", 5)})
    assert [x.motion for x in found.modes] == ["rocking"]
    assert found.modes[0].frequency == pytest.approx(85.0, rel=0.02)
    assert found.modes[0].inertia_ratio == pytest.approx(1.6, abs=0.1)
    assert found.modes[0].how == "ridge"
    assert not found.harmonics


@pytest.mark.parametrize("averages", [1, 8])
def test_nothing_is_found_in_noise(averages: int) -> None:
    wheel = KnownWheel(coefficients={}, mains=0.0)
    for seed in range(6):
        maps = [power_map(wheel, kind, seed, averages) for kind in KINDS[:2]]
        assert find_ridges(maps).ridges == ()


def test_intervals_hold_what_they_say() -> None:
    """95 % intervals over 60 tests, of coefficients that scatter from speed to speed and of ones near
    the noise.
    """
    coefficients = {"axial_torque": {1.0: 3e-7, 2.0: 6e-8, 3.16: 6e-9}}
    wheel = KnownWheel(coefficients=coefficients, scatter=0.05)
    ridges = [Ridge("order", (x,), 1e-4, 0.0, (), -9.0) for x in coefficients["axial_torque"]]
    ridges.append(Ridge("line", (50.0,), 0.3, 1.0, (), -9.0))
    inside, total, errors = 0, 0, []
    for seed in range(60):
        one = power_map(wheel, "axial_torque", 100 + seed)
        for order, true in coefficients["axial_torque"].items():
            reading = read_order(one, order, ridges)
            c = fit_coefficient(reading, np.ones(reading.speed.size))
            inside, total = inside + (c.least <= true <= c.most), total + 1
            if order == 1.0:
                errors.append(c.value / true - 1.0)
    assert inside / total > 0.90  # 0.95 less two standard deviations of 180 draws, and correlation
    assert abs(np.mean(errors)) < 0.01


def test_an_order_that_is_near_its_mode_at_all_speeds_says_so() -> None:
    speed = RPM * np.linspace(1000.0, 1100.0, 20)
    f = np.arange(0.0, 200.0)
    one = PowerMap(speed, f, np.full((20, 200), 1e-9), 2)
    reading = read_order(one, 2.0, [Ridge("order", (2.0,), 1e-4, 0.0, (), -9.0)])
    found = fit_coefficient(reading, np.full(reading.speed.size, 5.0))
    assert found.near_modes


# ---- Files ----


SAID = {"speeds": "rpm", "amplitude": "peak", "window": "hann", "force_unit": "N"}


@pytest.mark.parametrize(
    ("speeds", "unit"), [("rpm", RPM), ("rad/s", 1.0), ("rps", 2.0 * np.pi), ("deg/s", np.pi / 180)]
)
@pytest.mark.parametrize("turned", [False, True])
def test_a_file_is_read_as_it_is_said_to_be(
    tmp_path: Path, speeds: str, unit: float, turned: bool
) -> None:
    f, values = spectra(KnownWheel(), "axial_force", 3)
    corner = "Hz \\ speed" if turned else "speed | frequency"
    path = write_matrix(
        tmp_path / "a.csv", SPEEDS, values, f, corner=corner, unit=unit, turned=turned
    )
    given = Given(**{**SAID, "speeds": speeds})  # type: ignore[arg-type]
    one = maps_of_files({"axial_force": [str(path)]}, given)["axial_force"]
    assert one.speed == pytest.approx(SPEEDS, rel=1e-8)
    assert one.power == pytest.approx(0.5 * values**2 / 1.5, rel=1e-7)


@pytest.mark.parametrize("window", ["rectangular", "hann", "flat-top"])
@pytest.mark.parametrize("scaling", ["peak", "rms", "power", "psd"])
def test_amplitudes_are_the_same_however_they_are_given(
    tmp_path: Path, scaling: str, window: Any
) -> None:
    wheel = KnownWheel(coefficients={"axial_torque": {2.0: 1e-6}}, mains=0.0)
    base = "rms" if scaling == "power" else scaling
    f, values = spectra(wheel, "axial_torque", 3, scaling=base, window=window)
    values = values**2 if scaling == "power" else values
    milli = values * (1e6 if scaling in ("power", "psd") else 1e3)
    path = write_matrix(tmp_path / "a.csv", SPEEDS, milli, f)
    given = Given("rpm", scaling, window, None, "mN*m")
    one = maps_of_files({"axial_torque": [str(path)]}, given)["axial_torque"]
    reading = read_order(one, 2.0, [Ridge("order", (2.0,), 1e-4, 0.0, (), -9.0)])
    assert fit_coefficient(reading, np.ones(reading.speed.size)).value == pytest.approx(
        1e-6, rel=0.05 if window == "rectangular" else 0.005
    )


@pytest.mark.parametrize("key", ["speeds", "amplitude", "window", "force_unit"])
def test_what_is_not_said_is_asked_for(tmp_path: Path, key: str) -> None:
    f, values = spectra(KnownWheel(), "axial_force", 3, averages=1)
    path = write_matrix(tmp_path / "a.csv", SPEEDS, values, f)
    given = Given(**{**SAID, key: None})  # type: ignore[arg-type]
    with pytest.raises(OptionError, match=key):
        maps_of_files({"axial_force": [str(path)]}, given)


def test_a_table_that_does_not_say_where_speeds_are_is_refused(tmp_path: Path) -> None:
    f, values = spectra(KnownWheel(), "axial_force", 3, averages=1)
    path = write_matrix(tmp_path / "a.csv", SPEEDS, values, f, corner="")
    with pytest.raises(OptionError, match="does not say whether rows are speeds"):
        read_waterfall(path)
    assert read_waterfall(path, layout="speeds-in-rows").speed == pytest.approx(SPEEDS / RPM)


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (lambda t: t.replace("\n", "\nx,", 1), "is not a number|has .* cells"),
        (lambda t: "\n".join(t.split("\n")[:5]), "at least 8 and 64"),
        (lambda t: t.replace(",4,", ",4.5,", 1), "not evenly spaced"),
        (lambda t: t.replace("\n300,", "\n-300,", 1), "speeds above 0"),
        (lambda t: t.replace("\n300,", "\n300,-", 1), "not below 0"),
    ],
)
def test_a_broken_matrix_is_a_sentence(tmp_path: Path, change: Any, says: str) -> None:
    f, values = spectra(KnownWheel(), "axial_force", 3, averages=1)
    path = write_matrix(tmp_path / "a.csv", SPEEDS, values, f)
    path.write_text(change(path.read_text()))
    with pytest.raises(MicrovibError, match=says):
        read_waterfall(path)


def test_matrices_of_matlab_are_read_by_name(tmp_path: Path) -> None:
    from scipy.io import savemat

    f, values = spectra(KnownWheel(), "axial_force", 3, averages=1)
    path = tmp_path / "a.mat"
    savemat(path, {"speed_rpm": SPEEDS / RPM, "freq": f, "Fz": values, "Fx": values.T})
    for name in ("Fz", "Fx"):
        assert read_waterfall(path, name).values == pytest.approx(values)
    with pytest.raises(MicrovibError, match="name one"):
        read_waterfall(path)
    with pytest.raises(MicrovibError, match="no matrix 'Mz'"):
        read_waterfall(path, "Mz")


def test_a_square_matrix_of_matlab_is_read_as_it_is_said_and_magnitudes_of_a_complex_one(
    tmp_path: Path,
) -> None:
    from scipy.io import savemat

    speed, values = np.arange(1.0, 71.0), np.random.default_rng(1).uniform(1.0, 2.0, (70, 70))
    path = tmp_path / "a.mat"
    savemat(path, {"speed_rpm": speed, "freq": 10.0 * speed, "Fz": values * 1j})
    assert read_waterfall(path, "Fz", LAYOUTS[0]).values == pytest.approx(values)
    assert read_waterfall(path, "Fz", LAYOUTS[1]).values == pytest.approx(values.T)
    with pytest.raises(MicrovibError, match="by layout, speeds-in-rows or speeds-in-columns"):
        read_waterfall(path, "Fz")


def write_universal(
    path: Path,
    speeds: np.ndarray,
    f: np.ndarray,
    values: np.ndarray,
    unit: str = "N",
    of_speeds: str = "",
) -> Path:
    from microvib.io.uff_writing import Dataset58, Even, Place

    data = b""
    for speed, row in zip(speeds, values, strict=True):
        one = Dataset58("Fz", 12, row, Even(float(f[0]), float(f[1] - f[0])), unit, "", Place(7, 3))
        lines = one.encoded().split(b"\n")
        lines[8] = lines[8][:56] + f"{speed:13.5e}".encode() + lines[8][69:]
        if of_speeds:
            lines[12] = lines[12][:46].ljust(46) + f"{of_speeds:<20}".encode()
        data += b"\n".join(lines)
    path.write_bytes(data)
    return path


@pytest.mark.parametrize(
    ("unit", "of_speeds", "says"),
    [
        ("mN", "", "is N, and .* is in mN"),
        ("m/s^2", "", "is N, and .* is in m/s\\^2"),
        ("N rms", "", "is peak, and .* is in N rms"),
        ("N", "rad/s", "is rpm, and .* has them in rad/s"),
        ("N", "rpm", ""),
        ("NONE", "", ""),
        ("N pk", "1/min", ""),
    ],
)
def test_units_of_a_universal_file_are_those_that_were_stated(
    tmp_path: Path, unit: str, of_speeds: str, says: str
) -> None:
    f, values = spectra(KnownWheel(), "axial_force", 3, averages=1)
    path = write_universal(tmp_path / "a.uff", SPEEDS / RPM, f, values, unit, of_speeds)
    given = Given(**SAID)  # type: ignore[arg-type]
    if says:
        with pytest.raises(OptionError, match=says):
            maps_of_files({"axial_force": [str(path)]}, given)
    else:
        assert maps_of_files({"axial_force": [str(path)]}, given)


def test_two_spectra_at_one_speed_are_named(tmp_path: Path) -> None:
    f, values = spectra(KnownWheel(), "axial_force", 3, averages=1)
    speeds = SPEEDS / RPM
    speeds[3] = speeds[4]
    path = write_universal(tmp_path / "a.uff", speeds, f, values)
    with pytest.raises(MicrovibError, match="has 2 spectra at the speed"):
        read_waterfall(path)


def test_spectra_of_a_universal_file_have_their_speed_along_the_third_axis(tmp_path: Path) -> None:
    f, values = spectra(KnownWheel(), "axial_force", 3, averages=1)
    path = write_universal(tmp_path / "a.uff", SPEEDS / RPM, f, values)
    found = read_waterfall(path)
    assert found.speed == pytest.approx(SPEEDS / RPM, rel=1e-5)
    assert found.values == pytest.approx(values, rel=1e-9)
    assert read_waterfall(path, "7:+Z").values.shape == values.shape
    with pytest.raises(MicrovibError, match="has spectra of 7:\\+Z"):
        read_waterfall(path, "7:+X")


# ---- Run-ups ----


def test_a_run_up_with_a_tacho_gives_the_same_wheel(tmp_path: Path) -> None:
    import microvib as mv

    rate, duration = 1024.0, 240.0
    t = np.arange(int(rate * duration)) / rate
    turns = 5.0 * t + 0.5 * (60.0 / duration) * t**2
    speed = 2.0 * np.pi * (5.0 + 60.0 / duration * t)
    rng, force = np.random.default_rng(7), 4e-3
    x = force * rng.standard_normal(t.size)
    for order, c in {1.0: 2e-6, 3.16: 6e-7}.items():
        x += c * speed**2 * np.cos(2.0 * np.pi * order * turns)
    tacho = (np.sin(2.0 * np.pi * turns) > 0.9).astype(float)
    path = tmp_path / "up.mat"
    units = {"Fx": "N", "tacho": "V"}
    from microvib.io.recordings import write_recording

    write_recording(mv.Recording({"Fx": x, "tacho": tacho}, rate, units, "up"), path)
    maps = maps_of_recording(str(path), {"radial_force": ["Fx"]}, "tacho")
    found = measured_wheel(maps)
    assert [x.order for x in found.harmonics] == pytest.approx([1.0, 3.16], abs=0.005)
    for harmonic, true in zip(found.harmonics, (2e-6, 6e-7), strict=True):
        assert harmonic.coefficients["radial_force"].value == pytest.approx(true, rel=0.05)


# ---- The budget ----

PLACE = ["0.2 m", "-0.3 m", "0.1 m"]
CRAFT = whole.FullCraft(bandwidth=0.2, damping=[0.003] * 4)


def budget_of(requirement: dict[str, Any], **keys: Any) -> Any:
    given = {"speed": "600 rpm", "axis": [0, 0, 1], **keys}
    source = OtherSource(name="w", wheel=given, position=PLACE)
    one = contribution_of_other(source, scenario_of(CRAFT), NO_FILES)
    return assess(Requirement.model_validate({"limit": "1 mrad", **requirement}), [one], "rss")


FORCE = "N*s^2/rad^2"


@pytest.mark.parametrize(
    "asked", [{}, {"statistic": "bound"}, {"metric": "rpe", "window": "0.1 s"}]
)
@pytest.mark.parametrize("range_", [{}, {"speed_to": "1500 rpm"}])
def test_a_budget_counts_the_interval_of_a_coefficient(
    asked: dict[str, Any], range_: dict[str, str]
) -> None:
    exact = {"order": 1.0, "radial_force": f"1e-6 {FORCE}"}
    least, most = ({**exact, "radial_force": f"{x} {FORCE}"} for x in ("8e-7", "1.3e-6"))
    both = {
        **exact, "radial_force_least": f"8e-7 {FORCE}", "radial_force_most": f"1.3e-6 {FORCE}"
    }  # fmt: skip
    one = budget_of(asked, harmonics=[both], **range_)
    low, middle, high = (budget_of(asked, harmonics=[x], **range_) for x in (least, exact, most))
    assert one.value == pytest.approx(middle.value)
    assert one.most == pytest.approx(high.most, rel=0.006)
    assert one.most >= 0.999 * high.most
    assert one.least <= 1.001 * low.least
    assert one.least > 0.9 * low.least


def test_what_was_not_seen_counts_as_large_as_it_may_be() -> None:
    seen = {"order": 2.0, "axial_force": f"1e-9 {FORCE}"}
    bound = {**seen, "radial_force": f"0 {FORCE}", "radial_force_most": f"1e-6 {FORCE}"}
    large = {**seen, "radial_force": f"1e-6 {FORCE}"}
    for range_ in ({}, {"speed_to": "1500 rpm"}):
        one, without = (budget_of({}, harmonics=[x], **range_) for x in (bound, seen))
        assert one.value == pytest.approx(without.value, rel=1e-3)
        assert one.most == pytest.approx(budget_of({}, harmonics=[large], **range_).most, rel=0.02)


def test_nothing_is_judged_at_speeds_and_frequencies_that_were_not_measured() -> None:
    harmonics = [{"order": 1.0, "radial_force": f"1e-6 {FORCE}"}]
    measured = {"measured_from": "500 rpm", "measured_to": "1500 rpm", "harmonics": harmonics}
    assert budget_of({}, **measured).verdict == "pass"
    assert budget_of({}, **measured, speed_to="1500 rpm").verdict == "pass"
    for outside in ({"speed_to": "1600 rpm"}, {"speed": "400 rpm", "speed_to": "1000 rpm"}):
        found = budget_of({}, **{**measured, **outside})
        assert found.verdict == "not judged"
        assert "measured from 500 to 1500 rpm" in " ".join(found.why)
    found = budget_of({}, **measured, not_measured=["axial_force"])
    assert found.verdict == "not judged"
    assert "axial force: not measured" in " ".join(found.why)
    found = budget_of({}, **measured, one_axis=["radial_force"])
    assert found.verdict == "not judged"
    assert "radial force: measured about one of two axes" in " ".join(found.why)
    up_to = {**measured, "measured_up_to": "300 Hz"}
    assert budget_of({}, **up_to).verdict == "not judged"
    assert budget_of({"highest": "200 Hz"}, **up_to).verdict == "pass"


@pytest.mark.parametrize(
    ("end", "value", "says"), [("least", "2e-6", "above"), ("most", "5e-7", "below")]
)
def test_ends_that_do_not_hold_the_value_are_refused(end: str, value: str, says: str) -> None:
    harmonic = {
        "order": 1.0, "radial_force": f"1e-6 {FORCE}", f"radial_force_{end}": f"{value} {FORCE}"
    }  # fmt: skip
    given = {"speed": "600 rpm", "axis": [0, 0, 1], "harmonics": [harmonic]}
    with pytest.raises(MicrovibError, match=f"radial_force_{end}: .* is {says}"):
        validate_part(Wheel, given)


def test_a_load_in_which_an_order_is_always_beside_another_is_bounded() -> None:
    """Orders 2 and 2.01 are one in these spectra: what cannot be told apart is bounded, not zero."""
    wheel = KnownWheel(coefficients={"axial_torque": {2.0: 1e-7}}, mains=0.0)
    one = power_map(wheel, "axial_torque", 1)
    assert 1e-7 <= bound_coefficient(one, 2.01, np.ones(SPEEDS.size)) <= 1.2e-7


def test_an_interval_holds_the_coefficient_at_any_speed() -> None:
    """A coefficient that goes up and down by 30 % over the speed is no less known than it is constant."""
    one = power_map(KnownWheel(mains=0.0), "radial_force", 1)
    quiet = np.median(one.power)
    ripple = 1.0 + 0.3 * np.sin(2.0 * np.pi * SPEEDS / (RPM * 700.0))
    power = quiet + np.maximum(one.power - quiet, 0.0) * ripple[:, None] ** 2
    found = {}
    for name, given in (("constant", one), ("rippling", replace(one, power=power))):
        reading = read_order(given, 1.0, ())
        found[name] = fit_coefficient(reading, np.ones(reading.speed.size))
    value = found["constant"].value
    assert found["constant"].most < 1.1 * value
    assert found["rippling"].most >= 1.3 * value
    assert found["rippling"].least <= 0.7 * value


@pytest.mark.parametrize("second", [1.0, 0.7, 0.0])
def test_the_interval_of_a_radial_load_holds_either_axis(second: float) -> None:
    """A load that does not go round in a circle is larger along one axis than its mean square says."""
    wheel = KnownWheel()
    powers = [power_map(wheel, "radial_force", seed).power for seed in (1, 2)]
    quiet = np.median(powers[1])  # where nothing but noise is
    powers[1] = second**2 * np.maximum(powers[1] - quiet, 0.0) + quiet
    both = replace(
        power_map(wheel, "radial_force", 1), power=np.mean(powers, axis=0), axes=tuple(powers)
    )
    [found] = [x for x in measured_wheel({"radial_force": both}).harmonics if x.order == 1.0]
    [alone] = [
        x for x in measured_wheel({"radial_force": both.of_axes[0]}).harmonics if x.order == 1.0
    ]
    c = found.coefficients["radial_force"]
    large = alone.coefficients["radial_force"].value
    assert c.least <= second * large + 0.02 * large
    assert c.most >= large
    assert c.axes_differ == (second < 1.0)


def test_the_command_writes_what_a_budget_reads(tmp_path: Path) -> None:
    wheel = KnownWheel()
    options = []
    for kind in ("radial_force", "radial_torque"):
        f, values = spectra(wheel, kind, 4)
        write_matrix(tmp_path / f"{kind}.csv", SPEEDS, values, f)
        options += [f"--{kind.replace('_', '-')}", str(tmp_path / f"{kind}.csv")]
    options += ["--speeds", "rpm", "--amplitude", "peak", "--window", "hann"]
    options += ["--force-unit", "N", "--torque-unit", "N*m", "--out", str(tmp_path / "out")]
    done = CliRunner().invoke(main, ["wheel", *options])
    assert done.exit_code == 0, done.output
    assert "axial force, axial torque: not measured" in " ".join(done.output.split())
    out = tmp_path / "out"
    assert {"harmonics.csv", "wheel.yaml", "waterfall_radial_force.png", "report.html"} <= {
        x.name for x in out.iterdir()
    }
    text = (out / "wheel.yaml").read_text()
    from microvib.studies.budget.files import Sources, read_file

    with pytest.raises(MicrovibError, match="axis"):
        read_file(out / "wheel.yaml", Sources)
    assert "not_measured: [axial_force, axial_torque]" in text
    assert "one_axis: [radial_force, radial_torque]" in text
    assert "measured about one of two axes" in " ".join(done.output.split())
    text = text.replace("# position", "position").replace("# axis", "axis")
    text = text.replace("[axial_force, axial_torque]", "[]")
    text = text.replace("[radial_force, radial_torque]", "[]")
    (out / "filled.yaml").write_text(text)
    from microvib.io.file_access import WORKING_FOLDER

    (source,) = read_file(out / "filled.yaml", Sources).sources
    files = WORKING_FOLDER.in_folder_of(str(out / "filled.yaml"))
    one = contribution_of_other(source, scenario_of(CRAFT), files)
    found = assess(
        Requirement.model_validate({"limit": "1 mrad", "highest": "390 Hz"}), [one], "rss"
    )
    assert found.verdict == "pass"
    assert found.most > found.value
