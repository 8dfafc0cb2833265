"""The spacecraft in a run's report: its figures are those of the lines, its picture has the array at its angle."""

import csv
import math
import re
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from scipy import signal
from support.run_reports import run_report, run_text

import microvib as mv
from microvib.analysis.hub_lines import hub_lines
from microvib.analysis.run import RunResult
from microvib.cli.main import main
from microvib.reports import craft
from microvib.reports.densities import densities_csv
from microvib.reports.document import Section, Table
from microvib.reports.moving import box_corners
from microvib.reports.numbers import plain_number
from microvib.results import Measure
from microvib.solve.motion import Motion

EXAMPLE = Path(__file__).parents[1] / "examples" / "spacecraft.yaml"
MICRORADIANS = Measure("µrad", 1e-6)
SHORT = {"record.settle": "5 s", "record.duration": "10 s"}


@pytest.fixture(scope="module")
def result() -> RunResult:
    return mv.run_scenario(mv.load_scenario(EXAMPLE, dict(SHORT)))


@pytest.fixture(scope="module")
def motion(result: RunResult) -> Motion:
    assert result.motion is not None
    return result.motion


@pytest.fixture(scope="module")
def sections(result: RunResult, motion: Motion) -> dict[str, Section]:
    document = run_report(motion, result.table)
    assert any(fact.label.startswith("line of sight, RPE in 1 s") for fact in document.facts)
    return {section.title: section for section in document.sections}


def tables(section: Section) -> list[Table]:
    return [block for block in section.blocks if isinstance(block, Table)]


def number(cell: str) -> float:
    return float(
        re.sub(
            r" × 10(.*)",
            lambda m: "e" + m[1].translate(str.maketrans("⁻⁰¹²³⁴⁵⁶⁷⁸⁹", "-0123456789")),
            cell,
        )
    )


def test_tables_are_those_of_the_lines(
    result: RunResult, motion: Motion, sections: dict[str, Section]
) -> None:
    hub = hub_lines(motion, result.table)
    told = re.search(
        r"Line of sight, RPE in 1 s.*: (\S+) µrad; largest contributors, rms: (\S+) (\S+) (\S+),",
        run_text(result),
    )
    assert told is not None
    name, size = hub.ranking("rpe", 1.0)[0]
    assert (told[2], float(told[3])) == (
        name,
        pytest.approx(size / {"µrad": 1e-6, "nrad": 1e-9}[told[4]], rel=1e-2),
    )
    (loads,) = tables(sections["Loads on the hub"])
    rows = {row.cells[0]: row.cells for row in loads.rows}
    k = hub.names.index("drive_1")
    assert [number(x) for x in rows["drive_1"][2:]] == pytest.approx(
        1e3 * np.abs(hub.loads[k]), rel=1e-3
    )
    radial, pixels, ranks = tables(sections["Line of sight"])
    sums = {(row["metric"], row["window_s"]): row["radial_rad"] for row in hub.totals()}
    for metric, row, other in zip(
        ("ape", "mpe", "rpe", "smear", "jitter"), radial.rows, pixels.rows, strict=False
    ):
        for window, micro, pixel in zip(hub.windows, row.cells[1:], other.cells[1:], strict=True):
            assert number(micro) == pytest.approx(1e6 * sums[metric, window], rel=6e-3)
            assert number(pixel) == pytest.approx(sums[metric, window] / 0.5e-6, rel=6e-3)
    assert ranks.rows[0].cells[2].startswith(hub.ranking("rpe", 0.01)[0][0])


