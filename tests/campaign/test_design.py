"""What a study varies, and how it is sampled."""

from __future__ import annotations

import numpy as np
import pytest
from support.campaigns import SHORT, Fragile, spread, study

from microvib.errors import ScenarioError
from microvib.io.scenario_file import load_scenario
from microvib.studies.campaign.design import Design, design
from microvib.studies.campaign.folder import create, open_campaign
from microvib.studies.campaign.results import merge, open_results
from microvib.studies.campaign.run import compute_missing
from microvib.studies.campaign.study_file import Study
from microvib.studies.campaign.variation import RESERVED_NAMES


def vary(key: str, spec, **keys) -> Design:
    return design(study(vary={key: spec}, **keys))


def test_levels_combine_and_samples_repeat_at_each_level():
    d = design(spread(count=5))
    assert d.cases == 10
    assert [d.changes(k)["driver.microsteps"] for k in range(10)] == [8] * 5 + [16] * 5
    stiffness = [d.changes(k)["reducer.stiffness"] for k in range(10)]
    assert stiffness[:5] == stiffness[5:]
    assert len(set(stiffness[:5])) == 5


def test_combinations_go_with_every_level():
    d = design(
        study(
            cases=[
                {"tracking.rate": "0.06 deg/s"},
                {"tracking.rate": "0.1 deg/s", "array.inertia": "9 kg*m^2"},
            ]
        )
    )
    assert d.cases == 4
    assert d.changes(3) == {
        "tracking.rate": np.radians(0.1),
        "array.inertia": 9.0,
        "driver.microsteps": 16,
    }


def test_a_group_that_the_scenario_has_is_a_level():
    """As is one that it has not: friction with and without its memory."""
    without, other = None, {"stiffness": "5000 N*m/rad"}
    for base in ({}, {"friction.presliding": {"stiffness": "3000 N*m/rad"}}):
        d = design(study(vary={"friction.presliding": [without, other]}, set={**SHORT, **base}))
        levels = [d.base.with_si(d.changes(k)).friction.presliding for k in range(d.cases)]
        assert levels[0] is None
        assert levels[1].stiffness == 5000.0


def test_one_factor_scales_several_keys_together():
    keys = ["friction.coulomb", "friction.breakaway"]
    with pytest.raises(ScenarioError, match="below coulomb"):
        vary("friction.breakaway", {"distribution": "uniform", "within": "50 percent"})
    d = vary("dry friction", {"scale": keys, "distribution": "uniform", "within": "50 percent"})
    assert d.keys == ("dry friction",)
    before = d.base.friction
    factors = d.column("dry friction")
    assert 0.5 < factors.min() < 0.55
    assert 1.45 < factors.max() < 1.5
    for case in (0, 1, 2):
        after = d.scenario(case).friction
        assert after.coulomb == pytest.approx(factors[case] * before.coulomb, rel=1e-14)
        assert after.breakaway == pytest.approx(factors[case] * before.breakaway, rel=1e-14)
        assert set(d.changes(case)) == set(keys)
        assert d.labels(case) == {"dry friction": f"{factors[case]:.6g}"}
    assert (
        d.uncertain[0].text == "factor on friction.coulomb, friction.breakaway; uniform, 0.5 to 1.5"
    )


def two_modes(**keys) -> Study:
    modes = [{"frequency": "1 Hz", "damping": 0.01, "effective_inertia": "4 kg*m^2"},
             {"frequency": "3 Hz", "damping": 0.02, "effective_inertia": "2 kg*m^2"}]  # fmt: skip
    return study(set={**SHORT, "array.modes": modes, "array.rigid_inertia": "2.18 kg*m^2"}, **keys)


@pytest.mark.parametrize(
    ("name", "spec", "dampings"),
    [
        ("array.modes.*.damping", ["0.5 percent", "3 percent"], [(0.005, 0.005), (0.03, 0.03)]),
        (
            "array.modes.*.damping",
            {"from": "1 %", "to": "2 %", "count": 2},
            [(0.01, 0.01), (0.02, 0.02)],
        ),
        (
            "all dampings",
            {"scale": "array.modes.*.damping", "values": [0.5, 2]},
            [(0.005, 0.01), (0.02, 0.04)],
        ),
        (
            "all dampings",
            {"scale": ["array.modes.*.damping"], "from": 1, "to": 3, "count": 2},
            [(0.01, 0.02), (0.03, 0.06)],
        ),
    ],
)
def test_a_star_stands_for_every_mode(name, spec, dampings):
    d = design(two_modes(vary={name: spec}))
    for case, expected in enumerate(dampings):
        assert tuple(mode.damping for mode in d.scenario(case).array.modes) == pytest.approx(
            expected
        )
    d = design(
        two_modes(vary={"driver.microsteps": [8]}, cases=[{"array.modes.*.damping": "4 percent"}])
    )
    assert [mode.damping for mode in d.scenario(0).array.modes] == [0.04, 0.04]


