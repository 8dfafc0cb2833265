"""The front: one function for one motion, one for many, lines of whatever has some, and names wherever a scenario is."""

import doctest
import inspect
import os
import subprocess
import sys
import warnings
from pathlib import Path

import numpy as np
import pytest
from support.front import PUBLIC

import microvib as mv
from microvib.io.recordings import Prepared
from microvib.io.scenario_file import load_bench
from microvib.studies.analyse import analyse
from microvib.studies.measure import measure
from microvib.studies.orbit import analyse_orbit
from microvib.studies.sensitivity import NOT_RANKED, sensitivities

CRAFT = Path(__file__).parents[1] / "examples" / "spacecraft.yaml"
QUICK = {"record.settle": "0 s", "record.duration": "0.5 s", "record.sample_rate": "512 Hz"}
NO_PERIOD = {"friction.torque_noise": {"density": "1e-6 N^2*m^2/Hz", "highest": "100 Hz"}}


@pytest.fixture(scope="module")
def quick(state_1):
    return state_1.with_(QUICK)


@pytest.fixture(scope="module")
def file(quick, tmp_path_factory):
    path = tmp_path_factory.mktemp("scenario") / "quick.yaml"
    path.write_text(mv.dump_scenario(quick))
    return path


RECORDING = {"Mz": np.random.default_rng(1).normal(0.0, 1.0, 2048)}


BENCH = load_bench("force-table").model_copy(update={"duration": 1.0})


def recording():
    return mv.Recording(RECORDING, 512.0, {"Mz": "N*m"}, "mine")


TAKERS = {
    "simulate": lambda s: mv.simulate(s)["T_d"],
    "simulate_many": lambda s: mv.simulate_many([s])[0]["T_d"],
    "find_lines": lambda s: mv.find_lines(s),
    "find_lines of a recording": lambda s: mv.find_lines(recording(), scenario=s),
    "steady_state": lambda s: mv.steady_state(s).T_d,
    "run_scenario": lambda s: mv.run_scenario(s).table,
    "plan_rates": lambda s: mv.plan_rates(s, ["0.06 deg/s"], linear=True),
    "coupled_modes": mv.coupled_modes,
    "expected_lines": lambda s: mv.expected_lines(s, "60 Hz"),
    "dump_scenario": mv.dump_scenario,
    "judge": lambda s: mv.judge(mv.find_lines(recording(), scenario=s), mv.Limit("1 N*m"), s),
    "analyse": lambda s: repr(analyse(s).table),
    "analyse with a guide": lambda s: analyse(Prepared(recording()), scenario=s).table,
    "measure": lambda s: measure(s, BENCH)["Mz"],
    "compare": lambda s: repr(mv.compare(recording(), s).rows),
    "compare with a guide": lambda s: repr(mv.compare(recording(), recording(), scenario=s).rows),
}


@pytest.mark.parametrize("taker", TAKERS)
def test_a_name_is_taken_wherever_a_scenario_is(quick, file, taker):
    take = TAKERS[taker]
    given = take(quick)
    for name in (str(file), file):
        np.testing.assert_equal(take(name), given)


def test_the_name_of_a_craft_is_taken_for_its_budget(tmp_path):
    scenario = mv.load_scenario(CRAFT).with_({"record.duration": "2 s", "record.start": "steady"})
    path = tmp_path / "craft.yaml"
    path.write_text(mv.dump_scenario(scenario))
    of_object, of_path = mv.pointing_budget(scenario), mv.pointing_budget(path)
    assert of_path.contributions[0].source == "craft"
    assert of_path.windows == of_object.windows


def test_identification_takes_the_name_of_its_model(file):
    with pytest.raises(mv.MicrovibError, match=r"reducer\.dampin: is not a key of the scenario"):
        mv.identify(file, [recording()], ["reducer.dampin"])


def test_studies_that_refuse_a_drive_have_read_it_by_its_name(file):
    with pytest.raises(mv.MicrovibError, match="spacecraft"):
        analyse_orbit(file)
    with pytest.raises(mv.MicrovibError) as refused:
        sensitivities(file)
    assert str(refused.value) == NOT_RANKED


def test_how_a_motion_starts(quick):
    steady = quick.with_({"record.start": "steady"})
    begun, given = mv.simulate(quick, start="steady"), mv.simulate(steady)
    assert np.array_equal(begun["T_d"], given["T_d"])
    assert begun.scenario == steady
    assert begun.solver["steady"] == "used"
    assert np.array_equal(mv.simulate(steady, start="rest")["T_d"], mv.simulate(quick)["T_d"])


