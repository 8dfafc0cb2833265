"""A budget of a hub without attitude control passes nothing that reaches below 0.05 Hz, whatever kind of
source does; and densities of loads from 0 Hz on.
"""

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from support import craft as whole
from support.craft_scenarios import scenario_of
from support.tiers import sweep

import microvib as mv
from microvib.analysis.lines import expected_in
from microvib.analysis.pointing import HubLines
from microvib.io.file_access import FileAccess
from microvib.model.scenario import Scenario
from microvib.studies.budget.files import OtherSource, Requirement
from microvib.studies.budget.other_sources import contribution_of_other
from microvib.studies.budget.recording_source import contribution_of_recording
from microvib.studies.budget.sources import (
    Contribution,
    contribution_of_run,
    with_side_lines_of_other,
)
from microvib.studies.budget.sums import assess
from microvib.testdata.recording import Recording
from microvib.units import Si

EXAMPLES = Path(__file__).parents[1] / "examples"
AT = {"position": ["0.2 m", "-0.3 m", "0.1 m"]}
TABLES = {
    "slow_lines": ("lines", "line,frequency_hz,mx_n_m\nslow,0.03,1e-4\nfast,3,1e-4\n"),
    "slow_density": ("density", "frequency_hz,mx_n2_m2_hz\n0.01,1e-8\n0.1,1e-8\n"),
    "density_from_0": ("density", "frequency_hz,mx_n2_m2_hz\n0,1e-8\n0.1,1e-8\n"),
}
WHEELS = {
    "straddling": (0.5, 20.0, 1.0),
    "from_nearly_0": (0.001, 60.0, 1.0),
    "low_order": (10.0, 100.0, 0.25),
    "all_below": (0.5, 2.0, 1.0),
    "one_speed": (0.5, None, 1.0),
}
ASKED: dict[str, dict[str, object]] = {
    "rms": {},
    "bound": {"metric": "mpe", "window": "10 s", "statistic": "bound"},
    "level": {"metric": "mpe", "window": "10 s", "statistic": "level"},
    "lowest": {"lowest": "0.005 Hz"},
    "highest": {"highest": "0.06 Hz"},
    "curve": {
        "limit": None,
        "curve": [
            {"frequency": "0.001 Hz", "amplitude": "1 rad"},
            {"frequency": "100 Hz", "amplitude": "1 rad"},
        ],
    },
}


def requirement(**keys: object) -> Requirement:
    given = {"metric": "ape", "limit": "1 rad", "axis": "x", **keys}
    return Requirement(**{key: value for key, value in given.items() if value is not None})


def wheel(low: float, high: float | None, order: float = 1.0) -> OtherSource:
    """A wheel of speeds in rpm, with a torque that turns with it."""
    given = {
        "speed": f"{low} rpm",
        "axis": [0, 0, 1],
        "harmonics": [{"order": order, "radial_torque": "1e-3 N*m*s^2/rad^2"}],
    }
    if high is not None:
        given["speed_to"] = f"{high} rpm"
    return OtherSource(name="source", wheel=given, **AT)


def contribution(kind: str, scenario: Scenario, folder: Path) -> Contribution:
    if kind in WHEELS:
        return contribution_of_other(wheel(*WHEELS[kind]), scenario, FileAccess(folder))
    key, text = TABLES[kind]
    (folder / "table.csv").write_text(text)
    given = OtherSource(name="source", **{key: "table.csv"}, **AT)
    return contribution_of_other(given, scenario, FileAccess(folder))


@pytest.mark.parametrize(
    "kind", sweep([*WHEELS, *TABLES], "straddling", "all_below", "slow_lines", "density_from_0")
)
def test_what_reaches_below_the_lowest_of_a_free_hub_passes_nothing_there(
    tmp_path: Path, kind: str
) -> None:
    """Of any kind of requirement; above and with attitude control it is judged."""
    free = scenario_of(whole.FullCraft())
    one = contribution(kind, free, tmp_path)
    every = kind == "straddling"
    for name, keys in ASKED.items() if every else [("highest", ASKED["highest"])]:
        found = assess(requirement(**keys), [one], "rss")
        assert found.verdict == "not judged", name
        assert math.isinf(found.most), name
        assert any(
            "below 0.05 Hz, where without spacecraft.attitude_control" in w for w in found.why
        )
        assert any("lowest: 0.05 Hz or more in the requirement" in w for w in found.why)
    assert assess(requirement(lowest="0.05 Hz"), [one], "rss").verdict == "pass"
    controlled = contribution(kind, scenario_of(whole.FullCraft(bandwidth=0.2)), tmp_path)
    assert assess(requirement(), [controlled], "rss").verdict == "pass"


def test_a_wheel_names_the_speed_from_which_it_is_judged() -> None:
    free, no_files = scenario_of(whole.FullCraft()), FileAccess(Path())
    slow = contribution_of_other(wheel(0.5, 200.0, 0.25), free, no_files)
    assert "or wheel.speed: 12 rpm or more" in assess(requirement(), [slow], "rss").why[0]
    faster = contribution_of_other(wheel(12.0, 200.0, 0.25), free, no_files)
    assert assess(requirement(), [faster], "rss").verdict == "pass"


def test_lines_and_densities_of_nothing_below_the_lowest_are_judged(tmp_path: Path) -> None:
    free = scenario_of(whole.FullCraft())
    (tmp_path / "l.csv").write_text("frequency_hz,mx_n_m\n0.03,0\n3,1e-4\n")
    (tmp_path / "s.csv").write_text("frequency_hz,mx_n2_m2_hz\n0,0\n0.06,0\n0.1,1e-8\n")
    for key, name in (("lines", "l.csv"), ("density", "s.csv")):
        given = OtherSource(name="source", **{key: name}, **AT)
        one = contribution_of_other(given, free, FileAccess(tmp_path))
        assert assess(requirement(), [one], "rss").verdict == "pass"