def test_what_rings_after_the_start_is_said_beside_the_figure_that_it_is_in(
    result: RunResult, motion: Motion
) -> None:
    """A settled motion has none of it; after five seconds of settling most of the figure is the start's."""
    hub = hub_lines(motion, result.table)
    assert {"array_mode_1", "array_mode_2"} <= set(hub.rings)
    assert not [name for name in hub.rings if name.startswith(("drive", "full"))]
    (fact,) = craft.pointing_facts(hub)
    rings = [name in hub.rings for name in hub.names]
    squares = hub.mean_squares("rpe", 1.0).sum(axis=1)
    part = 100.0 * squares[rings].sum() / squares.sum()
    assert part > 10.0
    assert (
        fact.label
        == f"line of sight, RPE in 1 s, {plain_number(part, 2)} % of its square ringing after the start"
    )
    steady = mv.run_scenario(result.scenario.with_({"record.start": "steady"}))
    assert steady.state is not None
    assert hub_lines(steady.state, steady.table).rings == ()


def test_densities_add_up_to_what_moves(motion: Motion) -> None:
    """From 0.5 Hz on, against the angles themselves, less their slow part by a fit of tones below that."""
    drawing = craft.angles_picture(motion, MICRORADIANS).draw()
    (frequency, up), (_, down) = (np.array(line.get_data()) for line in drawing.axes[1].lines)
    assert up[-1] == pytest.approx(down[0])
    squares = up**2 + down**2
    assert squares == pytest.approx(np.full(squares.size, up[-1] ** 2), rel=1e-9)
    t, wanted = motion.time - motion.time[0], 0.0
    slow = [np.ones_like(t), t, t**2] + [
        f(2 * np.pi * k * 0.1 * t / 2) for k in range(1, 8) for f in (np.cos, np.sin)
    ]
    base = np.array(slow).T
    for name in ("los_x", "los_y"):
        rest = motion[name] - base @ np.linalg.lstsq(base, motion[name], rcond=None)[0]
        wanted += np.var(rest)
    assert np.interp(0.8, frequency, down) == pytest.approx(1e6 * math.sqrt(wanted), rel=0.1)


def test_the_picture_turns_the_array_and_not_the_drive_axis() -> None:
    """Where the array's middle is drawn follows its centre of mass, turned about the drive axis."""
    scenario = mv.load_scenario(EXAMPLE)
    assert scenario.array.rigid_body is not None
    center, root = np.array(scenario.array.rigid_body.center_of_mass), np.array([0.35, 0.9, -0.2])
    for angle in (0.0, 137.0, -90.0):
        turned = scenario.with_({"spacecraft.array_angle": f"{angle} deg"})
        c, s = math.cos(math.radians(angle)), math.sin(math.radians(angle))
        # Array z is along hub y; at angle 0 array x is hub x, and array y hub y cross x, -z.
        x, y = np.array([c, 0.0, -s]), np.array([-s, 0.0, -c])
        middle = root + center[0] * x + center[1] * y + center[2] * np.array([0.0, 1.0, 0.0])
        texts = {text.get_text(): text.xy for text in craft.draw_craft(turned).axes[0].texts}
        assert texts[f"ψ = {angle:.4g}°".replace("-", "−")] == pytest.approx(craft._VIEW @ middle)


def test_a_box_has_the_inertia_that_it_stands_for() -> None:
    a, b, c, m = 1.2, 0.3, 2.0, 7.0
    corners = box_corners(m, m / 12.0 * np.diag([b * b + c * c, a * a + c * c, a * a + b * b]))
    assert sorted(np.ptp(corners, axis=0)) == pytest.approx(sorted((a, b, c)))
    assert np.ptp(corners, axis=0) == pytest.approx([a, b, c])


