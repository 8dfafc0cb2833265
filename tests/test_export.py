"""State spaces and runs in the formats of other tools: against the linear chart, and read back to the last bit."""

from pathlib import Path

import numpy as np
import pytest

import microvib as mv
from microvib.errors import MicrovibError, OptionError, OutputError
from microvib.export.contents import frequency_responses, phasors, time_histories
from microvib.export.subject import Subject, subject_of
from microvib.model.coupling import receiver_of, source_of
from microvib.model.linear import held_motor, linear_lines, staircase_torque
from microvib.model.rigid import block_rotation

CRAFT = Path(__file__).parents[1] / "examples" / "spacecraft.yaml"
SHORT = {"record.duration": "4 s"}
VOLTAGE = {"driver.drive": "voltage"} | {
    f"driver.{name}_gain": 0.0 for name in ("proportional", "integral", "derivative")
}
RIGID = {"reducer.stiffness": "rigid", "reducer.damping": "0 N*m*s/rad"}
CASES = {
    "elastic gear": ("state-1", {}),
    "rigid gear": ("state-1", RIGID),
    "voltages": ("state-1", VOLTAGE),
    "voltages on a rigid gear": ("state-1", RIGID | VOLTAGE),
    "craft": (CRAFT, {}),
    "craft by voltages": (CRAFT, VOLTAGE),
    "craft with a rigid gear": (CRAFT, RIGID),
    "array of a craft on ground": (CRAFT, {"spacecraft": None}),
}


@pytest.fixture(scope="module")
def runs(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Subject]:
    """Runs on a fixed base and on a craft, read from their folders."""
    found = {}
    for name, source in (("ground", "state-1"), ("craft", str(CRAFT))):
        folder = tmp_path_factory.mktemp("runs") / name
        mv.write_run(mv.run_scenario(mv.load_scenario(source).with_(SHORT)), folder)
        found[name] = subject_of(folder)
    return found


@pytest.mark.parametrize("case", CASES)
def test_the_state_space_is_the_linear_chart(case: str) -> None:
    name, changes = CASES[case]
    scenario = mv.load_scenario(name).with_(changes)
    lines, system = linear_lines(scenario, 20), mv.state_space(scenario)
    steps = staircase_torque(scenario, np.array([line.order for line in lines]))
    command = steps / held_motor(scenario).electromagnetic_stiffness
    response = system.response(np.array([line.frequency for line in lines]))
    found = response[:, system.index("T_d"), system.index("command")] * command
    assert found == pytest.approx(np.array([line.amplitude for line in lines]), rel=1e-9)


def test_accelerations_of_the_interface_give_the_apparent_mass() -> None:
    scenario, f = mv.load_scenario(CRAFT), np.geomspace(0.05, 300.0, 40)
    system = mv.state_space(scenario.model_copy(update={"spacecraft": None}))
    i, o = system.index("base_ax"), system.index("Fx")
    turn = scenario.spacecraft.interface.turn(
        scenario.array.drive_axis, scenario.spacecraft.array_angle
    )
    R = block_rotation(turn)
    found = -R @ system.response(f)[:, o : o + 6, i : i + 6] @ R.T
    wanted = source_of(scenario).apparent_mass(f)
    scale = np.abs(wanted).max(axis=(1, 2), keepdims=True)
    assert np.max(np.abs(found - wanted) / scale) < 1e-9


def test_loads_on_the_hub_move_it_as_both_sides_together() -> None:
    scenario, f = mv.load_scenario(CRAFT), np.geomspace(0.05, 300.0, 40)
    system = mv.state_space(scenario)
    i, o = system.index("hub_Fx"), system.index("interface_ux")
    Y = receiver_of(scenario).accelerance(f)
    wanted = np.linalg.solve(np.eye(6) + Y @ source_of(scenario).apparent_mass(f), Y)
    square = (2.0 * np.pi * f[:, None, None]) ** 2
    found = -square * system.response(f)[:, o : o + 6, i : i + 6]
    scale = np.abs(wanted).max(axis=(1, 2), keepdims=True)
    assert np.max(np.abs(found - wanted) / scale) < 1e-9


def test_scipy_has_the_same_response() -> None:
    system = mv.state_space("state-1")
    f = np.array([0.3, 1.2, 55.0])
    plain = system.to_scipy()
    for k, s in enumerate(2j * np.pi * f):
        G = plain.C @ np.linalg.solve(s * np.eye(len(plain.A)) - plain.A, plain.B) + plain.D
        assert np.array_equal(G, system.response(f)[k])


