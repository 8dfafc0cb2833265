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


class Instance:
    """One instance of an FMU, whatever its version."""

    def __init__(self, fmu, initialized=True):
        description = fmpy.read_model_description(str(fmu))
        self.version_2 = description.fmiVersion == "2.0"
        self.references = {v.name: v.valueReference for v in description.modelVariables}
        kind = fmpy.fmi2.FMU2Slave if self.version_2 else fmpy.fmi3.FMU3Slave
        self.slave = kind(
            guid=description.guid,
            unzipDirectory=fmpy.extract(str(fmu)),
            modelIdentifier=description.coSimulation.modelIdentifier,
        )
        self.slave.instantiate()
        if initialized:
            self.initialize()

    def initialize(self):
        if self.version_2:
            self.slave.setupExperiment(startTime=0.0)
        self.slave.enterInitializationMode()
        self.slave.exitInitializationMode()

    def get(self, name):
        ask = self.slave.getReal if self.version_2 else self.slave.getFloat64
        return ask([self.references[name]])[0]

    def set(self, name, value):
        give = self.slave.setReal if self.version_2 else self.slave.setFloat64
        give([self.references[name]], [value])

    def run(self, first, stop):
        for k in range(first, stop):
            self.slave.doStep(0.01 * k, 0.01)

    @property
    def state(self):
        if self.version_2:
            return self.slave.serializeFMUstate(self.slave.getFMUstate())
        return self.slave.serializeFMUState(self.slave.getFMUState())

    @state.setter
    def state(self, content):
        if self.version_2:
            self.slave.setFMUstate(self.slave.deSerializeFMUstate(content))
        else:
            self.slave.setFMUState(self.slave.deserializeFMUState(content))


def test_states_come_back_from_bytes(fmu):
    """Get, serialise, go on, deserialise in another instance, go on: the same."""
    first, second = Instance(fmu), Instance(fmu)
    first.run(0, 50)
    content = first.state
    first.run(50, 100)
    second.state = content
    second.run(50, 100)
    assert first.get("T_d") == second.get("T_d") != 0.0
    second.slave.reset()
    for one in (first, second):
        one.slave.freeInstance()


def test_a_state_has_the_parameters(fmu):
    """After a reset, which takes parameters back, a state brings them again."""
    one = Instance(fmu, initialized=False)
    one.set("reducer.stiffness", 9000.0)
    one.initialize()
    one.run(0, 50)
    kept = one.state
    one.run(50, 80)
    expected = one.get("T_d")
    one.slave.reset()
    assert one.get("reducer.stiffness") == pytest.approx(SIX.reducer.stiffness)
    one.state = kept
    assert one.get("reducer.stiffness") == 9000.0
    one.run(50, 80)
    assert one.get("T_d") == expected
    one.slave.freeInstance()


def test_calls_out_of_order_are_errors(fmu):
    failure = fmpy.fmi1.FMICallException
    one = Instance(fmu, initialized=False)
    with pytest.raises(failure):
        one.slave.doStep(0.0, 0.01)
    one.initialize()
    one.run(0, 20)
    for now, step in ((0.5, 0.01), (0.19, 0.01), (0.2, -0.01), (0.2, np.nan), (0.2, np.inf)):
        with pytest.raises(failure):
            one.slave.doStep(now, step)
        assert one.get("time") == pytest.approx(0.2, rel=1e-12)
    with pytest.raises(failure):
        one.set("hub_acceleration", np.nan)
    assert one.get("hub_acceleration") == 0.0
    with pytest.raises(failure):
        one.set("reducer.stiffness", 9000.0)
    one.run(20, 30)
    one.slave.terminate()
    with pytest.raises(failure):
        one.slave.doStep(0.3, 0.01)
    assert np.isfinite(one.get("T_d"))
    one.slave.freeInstance()


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
