"""A deck in a scenario and behind a command."""

import click
import numpy as np
import pytest
from click.testing import CliRunner

from microvib.cli.structures import import_from, modal_options
from microvib.errors import MicrovibError
from microvib.io.named import catalog_text
from microvib.io.nastran import read_modal_model
from microvib.io.scenario_file import load_scenario

HOME = (0.1, -0.2, 0.3)


@pytest.fixture
def scenario(tmp_path, frame, write_op2):
    write_op2(tmp_path / "model.op2", frame("mm-t-s"), count=12)

    def write(array):
        lines = catalog_text("state-1").splitlines()
        first = lines.index("array:")
        last = next(
            k
            for k in range(first + 1, len(lines))
            if lines[k] and not lines[k].startswith((" ", "#"))
        )
        text = "\n".join([*lines[:first], f"array: {array}", *lines[last:]])
        path = tmp_path / "mine.yaml"
        path.write_text(
            "\n".join(line for line in text.splitlines() if not line.strip().startswith("array."))
        )
        return path

    return write


def test_a_scenario_takes_its_array_from_a_deck(scenario, frame):
    path = scenario(
        "{from: model.op2, units: mm-t-s, interface: 1001, drive_axis: y, damping: 0.5 percent, modes: 5}"
    )
    loaded = load_scenario(path)
    frequency, P, M = frame().about(HOME)
    assert loaded.array.drive_axis == "y"
    assert loaded.array.inertia == pytest.approx(M[4, 4], rel=1e-6)
    np.testing.assert_allclose([m.frequency for m in loaded.array.modes], frequency[:5], rtol=1e-6)
    np.testing.assert_allclose(np.abs(loaded.array.H), np.abs(P[4, :5]), rtol=1e-5, atol=1e-5)
    assert loaded.array.modes[0].damping == pytest.approx(0.005)
    assert loaded.source_of("array.inertia").startswith(
        "model.op2. Participations are the forces of constraint"
    )
    assert loaded.source_of("array.modes.0.frequency") == "model.op2"


@pytest.mark.parametrize(
    ("array", "words"),
    [
        ("{from: model.op2}", "array: units: missing"),
        ("{from: model.op2, units: mm-t-s, interface: 5, drive_axis: y}", "grid 5 is not in the model"),
        ("{from: model.op2, units: mm-t-s, interface: 1001, drive_axis: y, inertia: 7 kg*m^2}", "inertia: unknown key"),
        ("{from: model.op2, units: mm-t-s, interface: 1001, drive_axis: y, modes: 99}", "has 12 modes; 99 are asked for"),
        ("{from: none.op2, units: mm-t-s, interface: 1001, drive_axis: y}", "cannot be read"),
        ("{from: model.nas, units: SI, interface: 1001, drive_axis: y}", "'.nas' is not known"),
    ],
)  # fmt: skip
def test_a_scenario_with_a_wrong_deck(scenario, array, words):
    with pytest.raises(MicrovibError, match=words):
        load_scenario(scenario(array))


def test_options_of_a_command(tmp_path, frame, write_op2):
    path = write_op2(tmp_path / "model.op2", frame("mm-t-s"), count=4)

    @click.command()
    @modal_options
    def command(**given):
        model = read_modal_model(path, import_from(path, given))
        click.echo(
            f"{model.frequency.size} {model.drive_axis} {model.inertia:.6g} {model.damping[0]:g}"
        )

    args = [
        "--units",
        "mm-t-s",
        "--interface",
        "100,-200,300",
        "--drive-axis",
        "0,1,0",
        "--damping",
        "2 percent",
    ]
    result = CliRunner().invoke(command, args)
    assert result.output.split() == ["4", "z", f"{frame().about(HOME)[2][4, 4]:.6g}", "0.02"]
    assert import_from(path, {"units": None}) is None
    with pytest.raises(MicrovibError, match=r"interface: .* is not allowed"):
        import_from(path, {"units": "SI", "interface": "here", "drive_axis": "z"})