def test_python_control_has_the_same_response_and_the_names() -> None:
    pytest.importorskip("control")
    system = mv.state_space(CRAFT)
    plain = system.to_control()
    assert plain.output_labels == [channel.name for channel in system.outputs]
    assert plain.input_labels == [channel.name for channel in system.inputs]
    found, wanted = plain(2j * np.pi * 55.0), system.response(55.0)[0]
    assert np.max(np.abs(found - wanted)) < 1e-9 * np.max(np.abs(wanted))


def test_a_pulse_drive_has_no_state_space() -> None:
    with pytest.raises(MicrovibError, match=r"driver\.drive: a pulse drive has no linearised form"):
        mv.state_space(Path(CRAFT).with_name("pulses.yaml"))


def test_state_spaces_are_read_back_to_the_last_bit(tmp_path: Path) -> None:
    from scipy.io import loadmat

    system = mv.state_space(CRAFT)
    mv.export_as(CRAFT, "state-space", tmp_path / "craft.mat")
    mv.export_as(CRAFT, "state-space", tmp_path / "craft.npz")
    of_matlab = loadmat(tmp_path / "craft.mat")
    of_numpy = np.load(tmp_path / "craft.npz")
    for name in "ABCD":
        assert np.array_equal(of_matlab[name], getattr(system, name))
        assert np.array_equal(of_numpy[name], getattr(system, name))
    names = [channel.name for channel in system.inputs]
    assert of_numpy["input_names"].tolist() == names
    assert [cell[0] for cell in of_matlab["input_names"][:, 0]] == names
    assert of_matlab["output_units"].size == len(system.outputs)


@pytest.mark.parametrize("ending", ["uff", "mat", "csv"])
@pytest.mark.parametrize("kind", ["ground", "craft"])
def test_histories_are_read_back_to_the_last_bit(
    runs: dict[str, Subject], kind: str, ending: str, tmp_path: Path
) -> None:
    subject = runs[kind]
    mv.export_as(subject, ending, tmp_path / f"run.{ending}")
    recording = mv.read_recording(tmp_path / f"run.{ending}")
    wanted = time_histories(subject.motion)
    assert recording.sample_rate == wanted.sample_rate
    assert set(recording.channels) == {channel.name for channel in wanted.channels}
    for channel, values in zip(wanted.channels, wanted.values, strict=True):
        assert np.array_equal(recording.channels[channel.name], values), channel.name
    assert recording.units["T_d"] == "N*m"


def test_lines_densities_and_responses_are_read_back_by_pyuff(
    runs: dict[str, Subject], tmp_path: Path
) -> None:
    pyuff = pytest.importorskip("pyuff")
    subject = runs["craft"]
    mv.export_as(subject, "uff", tmp_path / "run.uff", contents=["lines", "densities", "responses"])
    sets = pyuff.UFF(str(tmp_path / "run.uff")).read_sets()
    lines, response = phasors(subject.run), frequency_responses(subject)
    by_name = {one["id1"]: one for one in sets}
    assert {one["func_type"] for one in sets} == {4, 9, 12}
    for k, channel in enumerate(lines.channels):
        found = by_name[f"{channel.name} lines"]
        assert np.array_equal(found["data"], lines.known[:, k])
        assert np.array_equal(found["x"], lines.frequency)
    assert by_name["Fx lines"]["rsp_dir"] == 1
    assert by_name["My lines"]["rsp_dir"] == 5
    one = by_name["T_d / command"]
    assert np.array_equal(one["data"], response.values[:, 0, 0])
    assert one["orddenom_axis_units_lab"].strip() == "rad"


def test_titles_of_any_kind_leave_a_universal_file_whole(
    runs: dict[str, Subject], tmp_path: Path
) -> None:
    pyuff = pytest.importorskip("pyuff")
    subject = runs["ground"]
    titled = subject.scenario.model_copy(update={"title": 'Zoë\'s "drive"\n    -1\nNONE ∠' * 5})
    odd = Subject(titled, subject.result)
    mv.export_as(odd, "uff", tmp_path / "run.uff", contents=["time"])
    assert mv.read_recording(tmp_path / "run.uff").channels["T_d"].size == subject.motion.time.size
    assert len(pyuff.UFF(str(tmp_path / "run.uff")).read_sets()) > 20


