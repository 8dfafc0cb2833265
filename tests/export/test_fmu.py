"""FMUs: what a validator says of them, and what an importer that is not ours makes of them."""

import io
import xml.etree.ElementTree as ET
import zipfile

import numpy as np
import pytest

import microvib as mv
from microvib.errors import MicrovibError
from microvib.export.native.fmu import export_fmu
from microvib.export.native.linking import host
from microvib.export.native.objects import PLATFORMS

fmpy = pytest.importorskip("fmpy")

STATE = mv.load_scenario("state-1", {"record.start": "rest"})
SIX = STATE.with_(
    {"array.modes.0.interface_participation": [0.4, 3.0, 0.0, 1.2, 0.0, float(STATE.array.H[0])]}
)


@pytest.fixture(scope="module", params=[2, 3])
def fmu(request, tmp_path_factory):
    return export_fmu(SIX, tmp_path_factory.mktemp("fmu") / "drive.fmu", version=request.param)


def reference(fmu):
    content = zipfile.ZipFile(fmu).read("documentation/reference.csv")
    return np.genfromtxt(io.BytesIO(content), delimiter=",", names=True)


def test_a_validator_finds_nothing(fmu):
    from fmpy.validation import validate_fmu

    assert validate_fmu(str(fmu)) == []


def test_an_importer_simulates_what_the_solver_does(fmu):
    """fmpy's simulator, against the reference results, which the solver makes in Python."""
    expected = reference(fmu)
    found = fmpy.simulate_fmu(
        str(fmu),
        stop_time=5.0,
        step_size=0.01,
        output_interval=0.01,
        output=list(expected.dtype.names)[1:],
    )
    for name in expected.dtype.names[1:]:
        largest = np.max(np.abs(expected[name]))
        assert np.max(np.abs(found[name][1:] - expected[name])) <= 1e-9 * largest, name
    assert np.ptp(expected["Fx"]) > 0.1