def test_factors_and_stars_are_kept_with_the_campaign(tmp_path):
    made = two_modes(vary={"all dampings": {"scale": "array.modes.*.damping", "values": [0.5, 2]},
                           "dry": {"scale": ["friction.coulomb", "friction.breakaway"], "distribution": "uniform", "within": 0.5},
                           "array.modes.*.frequency": ["1 Hz", "2 Hz"]}, sampling={"count": 2})  # fmt: skip
    campaign = create(design(made), tmp_path / "c")
    again = open_campaign(tmp_path / "c")
    assert (again.design.levels, again.design.uncertain) == (
        campaign.design.levels,
        campaign.design.uncertain,
    )
    assert [again.design.changes(k) for k in range(8)] == [
        campaign.design.changes(k) for k in range(8)
    ]
    compute_missing(again, Fragile())
    merge(again)
    data = open_results(again).dataset
    assert data["all dampings"].values.tolist() == [0.5] * 4 + [2.0] * 4
    assert data["array.modes.*.frequency"].attrs["units"] == "Hz"
    assert set(RESERVED_NAMES) >= {*data.dims, *data.variables} - set(again.design.keys)


def test_grids():
    even = vary("tracking.rate", {"from": "0.02 deg/s", "to": "0.1 deg/s", "count": 5})
    np.testing.assert_allclose(np.degrees(even.levels[0].values), [0.02, 0.04, 0.06, 0.08, 0.1])
    steps = {"from": "1000 N*m/rad", "to": "4000 N*m/rad", "count": 3, "spacing": "logarithmic"}
    np.testing.assert_allclose(
        vary("reducer.stiffness", steps).levels[0].values, [1000.0, 2000.0, 4000.0]
    )


@pytest.mark.parametrize(
    ("spec", "quantiles"),
    [
        ({"distribution": "normal", "mean": "5000 N*m/rad", "deviation": "100 N*m/rad"}, (4900.0, 5000.0, 5100.0)),
        ({"distribution": "uniform", "low": "4000 N*m/rad", "high": "6000 N*m/rad"}, (4317.31, 5000.0, 5682.69)),
        ({"distribution": "log-normal", "median": "5000 N*m/rad", "factor": 1.1}, (5000 / 1.1, 5000.0, 5500.0)),
        ({"distribution": "triangular", "low": "4000 N*m/rad", "peak": "5000 N*m/rad", "high": "6000 N*m/rad"},
         (4000 + 1000 * np.sqrt(2 * 0.158655), 5000.0, 6000 - 1000 * np.sqrt(2 * 0.158655))),
    ],
)  # fmt: skip
def test_distributions_have_the_quantiles_of_their_names(spec, quantiles):
    found = (
        vary("reducer.stiffness", spec).uncertain[0].quantile(np.array([0.1586553, 0.5, 0.8413447]))
    )
    np.testing.assert_allclose(found, quantiles, rtol=1e-5)


def test_truncation_keeps_the_shape_inside():
    spec = {
        "distribution": "normal",
        "mean": "5000 N*m/rad",
        "deviation": "100 N*m/rad",
        "lower": "5000 N*m/rad",
    }
    x = vary("reducer.stiffness", spec, sampling={"method": "random", "count": 4000}).samples[:, 0]
    assert x.min() >= 5000.0
    assert np.mean(x) == pytest.approx(
        5000.0 + 100.0 * np.sqrt(2.0 / np.pi), abs=4.0
    )  # the mean of a half normal


def test_correlation_is_that_of_the_normal_scores():
    both = {
        key: {"distribution": "normal", "relative_deviation": "5 percent"}
        for key in ("reducer.stiffness", "array.inertia")
    }
    pair = [{"keys": list(both), "coefficient": 0.8}]
    x = design(
        study(vary=both, correlations=pair, sampling={"method": "random", "count": 4000})
    ).samples
    assert np.corrcoef(x.T)[0, 1] == pytest.approx(0.8, abs=0.02)


@pytest.mark.parametrize("method", ["sobol", "latin-hypercube", "random"])
def test_samples_fill_the_distribution_and_repeat_with_their_seed(method):
    spec = {"distribution": "uniform", "low": "4000 N*m/rad", "high": "6000 N*m/rad"}
    first, again, other = (
        vary(
            "reducer.stiffness", spec, sampling={"method": method, "count": 50, "seed": seed}
        ).samples
        for seed in (1, 1, 2)
    )
    np.testing.assert_array_equal(first, again)
    assert not np.array_equal(first, other)
    assert first.mean() == pytest.approx(5000.0, abs=200.0)


def test_arrays_of_several_sources():
    names = ["reference-sas", "reference-array"]
    d = design(study(vary={"array.fem": names}))
    assert (d.levels[0].key, d.levels[0].labels) == ("array", tuple(names))
    for case, name in enumerate(names):
        assert d.scenario(case).array == load_scenario("state-1", {"array.fem": name}).array