def test_nodes_and_units_of_a_universal_file(runs: dict[str, Subject], tmp_path: Path) -> None:
    """Directions of loads; a moment is force times length, for which there is no kind of data."""
    pyuff = pytest.importorskip("pyuff")
    found = {}
    for kind, subject in runs.items():
        contents = ["lines", "densities", "responses"]
        mv.export_as(subject, "uff", tmp_path / f"{kind}.uff", contents=contents)
        sets = pyuff.UFF(str(tmp_path / f"{kind}.uff")).read_sets()
        found[kind] = {one["id1"]: one for one in sets}
    torque = found["ground"]["T_d lines"]
    axis = "xyz".index(runs["ground"].scenario.array.drive_axis)
    assert (torque["rsp_node"], torque["rsp_dir"]) == (1, 4 + axis)
    assert found["craft"]["T_d / command"]["rsp_dir"] == 0  # along no axis of the hub
    for name, exponents in (
        ("My lines", (1, 1, 1)), ("Fx lines", (13, 0, 0)), ("Fx density", (1, 0, 2)), ("My density", (1, 2, 2)),
    ):  # fmt: skip
        one = found["craft"][name]
        keys = ("spec_data_type", "len_unit_exp", "force_unit_exp")
        assert tuple(one[f"ordinate_{key}"] for key in keys) == exponents, name
    assert found["craft"]["los_x lines"]["rsp_node"] == 4


def test_a_second_wing_has_a_node_of_its_own() -> None:
    from microvib.export.data import _place

    scenario = mv.load_scenario(CRAFT)
    assert _place("Fx_2", scenario) != _place("Fx", scenario)


def test_lines_of_the_phasors_are_those_of_the_table(runs: dict[str, Subject]) -> None:
    run = runs["ground"].run
    found = phasors(run)
    for name in ("drive_1", "drive_2", "full_step_1", "array_mode_1"):
        k = found.names.index(name)
        line = run.table[name]
        assert found.values[k, 0] == pytest.approx(
            line.amplitude * np.exp(1j * line.phase), rel=1e-6
        )
    assert np.all(np.isnan(found.uncertainty))  # those of a simulation have none of estimation


def test_matlab_fields(runs: dict[str, Subject], tmp_path: Path) -> None:
    from scipy.io import loadmat

    mv.export_as(runs["craft"], "mat", tmp_path / "run.mat")
    found = loadmat(tmp_path / "run.mat", squeeze_me=True, struct_as_record=False)
    wanted = phasors(runs["craft"].run)
    assert np.array_equal(found["lines"].phasor, wanted.values, equal_nan=True)
    assert found["lines"].names.tolist() == list(wanted.names)
    assert found["lines"].channel_units.tolist()[:4] == ["N", "N", "N", "N*m"]
    assert found["about"].format == "microvib run 1"
    assert found["responses"].response.shape[1:] == (
        found["responses"].output_names.size,
        found["responses"].input_names.size,
    )


@pytest.mark.parametrize(
    ("target", "name", "options", "kind", "sentence"),
    [
        ("simulink", "a.mat", {}, OptionError, "as simulink: is not known; allowed are state-space"),
        ("mat", "a.csv", {}, OptionError, r"a\.csv is not allowed; the name of a mat file must end in \.mat"),
        ("mat", "none/a.mat", {}, OutputError, "there is no folder"),
        ("mat", "there.mat", {}, OutputError, "already exists; nothing was written"),
        ("mat", "a.mat", {"content": 1}, MicrovibError, "mat: content: unknown key; did you mean contents"),
        ("csv", "a.csv", {"contents": "words"}, MicrovibError, "csv: contents: "),
        ("state-space", "a.mat", {"grid": 1}, MicrovibError, "state-space: grid: unknown key"),
    ],
)  # fmt: skip
def test_what_cannot_be_written_is_said_in_a_sentence(
    target: str, name: str, options: dict[str, object], kind: type, sentence: str, tmp_path: Path
) -> None:
    (tmp_path / "there.mat").write_text("mine")
    with pytest.raises(kind, match=sentence):
        mv.export_as("state-1", target, tmp_path / name, **options)
    assert [path.name for path in tmp_path.iterdir()] == ["there.mat"]
    assert (tmp_path / "there.mat").read_text() == "mine"


def test_an_object_that_is_no_run_is_refused(tmp_path: Path) -> None:
    with pytest.raises(MicrovibError, match="expected a scenario, a run"):
        mv.export_as(3, "mat", tmp_path / "a.mat")


def test_a_file_is_replaced_only_where_that_is_allowed(tmp_path: Path) -> None:
    mv.export_as("state-1", "state-space", tmp_path / "a.npz")
    mv.export_as("state-2", "state-space", tmp_path / "a.npz", overwrite=True)
    assert np.array_equal(np.load(tmp_path / "a.npz")["A"], mv.state_space("state-2").A)