def test_channels_that_are_kept(quick):
    assert set(mv.simulate(quick, channels="T_d").channels) == {"T_d"}
    assert set(mv.simulate(quick, channels=["T_d", "omega_m"]).channels) == {"T_d", "omega_m"}
    assert "eta" in mv.simulate(quick).channels


def test_each_of_many_is_what_simulate_gives(quick):
    others = [quick, quick.with_({"tracking.clock_ratio": 0.99})]
    told = []
    found = mv.simulate_many(others, progress=lambda done, total: told.append((done, total)))
    assert told == [(1, 2), (2, 2)]
    for motion, scenario in zip(found, others, strict=True):
        assert set(motion.channels) == {"T_d"}
        assert np.array_equal(motion["T_d"], mv.simulate(scenario)["T_d"])
    (whole,) = mv.simulate_many([quick], channels=None, start="steady")
    assert whole.scenario.record.start == "steady"
    assert "omega_m" in whole.channels
    assert mv.simulate_many([]) == []


def test_one_that_fails_is_named_or_stands_in_its_place(quick):
    lost = quick.with_({"tracking.rate": "50 deg/s", "record.duration": "2 s"})
    with pytest.raises(mv.SynchronismLost, match=r"^scenario 1: loss of synchronism"):
        mv.simulate_many([quick, lost])
    first, error, last = mv.simulate_many([quick, lost, quick], errors="return")
    assert isinstance(error, mv.SynchronismLost)
    assert np.array_equal(first["T_d"], last["T_d"])
    with pytest.raises(mv.SynchronismLost):
        mv.find_lines(error)


def test_lines_of_a_scenario_are_those_of_its_motion(quick):
    assert mv.find_lines(quick) == mv.find_lines(mv.simulate(quick))
    assert mv.find_lines(quick, "omega_l") == mv.find_lines(mv.simulate(quick), "omega_l")
    state = mv.steady_state(quick)
    assert mv.find_lines(quick, start="steady") == mv.find_lines(state)
    assert mv.find_lines(quick, "omega_l", start="steady") == mv.find_lines(state, "omega_l")


def test_lines_without_a_steady_state_say_why(quick):
    noisy = quick.with_(NO_PERIOD)
    table = mv.find_lines(noisy, start="steady")
    assert table == mv.find_lines(mv.simulate(noisy))
    assert "from rest, because there is no steady state: " in table.source
    assert "no steady state" not in mv.find_lines(noisy).source


FORMER = {
    "lines": ("find_lines", lambda f, s: f(mv.simulate(s))),
    "steady": ("find_lines", lambda f, s: f(s).lines),
    "run": ("run_scenario", lambda f, s: f(s).table),
    "batch": ("simulate_many", lambda f, s: [torque.T_d.size for torque in f([s])]),
    "rates": ("plan_rates", lambda f, s: f(s, ["0.06 deg/s"], linear=True)),
    "budget": ("pointing_budget", lambda f, s: f.__name__),
}


@pytest.mark.parametrize("name", FORMER)
def test_a_former_name_works_and_says_the_new_one(quick, name):
    new, use = FORMER[name]
    with pytest.warns(FutureWarning, match=f"^microvib.{name} is called microvib.{new}") as told:
        former = getattr(mv, name)
    assert told[0].filename == __file__
    assert name not in dir(mv)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert use(former, quick)
        getattr(mv, new)


def test_an_import_takes_no_numerics():
    text = "import sys, microvib; print([m for m in ('numpy', 'pydantic', 'llvmlite') if m in sys.modules])"
    environment = {**os.environ, "PYTHONPATH": str(Path(mv.__file__).parents[1])}
    found = subprocess.run(
        [sys.executable, "-c", text], env=environment, capture_output=True, text=True, check=True
    )
    assert found.stdout.strip() == "[]"


@pytest.mark.parametrize(
    "name", [name for name in PUBLIC if ">>> " in inspect.getdoc(PUBLIC[name])]
)
def test_an_example_of_a_docstring_gives_what_it_shows(name):
    found = doctest.DocTestFinder(recurse=False).find(PUBLIC[name], name, globs={})
    assert found
    for test in found:
        said = []
        doctest.DocTestRunner(verbose=False).run(test, out=said.append)
        assert not said, "".join(said)


def test_a_former_attribute_of_a_public_class_works_and_says_the_new_one():
    recording = mv.Recording({"Mz": np.arange(16.0)}, 8.0, {"Mz": "N*m"})
    with pytest.warns(FutureWarning, match="^Recording.told is called notes_on; the old name goes"):
        assert recording.told("Mz") == recording.notes_on("Mz")
    motion = mv.Motion(mv.load_scenario("state-1"), np.zeros(1), {}, None)
    with pytest.warns(FutureWarning, match="^Motion.beside is called second_wing"):
        assert motion.beside is None