def test_a_slow_line_that_was_found_in_a_run_on_a_free_hub_is_told() -> None:
    """It is none of those that are expected, and the hub's drift hides it in the line of sight."""
    free = scenario_of(whole.FullCraft(), **{"record.start": "steady"})
    result = mv.run_scenario(free)
    own, _ = contribution_of_run("drive", free, result)
    assert not any("attitude_control" in gap.why for gap in own.gaps)
    slow = replace(result.table.lines[0], name="other_1", kind="other", frequency=0.03)
    table = replace(result.table, lines=(*result.table.lines, slow))
    one, _ = contribution_of_run("drive", free, replace(result, table=table))
    found = assess(requirement(), [one], "rss")
    assert found.verdict == "not judged"
    assert any("other_1, below 0.05 Hz" in why for why in found.why)


@pytest.mark.parametrize("slow", [0.0, 0.05])
def test_a_recording_says_nothing_below_the_lowest_of_a_free_hub(slow: float) -> None:
    """Nor does it where a tone of 0.02 Hz is in it, for which it is too short."""
    free = scenario_of(whole.FullCraft(), **{"record.sample_rate": Si(256.0)})
    rate, rng = 256.0, np.random.default_rng(1)
    t = np.arange(int(60.0 * rate)) / rate
    names = ("Fx", "Fy", "Fz", "Mx", "My", "Mz")
    loads = {name: 1e-6 * rng.normal(size=t.size) for name in names}
    for line in expected_in(free, rate, 2):
        if line.of_clock:
            for name in names:
                loads[name] += 1e-3 * np.cos(2.0 * np.pi * line.frequency * t + rng.uniform(0, 6))
    loads["Mx"] += slow * np.cos(2.0 * np.pi * 0.02 * t)
    units = {name: "N" if name[0] == "F" else "N*m" for name in names}
    one = contribution_of_recording("drive", free, Recording(loads, rate, units, "table"), 2)
    found = assess(requirement(highest="0.2 Hz"), [one], "rss")
    assert found.verdict == "not judged"
    assert any("the recording, below 0.05 Hz" in why for why in found.why)
    above = requirement(lowest="0.05 Hz", highest="0.2 Hz")
    assert assess(above, [one], "rss").verdict == "pass"


def test_a_density_of_loads_from_0_hz_has_the_static_response(tmp_path: Path) -> None:
    """A torque that hardly changes turns a controlled hub by what the control's stiffness allows."""
    full = whole.FullCraft(bandwidth=0.2)
    density, highest = 1e-8, 1e-4
    (tmp_path / "s.csv").write_text(f"frequency_hz,mx_n2_m2_hz\n0,{density}\n{highest},{density}\n")
    given = OtherSource(name="source", density="s.csv", **AT)
    one = contribution_of_other(given, scenario_of(full), FileAccess(tmp_path))
    K, C = full.powered()
    s, on = 2j * np.pi * 0.5 * highest, np.zeros(full.n)
    on[3] = 1.0
    angle = np.abs(np.linalg.solve(s**2 * full.M + s * C + K, on)[3])
    found = assess(requirement(), [one], "rss")
    assert found.value == pytest.approx(math.sqrt(density * highest) * angle, rel=1e-3)
    assert found.verdict == "pass"


@pytest.mark.release
def test_a_density_from_0_hz_is_the_end_of_those_from_ever_lower_frequencies(
    tmp_path: Path,
) -> None:
    scenario = scenario_of(whole.FullCraft(bandwidth=0.2))
    found = []
    for first in (0.0, 1e-7, 1e-3):
        (tmp_path / "s.csv").write_text(
            f"frequency_hz,fx_n2_hz,mx_n2_m2_hz\n{first},1e-8,1e-8\n1,1e-8,1e-8\n"
        )
        given = OtherSource(name="source", density="s.csv", **AT)
        one = contribution_of_other(given, scenario, FileAccess(tmp_path))
        found.append(assess(requirement(), [one], "rss"))
    assert found[0].value == pytest.approx(found[1].value, rel=1e-5)
    assert found[0].most == pytest.approx(found[1].most, rel=1e-5)
    assert found[0].value > found[2].value


def test_slow_lines_on_a_controlled_hub_move_a_second_drive() -> None:
    """Only without attitude control do lines below 0.05 Hz mean nothing."""
    place = {"position": ["0.35 m", "-0.9 m", "-0.2 m"], "drive_axis": [0.0, -1.0, 0.0]}
    both = mv.load_scenario(EXAMPLES / "spacecraft.yaml").with_(
        {
            "spacecraft.second_wing": {
                "interface": {**place, "reference": [1, 0, 0]},
                "drive": "driven",
            }
        }
    )
    assert both.driven_wing is not None

    def most(frequency: float) -> float:
        """The largest side line of one of a torque of 1 mN m on the hub."""
        f, los = np.array([frequency]), np.full((1, 2), 1e-7 + 0j)
        loads = np.array([[0.0, 0.0, 0.0, 0.0, 1e-3, 0.0]], dtype=complex)
        lines = HubLines(both.alone, ("line",), f, loads, los, np.zeros((1, 2)))
        given = Contribution("drive", "given", ("line",), f, los)
        side = with_side_lines_of_other(given, lines, both.alone, both.driven_wing).side
        return 0.0 if side is None else float(side.most.max(initial=0.0))

    assert most(0.04) == pytest.approx(most(0.06), rel=0.5)