@pytest.mark.parametrize(
    ("keys", "sentence"),
    [
        ({"vary": {}}, "vary: missing; at least one key"),
        ({"vary": {"reducer.stifness": [1]}}, "vary.reducer.stifness: is not a key of the scenario; did you mean reducer.stiffness? allowed are reducer.ratio"),
        ({"vary": {"reducer.stiffness": []}}, "the list is empty"),
        ({"vary": {"x": {"scale": ["friction.slip_ring.contact_pairs"], "values": [1]}}}, "contact_pairs is 320, not a number"),
        ({"vary": {"x": {"scale": [], "values": [1]}}}, "vary.x.scale: [] is not allowed; a list of keys"),
        ({"vary": {"x": {"scale": "motor.*.y", "values": [1]}}}, "vary.x.scale: motor.*.y: is not a key of the scenario"),
        ({"vary": {"x": {"scale": "motor.current", "values": 2}}}, "vary.x.values: 2 is not allowed; a list of factors"),
        ({"vary": {"x": {"scale": "motor.current", "values": ["2 A"]}}}, "has the wrong dimension"),
        ({"vary": {"peak": {"scale": "motor.current", "values": [2]}}}, "is not allowed as the name of a factor"),
        ({"vary": {"motor.current": {"scale": "motor.current", "values": [2]}}}, "is not allowed as the name of a factor"),
        ({"vary": {"x": {"scale": "motor.current", "values": [2]}, "motor.current": ["1 A"]}}, "motor.current occurs twice in vary"),
        ({"vary": {"x": {"scale": "motor.current", "values": [2]}}, "cases": [{"motor.current": "1 A"}]}, "in vary and in cases"),
        ({"vary": {"driver.*_gain": {"distribution": "uniform", "within": 0.1}}}, "vary.driver.*_gain: has no one value"),
        ({"vary": {"reducer.stiffness": ["5000 kg"]}}, "vary.reducer.stiffness.0: '5000 kg' has the wrong dimension"),
        ({"vary": {"reducer.stiffness": [5000]}}, "vary.reducer.stiffness.0: 5000 needs a unit, such as '5000 N*m/rad'"),
        ({"vary": {"reducer.stiffness": ["-1 N*m/rad"]}}, "must be greater than 0 N*m/rad"),
        ({"vary": {"driver.microsteps": [0]}}, "driver.microsteps: 0 is not allowed; a whole number from 1"),
        ({"vary": {"driver.microsteps": {"distribution": "uniform"}}}, "is not a physical quantity; write a list"),
        ({"vary": {"reducer.stiffness": {"distribution": "gauss"}}}, "'gauss' is not allowed; write normal, uniform"),
        ({"vary": {"reducer.stiffness": {"distribution": "normal"}}}, "give deviation or relative_deviation"),
        ({"vary": {"reducer.stiffness": {"distribution": "normal", "sigma": 1}}}, "sigma: unknown key; allowed here are"),
        ({"vary": {"reducer.stiffness": {"distribution": "log-normal", "factor": 0.9}}}, "must be greater than 1"),
        ({"vary": {"reducer.stiffness": {"distribution": "uniform", "low": "2 N*m/rad", "high": "1 N*m/rad"}}}, "low: must be below high"),
        ({"vary": {"reducer.stiffness": {"from": "1 N*m/rad", "to": "9 N*m/rad"}}}, "count: None is not allowed; a whole number from 2"),
        ({"vary": {"friction.viscous": {"distribution": "normal", "relative_deviation": 0.9}}}, "must be at least 0"),
        ({"sampling": {"method": "halton"}}, "sampling.method: 'halton' is not allowed"),
        ({"sampling": {"noise": "each"}}, "sampling.noise: the scenario has none; a friction.torque_noise is expected"),
        ({"sampling": {"noise": "each", "method": "one-at-a-time"}}, "noise: each goes with sobol, latin-hypercube and random points"),
        ({"correlations": [{"keys": ["reducer.ratio", "motor.current"], "coefficient": 0.5}]}, "correlations: nothing is sampled"),
        ({"cases": [{"driver.microsteps": 4}]}, "driver.microsteps occurs in vary and in cases"),
        ({"limit": 0.01}, "limit: 0.01 needs a unit, such as '0.01 mN*m'"),
    ],
)  # fmt: skip
def test_a_study_that_cannot_be_says_which_key_and_what_is_allowed(keys, sentence):
    with pytest.raises(ScenarioError) as caught:
        design(study(**keys))
    assert sentence in str(caught.value)


def test_correlations_that_contradict_each_other():
    keys = ["reducer.stiffness", "array.inertia", "motor.current"]
    some = {key: {"distribution": "normal", "relative_deviation": "2 percent"} for key in keys}
    pairs = [
        {"keys": [keys[a], keys[b]], "coefficient": c}
        for a, b, c in ((0, 1, 0.9), (1, 2, 0.9), (0, 2, -0.9))
    ]
    with pytest.raises(ScenarioError, match="contradict each other"):
        design(study(vary=some, correlations=pairs))
