import dataclasses
import math

import numpy as np
import pytest

from microvib.errors import MicrovibError
from microvib.io.modal_table import modes_csv, read_modes
from microvib.io.scenario_file import dump_scenario, load_scenario
from microvib.structures.modal import ModalError, ModalModel


def model(s=3, spatial=True):
    rng = np.random.default_rng(1)
    mass = np.diag([33.0, 33.0, 33.0, 8.0, 60.0, 7.7]) if spatial else np.diag([0, 0, 0, 0, 0, 7.7])
    if spatial:
        mass[0, 5] = mass[5, 0] = 0.4
    P = rng.normal(size=(6, s)) * 0.3
    P = P if spatial else P * np.array([0, 0, 0, 0, 0, 1.0])[:, None]
    P[5, 0] = 2.6
    return ModalModel(np.array([0.9, 1.2, 4.0])[:s], np.full(s, 0.01), P, mass, "z", "made up")


def test_table_1_quantities():
    m = model()
    assert m.fraction[5, 0] == pytest.approx(2.6**2 / 7.7)
    assert m.J_h == pytest.approx(7.7 - (m.participation[5] ** 2).sum())
    assert m.first(1).frequency.size == 1


def test_a_table_of_modes_reads_back(tmp_path):
    path = tmp_path / "modes.csv"
    path.write_text(modes_csv(model()))
    back = read_modes(path)
    np.testing.assert_allclose(back.participation, model().participation, rtol=1e-11)
    np.testing.assert_allclose(back.mass, model().mass, rtol=1e-11)
    header = path.read_text().splitlines()[0]
    assert header.startswith(
        "mode,frequency_hz,damping,effective_inertia_kg_m2,effective_fraction,cumulative_fraction,part"
    )


@pytest.mark.parametrize("spatial", [True, False])
def test_a_scenario_takes_its_array_from_a_table(tmp_path, spatial):
    (tmp_path / "modes.csv").write_text(modes_csv(model(spatial=spatial)))
    before = load_scenario("state-1")
    data = dump_scenario(before).splitlines()
    first = data.index("array:")
    last = next(k for k in range(first + 1, len(data)) if not data[k].startswith(" "))
    text = "\n".join(
        [*data[:first], "array: {from: modes.csv, modes: 2, damping: 2 percent}", *data[last:]]
    )
    text = text.replace("array.rigid_inertia", "array").replace("array.modes.0.damping", "array")
    (tmp_path / "mine.yaml").write_text(
        "\n".join(x for x in text.splitlines() if "  array" not in x)
    )
    scenario = load_scenario(tmp_path / "mine.yaml")
    assert [m.frequency for m in scenario.array.modes] == [0.9, 1.2]
    assert scenario.array.modes[0].damping == pytest.approx(0.02)
    assert scenario.array.J_h == pytest.approx(model().first(2).J_h)
    assert (scenario.array.interface is not None) == spatial
    assert "modes.csv" in scenario.source_of("array.inertia")
    assert load_scenario(
        "state-1", {"array.from": str(tmp_path / "modes.csv")}
    ).array.inertia == pytest.approx(7.7)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (("frequency_hz", "0"), "row 2: frequency_hz is 0"),
        (("frequency_hz", "x"), "row 2: frequency_hz 'x' is not a number"),
        (("participation_mz", "nan"), "finite"),
    ],
)  # fmt: skip
def test_a_broken_table_is_named(tmp_path, change, words):
    rows = [line.split(",") for line in modes_csv(model()).splitlines()]
    rows[1][rows[0].index(change[0])] = change[1]
    path = tmp_path / "modes.csv"
    path.write_text("\n".join(",".join(r) for r in rows))
    with pytest.raises(ModalError, match=words):
        read_modes(path)


@pytest.mark.parametrize(
    ("second", "sentence"),
    [
        (
            "4.5,0.5,10,z",
            r"row 3: inertia_kg_m2 is 10, and 9 in row 2; one value for the whole array is expected",
        ),
        ("4.5,0.5,9,x", r"drive_axis is x and z; one for the whole array is expected"),
    ],
)
def test_rows_that_contradict_each_other_on_the_array_are_refused(tmp_path, second, sentence):
    path = tmp_path / "modes.csv"
    head = "frequency_hz,effective_inertia_kg_m2,inertia_kg_m2,drive_axis\n1.2,8,9,z\n"
    path.write_text(head + second)
    with pytest.raises(ModalError, match=sentence):
        read_modes(path)
    path.write_text(head + "4.5,0.5,,")
    assert read_modes(path).inertia == 9.0


def test_more_effective_inertia_than_inertia_is_refused():
    m = model()
    heavy = dataclasses.replace(m, participation=m.participation * math.sqrt(2.0))
    with pytest.raises(ModalError, match="more than the inertia"):
        heavy.array()


@pytest.mark.parametrize(
    "changes", [{"array.from": "none.csv"}, {"array.from": "x.csv", "array.inertia": "7 kg*m^2"}]
)
def test_bad_origin_of_modes(changes):
    with pytest.raises(MicrovibError, match=r"none.csv: cannot be read|array.inertia"):
        load_scenario("state-1", changes)