def test_densities_add_up_to_what_they_are_of(motion: Motion) -> None:
    """Above a frequency to the rms that a filter leaves; about a line of the line of sight to its mean square."""
    table = list(csv.DictReader(densities_csv(motion).splitlines()))
    f, found = np.array([float(row["frequency_hz"]) for row in table]), {}
    for name in table[0]:
        found[name] = np.array([float(row[name]) for row in table])
    acceleration = motion.hub("center", accelerations=True)
    for name, unit, samples in (
        ("mx", "n_m", motion["Mx"]), ("fz", "n", motion["Fz"]), ("center_ay", "m_s2", acceleration[:, 1]),
        ("center_alpha_z", "rad_s2", acceleration[:, 5]),
    ):  # fmt: skip
        high = signal.sosfilt(
            signal.butter(8, 30.0, "high", fs=motion.sample_rate, output="sos"), samples
        )[8192:]
        up, down = found[f"{name}_rms_up_{unit}"], found[f"{name}_rms_down_{unit}"]
        assert np.interp(30.0, f, down) == pytest.approx(high.std(), rel=0.03)
        assert up[-1] == down[0]
        assert np.sum(found[f"{name}_psd_{unit}2_hz"]) * f[1] == pytest.approx(
            up[-1] ** 2, rel=0.01
        )
    lines = hub_lines(motion, mv.find_lines(motion))
    k = lines.names.index("drive_1")
    near = np.abs(f - lines.frequency[k]) < 3.0 * f[1]
    square = np.sum(found["los_x_psd_rad2_hz"][near]) * f[1]
    assert square == pytest.approx(0.5 * lines.amplitude[k, 0] ** 2, rel=0.02)


@pytest.mark.release
def test_a_folder_of_a_craft_may_be_written_again(tmp_path: Path) -> None:
    out = tmp_path / "run"
    call = [
        "run",
        str(EXAMPLE),
        "--out",
        str(out),
        "--set",
        "record.settle=1 s",
        "--set",
        "record.duration=4 s",
    ]
    assert CliRunner().invoke(main, call).exit_code == 0
    again = CliRunner().invoke(main, [*call, "--overwrite"])
    assert again.exit_code == 0, again.output
    ground = CliRunner().invoke(main, ["run", "state-1", *call[2:], "--overwrite"])
    assert ground.exit_code == 0, ground.output
    assert not (out / "loads.csv").exists()
    report = CliRunner().invoke(main, ["report", str(out)])
    assert report.exit_code == 0, report.output


def test_a_free_craft_is_silent_below_a_twentieth_of_a_hertz() -> None:
    changes = {
        "record.settle": "5 s",
        "record.duration": "100 s",
        "record.sample_rate": "1024 Hz",
        "spacecraft.attitude_control": "none",
    }
    motion = mv.simulate(mv.load_scenario(EXAMPLE, changes))
    assert "from 0.05 Hz on" in craft.angles_picture(motion, MICRORADIANS).caption


def test_lines_of_the_hub_have_as_many_members_as_those_of_the_torque(tmp_path) -> None:
    scenario = mv.load_scenario(
        "examples/spacecraft.yaml", {"record.settle": "0.2 s", "record.duration": "1 s"}
    )

    def orders(names) -> set[int]:
        return {
            int(name.removeprefix("drive_")) for name in names if re.fullmatch(r"drive_\d+", name)
        }

    for harmonics in (3, 10):
        result = mv.run_scenario(scenario, harmonics=harmonics)
        assert (
            orders(result.hub.names)
            == orders(x.name for x in result.table)
            == set(range(1, harmonics + 1))
        )
        mv.write_run(result, tmp_path / str(harmonics))
        again = mv.read_run(tmp_path / str(harmonics))
        assert hub_lines(again.motion, again.table).names == result.hub.names


def test_a_parked_drive_with_a_rigid_array_has_a_report_without_lines(tmp_path: Path) -> None:
    example = str(Path(__file__).parents[1] / "examples" / "spacecraft.yaml")
    at_rest = ["--set", "tracking.rate=0 deg/s", "--set", "array.modes=[]"]
    short = ["--set", "record.duration=2 s", "--set", "record.settle=1 s"]
    arguments = ["run", example, *at_rest, *short, "--out", str(tmp_path / "o")]
    done = CliRunner().invoke(main, arguments, prog_name="microvib")
    assert done.exit_code == 0, done.output
    assert (tmp_path / "o" / "report.html").exists()