def test_inputs_act(fmu):
    """A commanded rate of 0 stops the drive; an acceleration of the hub turns up as -J a."""
    times = np.array(
        [(0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (2.0, 0.0, -0.5)],
        dtype=[("time", "f8"), ("array_rate", "f8"), ("hub_acceleration", "f8")],
    )
    rest = fmpy.simulate_fmu(
        str(fmu),
        stop_time=2.0,
        step_size=0.01,
        start_values={"command": 1},
        input=times[:2],
        output=["T_d", "theta_m", "microsteps"],
    )
    assert np.all(rest["microsteps"] == 0.0)
    assert np.max(np.abs(rest["theta_m"])) < 1e-6
    pushed = fmpy.simulate_fmu(
        str(fmu),
        stop_time=2.0,
        step_size=0.01,
        start_values={"command": 1},
        input=times,
        output=["T_d"],
    )
    assert pushed["T_d"][-1] > 0.5 * 0.25 * SIX.array.inertia


def test_independent_steps_do_not_hang_on_communication(fmu):
    found = [
        fmpy.simulate_fmu(
            str(fmu),
            stop_time=2.0,
            step_size=step,
            output_interval=0.1,
            start_values={"independent_steps": 1},
            output=["T_d", "Fx"],
        )
        for step in (0.002, 0.1)
    ]
    for name in ("T_d", "Fx"):
        largest = np.max(np.abs(found[1][name]))
        assert np.max(np.abs(found[0][name] - found[1][name])) < 1e-9 * largest


def test_parameters_are_set_before_the_start(fmu, tmp_path):
    """An FMU with other start values, against that of the scenario with these values."""
    changed = SIX.with_({"reducer.stiffness": "9000 N*m/rad", "driver.microsteps": 32})
    expected = reference(export_fmu(changed, tmp_path / "changed.fmu"))
    found = fmpy.simulate_fmu(
        str(fmu),
        stop_time=5.0,
        step_size=0.01,
        output_interval=0.01,
        start_values={"reducer.stiffness": 9000.0, "driver.microsteps": 32.0},
        output=["T_d"],
    )
    largest = np.max(np.abs(expected["T_d"]))
    assert np.max(np.abs(found["T_d"][1:] - expected["T_d"])) <= 1e-9 * largest
    assert np.max(np.abs(expected["T_d"] - reference(fmu)["T_d"])) > 0.01 * largest


@pytest.mark.parametrize("version", [2, 3])
def test_tones_are_the_lines_of_the_steady_state(version, tmp_path):
    """An FMU of lines, against cosines, and its means against theirs."""
    from fmpy.validation import validate_fmu

    steady = SIX.with_({"record.start": "steady"})
    fmu = export_fmu(steady, tmp_path / "lines.fmu", version=version, kind="tones")
    assert validate_fmu(str(fmu)) == []
    asked = ["T_d", "T_d_mean", "Fx"]
    found = fmpy.simulate_fmu(
        str(fmu), stop_time=2.0, step_size=0.001, output_interval=0.001, output=asked
    )
    for name in ("T_d", "Fx"):
        lines = [x for x in mv.find_lines(steady, name) if x.seen and not x.decay > 0.0]
        assert len(lines) > 10
        expected = sum(
            x.amplitude * np.cos(2.0 * np.pi * x.frequency * found["time"] + x.phase) for x in lines
        )
        assert np.max(np.abs(found[name] - expected)) < 1e-9 * np.max(np.abs(expected)), name
    exact = sum(
        x.amplitude
        * np.diff(np.sin(2.0 * np.pi * x.frequency * found["time"] + x.phase))
        / (2.0 * np.pi * x.frequency * 0.001)
        for x in mv.find_lines(steady, "T_d")
        if x.seen and not x.decay > 0.0
    )
    assert np.max(np.abs(found["T_d_mean"][1:] - exact)) < 1e-8 * np.max(np.abs(exact))
    names = {v.name for v in fmpy.read_model_description(str(fmu)).modelVariables}
    assert not names & {"hub_acceleration", "array_rate"}


def test_a_drive_without_its_array_takes_a_torque(tmp_path):
    """Validated; a torque on the shaft turns up at the spacecraft, less what accelerates the shaft."""
    from fmpy.validation import validate_fmu

    fmu = export_fmu(STATE, tmp_path / "drive.fmu", kind="drive")
    assert validate_fmu(str(fmu)) == []
    names = {v.name for v in fmpy.read_model_description(str(fmu)).modelVariables}
    assert {"shaft_torque", "theta_l", "omega_l", "alpha_l"} <= names
    assert "eta[1]" not in names
    given = np.array([(0.0, 0.05), (4.0, 0.05)], dtype=[("time", "f8"), ("shaft_torque", "f8")])
    found = fmpy.simulate_fmu(
        str(fmu),
        stop_time=4.0,
        step_size=0.01,
        output_interval=0.01,
        start_values={"command": 1},
        input=given,
        output=["T_d", "omega_l", "T_d_mean"],
    )
    assert abs(found["omega_l"][-1]) < 1e-6
    assert found["T_d"][-1] == pytest.approx(0.05, rel=1e-3)


def test_a_drive_needs_something_on_its_shaft(tmp_path):
    bare = STATE.with_({"array.rigid_inertia": "0 kg*m^2", "reducer.output_inertia": "0.1 kg*m^2"})
    with pytest.raises(MicrovibError, match=r"^kind drive: all of the array's inertia"):
        export_fmu(bare, tmp_path / "drive.fmu", kind="drive")


def test_states_come_back_from_bytes(fmu):
    """Get, serialise, go on, deserialise in another instance, go on: the same."""
    from fmpy import extract, read_model_description

    description = read_model_description(str(fmu))
    folder = extract(str(fmu))
    reference_of = {v.name: v.valueReference for v in description.modelVariables}
    version_2 = description.fmiVersion == "2.0"
    kind = fmpy.fmi2.FMU2Slave if version_2 else fmpy.fmi3.FMU3Slave

    def opened():
        one = kind(
            guid=description.guid,
            unzipDirectory=folder,
            modelIdentifier=description.coSimulation.modelIdentifier,
        )
        one.instantiate()
        if version_2:
            one.setupExperiment(startTime=0.0)
        one.enterInitializationMode()
        one.exitInitializationMode()
        return one

    def torque(one):
        ask = one.getReal if version_2 else one.getFloat64
        return ask([reference_of["T_d"]])[0]

    first, second = opened(), opened()
    for k in range(50):
        first.doStep(0.01 * k, 0.01)
    if version_2:
        state = first.getFMUstate()
        content = first.serializeFMUstate(state)
    else:
        state = first.getFMUState()
        content = first.serializeFMUState(state)
    for k in range(50, 100):
        first.doStep(0.01 * k, 0.01)
    if version_2:
        second.setFMUstate(second.deSerializeFMUstate(content))
    else:
        second.setFMUState(second.deserializeFMUState(content))
    for k in range(50, 100):
        second.doStep(0.01 * k, 0.01)
    assert torque(first) == torque(second) != 0.0
    second.reset()
    for one in (first, second):
        one.freeInstance()


def test_the_description_has_units_and_meanings(fmu):
    root = ET.fromstring(zipfile.ZipFile(fmu).read("modelDescription.xml"))
    units = {unit.get("name") for unit in root.iter("Unit")}
    variables = list(root.find("ModelVariables"))
    assert len(variables) > 40
    for variable in variables:
        assert variable.get("description"), variable.get("name")
        unit = variable.get("unit") or next((one.get("unit") for one in variable), None)
        assert unit is None or unit in units
    named = {variable.get("name") for variable in variables}
    assert {"T_d", "T_d_mean", "Fx", "Mz", "hub_acceleration", "array_rate"} <= named


def test_the_icon_is_a_picture(fmu):
    archive = zipfile.ZipFile(fmu)
    (name,) = [name for name in archive.namelist() if name.endswith(".png")]
    assert archive.read(name).startswith(b"\x89PNG")


def test_without_six_components_there_are_no_loads(tmp_path):
    fmu = export_fmu(STATE, tmp_path / "plain.fmu")
    names = {variable.name for variable in fmpy.read_model_description(str(fmu)).modelVariables}
    assert "T_d" in names
    assert "Fx" not in names


@pytest.mark.parametrize(
    ("options", "name", "said"),
    [
        ({"version": 1}, "a.fmu", "^version 1: of FMI is not written; 2 or 3 is expected$"),
        ({"kind": "whole"}, "a.fmu", "^kind whole: of FMU is not written"),
        ({}, "a.zip", "must end in .fmu"),
        (
            {"platforms": ["linux-arm64"]},
            "a.fmu",
            "linux-arm64: is none of FMI 2; there are linux64",
        ),
        ({}, "missing/folder/a.fmu", "cannot be written"),
    ],
)
def test_bad_options_are_sentences(options, name, said, tmp_path):
    with pytest.raises(MicrovibError, match=said):
        export_fmu(STATE, tmp_path / name, **options)
    assert not list(tmp_path.iterdir())


def test_a_file_that_is_there_stays(tmp_path):
    (tmp_path / "a.fmu").write_text("mine")
    with pytest.raises(MicrovibError, match="already exists"):
        export_fmu(STATE, tmp_path / "a.fmu")
    assert (tmp_path / "a.fmu").read_text() == "mine"


@pytest.mark.release
@pytest.mark.parametrize("version", [2, 3])
def test_binaries_of_other_platforms_are_built(version, tmp_path):
    """Built, not run: format, and FMI's functions among the exported names."""
    pytest.importorskip("ziglang")
    names = ["win64"] if version == 2 else ["linux-arm64", "darwin-arm64"]
    fmu = export_fmu(STATE, tmp_path / "a.fmu", version=version, platforms=[host(), *names])
    begins = {".dll": b"MZ", ".dylib": b"\xcf\xfa\xed\xfe", ".so": b"\x7fELF"}
    archive = zipfile.ZipFile(fmu)
    binaries = [name for name in archive.namelist() if name.startswith("binaries/")]
    assert len(binaries) == 1 + len(names)
    for name in binaries:
        content = archive.read(name)
        assert content.startswith(begins["." + name.rpartition(".")[2]]), name
        assert f"fmi{version}DoStep".encode() in content, name
        assert b"/tmp/" not in content, name
    assert set(names) <= set(PLATFORMS)
