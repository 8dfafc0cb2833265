"""The examples run, and give the figures that they gave when they were written."""

import ast
import importlib.util
from pathlib import Path

import pytest
from support.tiers import at_a_release

import microvib as mv

EXAMPLES = Path(__file__).parents[1] / "examples"

# mN m, `python examples/states.py`; state 1 is calibrated, the others follow from it
PINNED = {
    1: {
        "array_mode_1": 3.828,
        "drive_1": 47.814,
        "drive_2": 13.703,
        "drive_3": 2.2971,
        "full_step_1": 5.114,
    },
    2: {
        "array_mode_1": 2.714,
        "drive_1": 47.767,
        "drive_2": 13.168,
        "drive_3": 2.2250,
        "full_step_1": 7.727,
    },
    3: {
        "array_mode_1": 1.800,
        "drive_1": 47.677,
        "drive_2": 12.489,
        "drive_3": 2.4108,
        "full_step_1": 11.089,
    },
    4: {
        "array_mode_1": 8.206,
        "drive_1": 47.620,
        "drive_2": 12.477,
        "drive_3": 2.7237,
        "full_step_1": 10.595,
    },
    5: {
        "array_mode_1": 13.575,
        "drive_1": 47.207,
        "drive_2": 11.267,
        "drive_3": 4.2691,
        "full_step_1": 15.883,
    },
}


def load(name: str):
    spec = importlib.util.spec_from_file_location(name, EXAMPLES / f"{name}.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_states_side_by_side(tmp_path, capsys):
    example = load("states")
    states = example.run_states()
    for state, pinned in PINNED.items():
        amplitudes = {name: 1e3 * a for name, a in states[state][1].items()}
        assert amplitudes == pytest.approx(pinned, rel=2e-3)
    example.print_table(states)
    example.draw(states, str(tmp_path / "states.png"))
    assert (tmp_path / "states.png").stat().st_size > 20_000
    assert "state 5" in capsys.readouterr().out


SHORT = [path.stem for path in sorted(EXAMPLES.glob("*.py")) if path.read_text().startswith("# ")]
SAYS = {
    "changed_copy": "did you mean reducer.stiffness?",
    "comparison": "agrees",
    "coupled_modes": "clamped 1.2459 Hz",
    "first_lines": "microstep, order 1",
    "hub_craig_bampton": "free hub: 21.27 Hz",
    "hub_nastran": "hub of 400 kg",
    "hub_reference": "353.5 kg, first modes 32.6 Hz",
    "hub_table": "payload: 62.2 um/s^2",
    "identification": "built with 5306, begun with 5053; explained: True",
    "limit": "Limit 40 mN m: FAIL, 1 of ",
    "recording": "clock 1.0025",
    "run_folder": "drive_1 47.7",
    "steady_state": "The steady state took less time",
    "table_as_frame": "{'units': 'N*m'}",
}
"""Of what some of the short scripts print, what they are about."""


def test_there_are_twenty_short_scripts():
    assert len(SHORT) >= 20
    assert set(SAYS) <= set(SHORT)


@pytest.mark.parametrize("name", [at_a_release(x) if x == "pointing_budget" else x for x in SHORT])
def test_a_short_script_runs_and_shows_what_it_says(name, tmp_path, monkeypatch, capsys):
    text = (EXAMPLES / f"{name}.py").read_text()
    assert len(text.splitlines()) <= 30
    monkeypatch.chdir(tmp_path)
    load(name)
    assert SAYS.get(name, "") in capsys.readouterr().out != ""
    if "savefig" in text:
        assert (tmp_path / f"{name}.png").stat().st_size > 10_000


def test_ten_modes_of_table_1_and_sixty_modes_run():
    from microvib.io.modal_sources import load_design

    table = [
        {
            "frequency": mode.frequency,
            "damping": 0.005,
            "effective_inertia": mode.effective_inertia,
        }
        for mode in load_design("reference-array").reference
    ]
    short = {
        "record.settle": 2.0,
        "record.duration": 4.0,
        "array.rigid_inertia": None,
        "array.inertia": 7.70,
    }
    ten = mv.simulate(mv.load_scenario("state-1").with_si({**short, "array.modes": table}))
    assert ten["eta"].shape == (16384, 10)
    assert ten.scenario.array.J_h == pytest.approx(
        7.70 - sum(mode["effective_inertia"] for mode in table)
    )
    more = [
        *table,
        *(
            {"frequency": 12.0 + 2.0 * k, "damping": 0.005, "effective_inertia": 1e-4}
            for k in range(50)
        ),
    ]
    sixty = mv.simulate(
        mv.load_scenario("state-1").with_si({**short, "array.modes": more, "array.inertia": 7.71})
    )
    assert sixty["eta"].shape == (16384, 60)
    assert sixty.invariants.torque_forms < 1e-11
    assert sixty.invariants.energy < 1e-4
    assert mv.find_lines(sixty)["drive_1"].amplitude > 0


def test_lines_with_more_and_more_modes(capsys):
    """`python examples/modes_kept.py 3 10`: figures of docs/fem.md; they hang on J_h."""
    example = load("modes_kept")
    J_h, highest, amplitudes = example.lines_with(10)
    assert (J_h, highest) == pytest.approx((0.0646, 11.553), rel=2e-3)
    assert 1e3 * amplitudes["drive_1"] == pytest.approx(31.64, rel=5e-3)
    example.main([3])
    assert "41.628" in capsys.readouterr().out


@pytest.mark.parametrize("path", sorted(EXAMPLES.glob("*.py")), ids=lambda path: path.stem)
def test_an_example_says_what_one_learns_and_imports_nothing_internal(path):
    text = path.read_text()
    first = text.splitlines()[0]
    assert first.startswith(("# ", '"""'))
    assert len(first.split()) >= 7
    nodes = list(ast.walk(ast.parse(text)))
    froms = [node.module for node in nodes if isinstance(node, ast.ImportFrom)]
    names = [alias.name for node in nodes if isinstance(node, ast.Import) for alias in node.names]
    assert [name for name in (*froms, *names) if name.startswith("microvib")] == ["microvib"]
    used = {node.id for node in nodes if isinstance(node, ast.Name)}
    assert {name for name in used if len(name) == 1} <= {"_"}, "words for variables"
