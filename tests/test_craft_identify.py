"""Evidence of a drive that a craft carries: loads on the hub in flight, and a force table, which stands on the ground."""

import numpy as np
import pytest
from support import craft as whole
from support.craft_scenarios import scenario_of
from support.scenarios import recorded

import microvib as mv
from microvib.io.scenario_file import load_bench
from microvib.model.scenario import Scenario
from microvib.studies.measure import measure
from microvib.units import Si

SHORT = {"record.settle": Si(4.0), "record.duration": Si(4.0)}
WING = {
    "interface": {
        "position": [0.35, -0.9, -0.2],
        "drive_axis": [0.0, -1.0, 0.0],
        "reference": [1.0, 0.0, 0.0],
    }
}


def craft(**changes: object) -> Scenario:
    return scenario_of(whole.FullCraft(bandwidth=0.05), **{**SHORT, **changes})


@pytest.mark.parametrize("own", [{}, {"spacecraft": None}])
def test_a_parameter_of_the_drive_is_found_in_flight_and_on_the_ground(
    own: dict[str, None],
) -> None:
    scenario, true = craft(), 8800.0
    recording = recorded(scenario.with_si({"reducer.stiffness": true, **own}))
    fit = mv.identify(
        scenario, [(recording, own)], ["reducer.stiffness=8000N*m/rad:9500N*m/rad"], starts=2
    )
    assert fit.goodness.explained
    assert fit.scenario.reducer.stiffness == pytest.approx(true, rel=0.005)
    assert fit.scenario.spacecraft == scenario.spacecraft
    said = any("For a recording of a force table" in note for note in fit.notes)
    assert said == (not own)


def test_two_drives_in_one_recording_are_refused() -> None:
    recording = mv.Recording({"Mz": np.sin(np.arange(8192) / 9.0)}, 1024.0, {"Mz": "N*m"}, "made")
    two = craft(**{"spacecraft.second_wing": {**WING, "drive": "driven"}})
    with pytest.raises(
        mv.MicrovibError,
        match=r"made: spacecraft\.second_wing\.drive: driven is not supported by identification",
    ):
        mv.identify(two, [recording], ["reducer.stiffness"])


def test_a_force_table_stands_on_the_ground() -> None:
    scenario = craft(**{"record.settle": Si(1.0)})
    bench = load_bench("force-table").model_copy(update={"duration": 2.0})
    flown, ground = measure(scenario, bench), measure(scenario.with_si({"spacecraft": None}), bench)
    assert flown.channels.keys() == ground.channels.keys()
    assert np.ptp(ground["Fx"]) > 0.0
    for name in ground.channels:
        assert np.array_equal(flown[name], ground[name])
    assert any("without their spacecraft" in note for note in flown.notes)
