"""Campaigns: cases, workers that die, results that do not depend on who computed them."""

from __future__ import annotations

import json
import os
import resource
import shutil
import signal
import stat
import subprocess
import sys
import threading
import time
from concurrent.futures import Executor, Future
from pathlib import Path

import h5py
import numpy as np
import pytest
from support import commands
from support.scenarios import limit_of

import microvib as mv
from microvib.analysis.limits import judge
from microvib.errors import MicrovibError, OutputError, ScenarioError
from microvib.io.scenario_file import load_scenario
from microvib.model.sentences import validated
from microvib.reports.campaign.report import campaign_report, summarise
from microvib.reports.campaign.text import report_text, state_text
from microvib.reports.document import Table
from microvib.reports.rendering import html
from microvib.studies.campaign import cases as computing
from microvib.studies.campaign import folder
from microvib.studies.campaign import run as running
from microvib.studies.campaign.design import Design, design
from microvib.studies.campaign.effects import _first_and_total, sobol, tornado
from microvib.studies.campaign.folder import Campaign, create, open_campaign
from microvib.studies.campaign.results import DONE, FAILED, MISSING, merge, open_results
from microvib.studies.campaign.run import STRIKES, compute_missing, local
from microvib.studies.campaign.slurm import submit
from microvib.studies.campaign.statistics import (
    ANY,
    at_any_level,
    draws_needed,
    governing,
    largest_line,
    line_statistics,
    proportion,
    quantile,
    worst_cases,
)
from microvib.studies.campaign.study_file import Study
from microvib.studies.campaign.variation import TAKEN

SHORT = {"record.settle": "0.2 s", "record.duration": "1 s", "record.sample_rate": "1024 Hz"}
EVERYTHING = (0.0, np.inf)


def study(**keys) -> Study:
    data = {"scenario": "state-1", "set": SHORT, "vary": {"driver.microsteps": [8, 16]}, **keys}
    return validated(Study, data)


def spread(count: int = 6, **keys) -> Study:
    vary = {
        "driver.microsteps": [8, 16],
        "reducer.stiffness": {"distribution": "normal", "relative_deviation": "5 percent", "lower": "4000 N*m/rad"},
        "friction.breakaway": {"distribution": "uniform", "within": "20 percent"},
    }
    return study(**{"vary": vary, "sampling": {"method": "random", "count": count, "seed": 3}, **keys})


class Inline(Executor):
    """Computes at once; dies of the cases in ``deadly``, by the value of what varies."""

    def __init__(self, deadly=()) -> None:
        self.deadly, self.died = deadly, False

    def submit(self, fn, /, work):
        future: Future[bytes] = Future()
        lethal = [k for k, item in enumerate(work.changes) if item.get("driver.microsteps") in self.deadly]
        if self.died:
            raise BrokenPipeError("this executor is broken")
        if any(k not in work.deadly for k in lethal):
            self.died = True
            future.set_exception(BrokenPipeError("the worker died"))
        else:
            future.set_result(fn(work))
        return future


class Fragile:
    """A backend whose workers die of certain cases."""

    workers = 1
    deaths = (BrokenPipeError,)

    def __init__(self, deadly=()) -> None:
        self.deadly = deadly

    def executor(self) -> Executor:
        return Inline(self.deadly)

    def watch(self) -> None:
        pass


def made(tmp_path: Path, of: Study, name: str = "c", chunk: int | None = None) -> Campaign:
    return create(design(of), tmp_path / name, chunk)


def bytes_of(campaign: Campaign) -> list[bytes]:
    return [campaign.file(k).read_bytes() for k in campaign.done()]


def figures_of(campaign: Campaign) -> dict[str, np.ndarray]:
    merge(campaign)
    with h5py.File(campaign.folder / "results.nc") as f:
        return {name: f[name][...] for name in ("amplitude", "frequency", "phase", "state", "peak", "rms")}


def same(a: dict[str, np.ndarray], b: dict[str, np.ndarray]) -> bool:
    return all(np.array_equal(a[name], b[name], equal_nan=True) for name in a)


# -- what varies ------------------------------------------------------------------------------------------------------


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
        study(cases=[{"tracking.rate": "0.06 deg/s"}, {"tracking.rate": "0.1 deg/s", "array.inertia": "9 kg*m^2"}])
    )
    assert d.cases == 4
    assert d.changes(3) == {"tracking.rate": np.radians(0.1), "array.inertia": 9.0, "driver.microsteps": 16}


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
    assert d.uncertain[0].text == "factor on friction.coulomb, friction.breakaway; uniform, 0.5 to 1.5"


def two_modes(**keys) -> Study:
    modes = [{"frequency": "1 Hz", "damping": 0.01, "effective_inertia": "4 kg*m^2"},
             {"frequency": "3 Hz", "damping": 0.02, "effective_inertia": "2 kg*m^2"}]  # fmt: skip
    return study(set={**SHORT, "array.modes": modes, "array.rigid_inertia": "2.18 kg*m^2"}, **keys)


@pytest.mark.parametrize(
    ("name", "spec", "dampings"),
    [
        ("array.modes.*.damping", ["0.5 percent", "3 percent"], [(0.005, 0.005), (0.03, 0.03)]),
        ("array.modes.*.damping", {"from": "1 %", "to": "2 %", "count": 2}, [(0.01, 0.01), (0.02, 0.02)]),
        ("all dampings", {"scale": "array.modes.*.damping", "values": [0.5, 2]}, [(0.005, 0.01), (0.02, 0.04)]),
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
        assert tuple(mode.damping for mode in d.scenario(case).array.modes) == pytest.approx(expected)
    d = design(two_modes(vary={"driver.microsteps": [8]}, cases=[{"array.modes.*.damping": "4 percent"}]))
    assert [mode.damping for mode in d.scenario(0).array.modes] == [0.04, 0.04]


def test_factors_and_stars_are_kept_with_the_campaign(tmp_path):
    made = two_modes(vary={"all dampings": {"scale": "array.modes.*.damping", "values": [0.5, 2]},
                           "dry": {"scale": ["friction.coulomb", "friction.breakaway"], "distribution": "uniform", "within": 0.5},
                           "array.modes.*.frequency": ["1 Hz", "2 Hz"]}, sampling={"count": 2})  # fmt: skip
    campaign = create(design(made), tmp_path / "c")
    again = open_campaign(tmp_path / "c")
    assert (again.design.levels, again.design.uncertain) == (campaign.design.levels, campaign.design.uncertain)
    assert [again.design.changes(k) for k in range(8)] == [campaign.design.changes(k) for k in range(8)]
    compute_missing(again, Fragile())
    merge(again)
    data = open_results(again).dataset
    assert data["all dampings"].values.tolist() == [0.5] * 4 + [2.0] * 4
    assert data["array.modes.*.frequency"].attrs["units"] == "Hz"
    assert set(TAKEN) >= {*data.dims, *data.variables} - set(again.design.keys)


def test_grids():
    even = vary("tracking.rate", {"from": "0.02 deg/s", "to": "0.1 deg/s", "count": 5})
    np.testing.assert_allclose(np.degrees(even.levels[0].values), [0.02, 0.04, 0.06, 0.08, 0.1])
    steps = {"from": "1000 N*m/rad", "to": "4000 N*m/rad", "count": 3, "spacing": "logarithmic"}
    np.testing.assert_allclose(vary("reducer.stiffness", steps).levels[0].values, [1000.0, 2000.0, 4000.0])


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
    found = vary("reducer.stiffness", spec).uncertain[0].quantile(np.array([0.1586553, 0.5, 0.8413447]))
    np.testing.assert_allclose(found, quantiles, rtol=1e-5)


def test_truncation_keeps_the_shape_inside():
    spec = {"distribution": "normal", "mean": "5000 N*m/rad", "deviation": "100 N*m/rad", "lower": "5000 N*m/rad"}
    x = vary("reducer.stiffness", spec, sampling={"method": "random", "count": 4000}).samples[:, 0]
    assert x.min() >= 5000.0
    assert np.mean(x) == pytest.approx(5000.0 + 100.0 * np.sqrt(2.0 / np.pi), abs=4.0)  # the mean of a half normal


def test_correlation_is_that_of_the_normal_scores():
    both = {
        key: {"distribution": "normal", "relative_deviation": "5 percent"}
        for key in ("reducer.stiffness", "array.inertia")
    }
    pair = [{"keys": list(both), "coefficient": 0.8}]
    x = design(study(vary=both, correlations=pair, sampling={"method": "random", "count": 4000})).samples
    assert np.corrcoef(x.T)[0, 1] == pytest.approx(0.8, abs=0.02)


@pytest.mark.parametrize("method", ["sobol", "latin-hypercube", "random"])
def test_samples_fill_the_distribution_and_repeat_with_their_seed(method):
    spec = {"distribution": "uniform", "low": "4000 N*m/rad", "high": "6000 N*m/rad"}
    first, again, other = (
        vary("reducer.stiffness", spec, sampling={"method": method, "count": 50, "seed": seed}).samples
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
        ({"vary": {"reducer.stifness": [1]}}, "vary.reducer.stifness: is not a key of the scenario; allowed are reducer.ratio"),
        ({"vary": {"reducer.stiffness": []}}, "the list is empty"),
        ({"vary": {"x": {"scale": ["friction.slip_ring.contact_pairs"], "values": [1]}}}, "contact_pairs is 320, not a number"),
        ({"vary": {"x": {"scale": [], "values": [1]}}}, "vary.x.scale: [] is not allowed; a list of keys"),
        ({"vary": {"x": {"scale": "motor.*.y", "values": [1]}}}, "vary.x.scale: motor.*.y: is not a key of the scenario"),
        ({"vary": {"x": {"scale": "motor.current", "values": 2}}}, "vary.x.values: 2 is not allowed; a list of factors"),
        ({"vary": {"x": {"scale": "motor.current", "values": ["2 A"]}}}, "has the wrong dimension"),
        ({"vary": {"peak": {"scale": "motor.current", "values": [2]}}}, "is not allowed as the name of a factor"),
        ({"vary": {"motor.current": {"scale": "motor.current", "values": [2]}}}, "is not allowed as the name of a factor"),
        ({"vary": {"x": {"scale": "motor.current", "values": [2]}, "motor.current": ["1 A"]}}, "motor.current stands in vary twice"),
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
        ({"correlations": [{"keys": ["reducer.ratio", "motor.current"], "coefficient": 0.5}]}, "correlations: nothing is sampled"),
        ({"cases": [{"driver.microsteps": 4}]}, "driver.microsteps stands in vary and in cases"),
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
    pairs = [{"keys": [keys[a], keys[b]], "coefficient": c} for a, b, c in ((0, 1, 0.9), (1, 2, 0.9), (0, 2, -0.9))]
    with pytest.raises(ScenarioError, match="contradict each other"):
        design(study(vary=some, correlations=pairs))


# -- computing --------------------------------------------------------------------------------------------------------


def test_results_do_not_depend_on_chunks_workers_or_order(tmp_path):
    one, two, three = (made(tmp_path, spread(), f"c{k}", size) for k, size in enumerate((12, 5, 5)))
    compute_missing(one, Fragile())
    with local(2) as backend:
        compute_missing(two, backend)
    for k in (1, 0):  # shards, the last first
        compute_missing(three, Fragile(), shard=(k, 2))
    assert bytes_of(two) == bytes_of(three)
    assert same(figures_of(one), figures_of(two))
    assert np.all(figures_of(one)["state"] == DONE)


def test_dask_gives_the_same_bytes(tmp_path):
    from microvib.studies.campaign.on_dask import dask

    one, two = (made(tmp_path, spread(), name, 3) for name in ("inline", "dask"))
    compute_missing(one, Fragile())
    with dask(2) as backend:
        compute_missing(two, backend)
    assert bytes_of(one) == bytes_of(two)


def test_no_scheduler_is_a_sentence(monkeypatch):
    from microvib.studies.campaign import on_dask

    monkeypatch.setattr(on_dask, "CONNECT", "1s")
    with pytest.raises(MicrovibError, match="no Dask scheduler answers there"), on_dask.dask(1, "tcp://127.0.0.1:9"):
        pass


def test_a_case_agrees_with_the_run_of_its_scenario(tmp_path):
    campaign = made(tmp_path, spread(count=1))
    compute_missing(campaign, Fragile())
    chunk = campaign.read(0)
    table = mv.lines(mv.simulate(campaign.design.scenario(1)))
    for name in ("drive_1", "drive_2"):
        k = chunk.lines.index(name)
        assert chunk.figures["amplitude"][1, k] == pytest.approx(table[name].amplitude_n_m, rel=2e-3)


def test_a_campaign_judges_what_a_run_judges(tmp_path):
    """Also lines that nobody expected, and what could not be looked at. Stick and slip in turns make the former at this rate."""
    vary = {"driver.microsteps": [16, 32], "record.sample_rate": ["100 Hz", "1024 Hz"]}
    record = {"record.settle": "6 s", "record.duration": "6 s", "tracking.rate": "0.02 deg/s"}
    campaign = made(tmp_path, study(vary=vary, set=record, limit="40 mN*m", band="1.5:400 Hz"))
    compute_missing(campaign, Fragile())
    merge(campaign)
    results = open_results(campaign)
    seen = set()
    for case in range(4):
        scenario = campaign.design.scenario(case)
        table = mv.lines(mv.simulate(scenario))
        expected = judge(table, limit_of(0.04, 1.5, 400.0), scenario)
        assert computing.VERDICTS[results.verdicts[case]] == expected.verdict
        assert bool(results.gaps[case]) == bool(expected.gaps)
        finite = [x.amplitude_n_m for x in table if np.isfinite(x.amplitude_n_m)]
        assert largest_line(results, EVERYTHING)[case] == pytest.approx(max(finite), rel=5e-3)
        seen.add(expected.verdict)
    assert "not judged" in seen
    assert any(name.startswith("other_") for name in results.lines)


def test_cases_that_could_not_be_judged_are_neither_above_nor_below(tmp_path):
    some = {"friction.breakaway": {"distribution": "uniform", "within": "1 percent"}}
    low = {"set": SHORT | {"record.sample_rate": "100 Hz"}, "sampling": {"method": "random", "count": 8}}
    results = computed(tmp_path, study(vary=some, limit="1 mN*m", band="60:400 Hz", **low))
    row = line_statistics(results, 1e-3, (60.0, 400.0))
    assert row == [] or (row[0].above, row[0].unknown) == (0, 8)
    any_level = at_any_level(results, 1e-3, (60.0, 400.0))
    assert (any_level.above, any_level.unknown) == (0, 8)
    assert (any_level.exceedance.low, any_level.exceedance.high) == (0.0, 1.0)


def test_steady_cases(tmp_path):
    campaign = made(tmp_path, study(solve="steady", vary={"driver.microsteps": [16]}))
    compute_missing(campaign, Fragile())
    chunk = campaign.read(0)
    lines = mv.steady(campaign.design.scenario(0)).lines
    assert chunk.figures["amplitude"][0, chunk.lines.index("drive_1")] == lines["drive_1"].amplitude_n_m


def test_failures_keep_their_reason_and_stop_nothing(tmp_path, monkeypatch):
    rates = ["0.06 deg/s", "50 deg/s", "0.07 deg/s"]  # the motor cannot follow the second
    spread = {"distribution": "normal", "mean": "6 ohm", "deviation": "6 ohm"}  # negative now and then
    monkeypatch.setattr("microvib.studies.campaign.design.CHECKED", (0.5,))
    campaign = made(tmp_path, study(vary={"tracking.rate": rates, "motor.winding_resistance": spread},
                                    sampling={"method": "random", "count": 8}))  # fmt: skip
    real = computing.lines_of_samples
    broken = campaign.design.scenario(0).motor.winding_resistance

    def sometimes(x, sample_rate, scenario, harmonics):
        if scenario.motor.winding_resistance == broken and scenario.tracking.rate < np.radians(0.065):
            raise ZeroDivisionError("deliberate")
        return real(x, sample_rate, scenario, harmonics)

    monkeypatch.setattr(computing, "lines_of_samples", sometimes)
    compute_missing(campaign, Fragile())
    merge(campaign)
    results = open_results(campaign)
    reasons = results.reasons
    assert reasons[0] == "unexpected ZeroDivisionError: deliberate"
    assert all("loss of synchronism" in r or "must be greater than 0 ohm" in r for r in reasons[8:16])
    negative = [k for k in range(24) if campaign.design.changes(k)["motor.winding_resistance"] <= 0.0]
    assert negative
    assert all("motor.winding_resistance" in reasons[k] for k in negative)
    fine = [k for k in (*range(1, 8), *range(16, 24)) if k not in negative]
    assert all(results.state[k] == DONE for k in fine)
    assert np.sum(results.state == FAILED) == 24 - len(fine)


def test_a_deadly_case_is_found_and_the_others_are_computed(tmp_path):
    levels = {"vary": {"driver.microsteps": [4, 8, 16, 32]}}
    hurt, whole = made(tmp_path, study(**levels), "hurt", 2), made(tmp_path, study(**levels), "whole", 2)
    compute_missing(hurt, Fragile(deadly=(16,)))
    compute_missing(whole, Fragile())
    merge(hurt)
    results = open_results(hurt)
    assert "its worker died each time" in results.reasons[2]
    assert list(results.state) == [DONE, DONE, FAILED, DONE]
    assert bytes_of(hurt)[0] == bytes_of(whole)[0]
    assert STRIKES > 1


def test_workers_that_cannot_start_are_no_fault_of_the_cases(tmp_path):
    class Dead(Fragile):
        def executor(self):
            executor = Inline()
            executor.submit = lambda fn, work: (future := Future(), future.set_exception(BrokenPipeError()))[0]
            return executor

    campaign = made(tmp_path, study())
    with pytest.raises(MicrovibError, match="workers end as soon as they start"):
        compute_missing(campaign, Dead())
    assert campaign.done() == []


def test_a_full_disk_leaves_nothing_and_loses_nothing(tmp_path):
    campaign = made(tmp_path, spread(), chunk=3)
    compute_missing(campaign, Fragile(), shard=(0, 2))
    before = bytes_of(campaign)
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    ignored = signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    resource.setrlimit(resource.RLIMIT_FSIZE, (1000, limits[1]))
    try:
        with pytest.raises(OutputError, match="what was computed before is kept"):
            compute_missing(campaign, Fragile())
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
        signal.signal(signal.SIGXFSZ, ignored)
    assert bytes_of(campaign) == before
    assert all(not name.startswith(".") for name in os.listdir(campaign.folder / "chunks"))
    compute_missing(campaign, Fragile())
    assert campaign.missing() == []


def test_statuses_of_many_cases_are_few(tmp_path):
    """Each rate needs a record of its own length; two hundred of such texts would be no status."""
    rates = {"from": "0.001 deg/s", "to": "0.06 deg/s", "count": 40}
    campaign = made(tmp_path, study(vary={"tracking.rate": rates}))
    compute_missing(campaign, Fragile())
    statuses = {text for _, chunk in campaign.results() for text in chunk.statuses}
    assert "not resolved" in statuses
    assert len(statuses) < 40
    assert not any(c.isdigit() for text in statuses for c in text.partition(" from ")[0])


def test_a_damaged_chunk_is_a_sentence_and_is_computed_again(tmp_path):
    campaign = made(tmp_path, spread(), chunk=3)
    compute_missing(campaign, Fragile())
    good = campaign.file(1).read_bytes()
    campaign.file(1).write_bytes(good[:-100])
    with pytest.raises(MicrovibError, match="is damaged"):
        merge(campaign)
    campaign.file(1).unlink()
    compute_missing(campaign, Fragile())
    assert campaign.file(1).read_bytes() == good


def test_histories_are_kept_when_asked_for(tmp_path):
    campaign = made(tmp_path, study(keep=["T_d"]))
    compute_missing(campaign, Fragile())
    kept = campaign.read(0).histories
    motion = mv.simulate(campaign.design.scenario(1), channels=("T_d",))
    assert sorted(kept) == [0, 1]
    assert np.abs(kept[1] - motion["T_d"]).max() < 1e-2 * np.abs(motion["T_d"]).max()


def test_a_campaign_that_was_changed_is_refused(tmp_path):
    campaign = made(tmp_path, spread())
    samples = np.load(campaign.folder / "samples.npy")
    np.save(campaign.folder / "samples.npy", samples * 1.01)
    with pytest.raises(MicrovibError, match="were changed after the campaign was made"):
        open_campaign(campaign.folder)


def test_a_chunk_in_the_wrong_place_is_refused_wherever_it_is_read(tmp_path):
    one, other = made(tmp_path, spread(), "one", 3), made(tmp_path, spread(limit="50 mN*m"), "other", 3)
    for campaign in (one, other):
        compute_missing(campaign, Fragile())
    first, second = one.file(0), one.file(1)
    kept = first.read_bytes()
    first.write_bytes(second.read_bytes())
    for look in (merge, state_text):
        with pytest.raises(MicrovibError, match="is chunk 1 of this campaign"):
            look(one)
    first.write_bytes(other.file(0).read_bytes())  # the same figures, but of a study with another limit
    with pytest.raises(MicrovibError, match="is of another campaign"):
        merge(one)
    first.write_bytes(kept)
    assert merge(one).done == 12


@pytest.mark.parametrize(
    ("name", "old", "new"),
    [
        ("study.yaml", "60 mN*m", "90 mN*m"),
        ("study.yaml", "count: 6", "count: 60"),
        ("scenario.yaml", "ratio: 100", "ratio: 101"),
        ("campaign.json", '"microvib": "', '"microvib": "9.'),
        ("campaign.json", '"chunk_size": 3', '"chunk_size": 4'),
        ("campaign.json", '"chunk_size": 3', '"chunk_size": 0'),
    ],
)
def test_no_file_of_a_campaign_may_be_edited(tmp_path, name, old, new):
    campaign = made(tmp_path, spread(limit="60 mN*m"), chunk=3)
    file = campaign.folder / name
    assert old in file.read_text()
    file.write_text(file.read_text().replace(old, new))
    with pytest.raises(MicrovibError, match=r"were changed after the campaign was made|is not a whole campaign"):
        open_campaign(campaign.folder)


def test_another_version_does_not_go_on(tmp_path, monkeypatch):
    campaign = made(tmp_path, spread(), chunk=3)
    for module in (folder, computing):
        monkeypatch.setattr(module, "package_versions", lambda: {"microvib": "9.0"})
    with pytest.raises(MicrovibError, match=r"was made by microvib .*, and this is 9\.0"):
        compute_missing(campaign, Fragile())
    with pytest.raises(MicrovibError, match=r"this is microvib 9\.0, but the campaign was made by"):  # as on a worker
        computing.compute(campaign.work(0))


def test_a_lost_manifest_is_made_again_from_any_chunk(tmp_path):
    campaign = made(tmp_path, spread(), chunk=3)
    compute_missing(campaign, Fragile(), shard=(1, 2))
    text = (campaign.folder / "campaign.json").read_text()
    (campaign.folder / "campaign.json").unlink()
    again = open_campaign(campaign.folder)
    assert "was written again" in again.mended
    assert (campaign.folder / "campaign.json").read_text() == text
    compute_missing(again, Fragile())
    assert merge(again).done == 12
    (campaign.folder / "campaign.json").unlink()
    shutil.rmtree(campaign.folder / "chunks")
    with pytest.raises(MicrovibError, match="is not a campaign"):
        open_campaign(campaign.folder)


def test_a_case_that_wants_too_much_memory_costs_one_case(tmp_path, monkeypatch):
    real = computing.simulate_torques

    def simulate(scenarios):
        if any(scenario.driver.microsteps == 16 for scenario in scenarios):
            raise MemoryError
        return real(scenarios)

    levels = {"vary": {"driver.microsteps": [4, 8, 16, 32]}}
    whole, short = made(tmp_path, study(**levels), "whole"), made(tmp_path, study(**levels), "short")
    compute_missing(whole, Fragile())
    monkeypatch.setattr(computing, "simulate_torques", simulate)
    compute_missing(short, Fragile())
    merge(short)
    results = open_results(short)
    assert list(results.state) == [DONE, DONE, FAILED, DONE]
    assert "memory is exhausted" in results.reasons[2]
    np.testing.assert_array_equal(short.read(0).figures["amplitude"][3], whole.read(0).figures["amplitude"][3])


def test_cases_that_take_longer_than_they_may_end_their_worker(tmp_path, monkeypatch):
    ended = threading.Event()
    monkeypatch.setattr(computing, "_end", ended.set)
    monkeypatch.setattr(computing, "STARTING", 0.0)
    real = computing.simulate_torques

    def slow(scenarios):
        ended.wait(5.0)
        return real(scenarios)

    monkeypatch.setattr(computing, "simulate_torques", slow)
    computing.compute_bytes(made(tmp_path, study(time_limit="0.05 s")).work(0))
    assert ended.is_set()
    ended.clear()
    monkeypatch.setattr(computing, "simulate_torques", real)
    computing.compute_bytes(made(tmp_path, study(time_limit="10 min"), "patient").work(0))
    assert not ended.wait(0.2)


@pytest.mark.skipif(not Path("/proc/self/task").is_dir(), reason="needs /proc")
def test_a_stopped_worker_is_ended_and_its_cases_are_computed(tmp_path, monkeypatch):
    monkeypatch.setattr(running, "POLL", 0.2)
    monkeypatch.setattr(running, "SILENT", 15)
    campaign = made(tmp_path, spread(count=20), chunk=4)
    stopped: list[int] = []

    def progress(done, total):
        if done and not stopped:
            stopped.append(
                max(p for p in children(os.getpid()) if b"spawn_main" in Path(f"/proc/{p}/cmdline").read_bytes())
            )
            os.kill(stopped[0], signal.SIGSTOP)

    with local(2) as backend:
        compute_missing(campaign, backend, progress=progress)
    assert stopped
    assert not alive(stopped[0])
    assert merge(campaign).done == 40


def test_an_opened_campaign_is_the_one_that_was_made(tmp_path):
    campaign = made(tmp_path, spread())
    again = open_campaign(campaign.folder)
    assert again.identity == campaign.identity
    assert [again.design.changes(k) for k in range(12)] == [campaign.design.changes(k) for k in range(12)]
    assert [x.text for x in again.design.uncertain] == [x.text for x in campaign.design.uncertain]


# -- killed ----------------------------------------------------------------------------------------------------------


def microvib(*arguments: object, **options) -> subprocess.Popen:
    command = [sys.executable, "-m", "microvib", "campaign", *map(str, arguments)]
    return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, **options)


def wait_for(condition, seconds: float = 120.0) -> None:
    until = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < until, "it took too long"
        time.sleep(0.02)


def children(pid: int) -> list[int]:
    try:
        return [int(p) for p in Path(f"/proc/{pid}/task/{pid}/children").read_text().split()]
    except OSError:
        return []


def alive(pid: int) -> bool:
    try:
        return Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()[0] != "Z"
    except OSError:
        return False


@pytest.fixture(scope="module")
def calm(tmp_path_factory) -> list[bytes]:
    """Chunks of a run that nothing happened to."""
    campaign = made(tmp_path_factory.mktemp("calm"), spread(count=60), "calm", 4)
    compute_missing(campaign, Fragile())
    return bytes_of(campaign)


@pytest.mark.skipif(not Path("/proc/self/task").is_dir(), reason="needs /proc")
@pytest.mark.parametrize(
    "what", ["interrupt", *(pytest.param(x, marks=pytest.mark.long) for x in ("worker", "coordinator", "group"))]
)
def test_whatever_is_killed_nothing_is_lost_and_nothing_twice(tmp_path, calm, what):
    """Kill in the middle, resume, and compare with a run that nothing happened to."""
    campaign = made(tmp_path, spread(count=60), "killed", 4)
    process = microvib("run", campaign.folder, "--workers", 2, start_new_session=True)
    wait_for(lambda: len(campaign.done()) >= 2)
    workers = children(process.pid)
    if what == "worker":
        os.kill(max(workers), signal.SIGKILL)
    elif what == "coordinator":
        process.kill()
    elif what == "group":
        os.killpg(process.pid, signal.SIGKILL)
    else:
        os.killpg(process.pid, signal.SIGINT)
    out, err = process.communicate(timeout=120)
    wait_for(lambda: not any(alive(pid) for pid in workers), 20.0)  # no worker goes on without its coordinator
    if what == "worker":
        assert process.returncode == 0, err
        assert "120 of 120 cases computed, 0 of them failed" in out
    else:
        assert campaign.missing()
    if what == "interrupt":
        assert process.returncode == 130
        assert "Interrupted; computed cases are kept" in err
        assert "Traceback" not in err
    kept = {k: campaign.file(k).stat().st_mtime_ns for k in campaign.done()}
    compute_missing(open_campaign(campaign.folder), Fragile())
    assert bytes_of(campaign) == calm
    assert all(campaign.file(k).stat().st_mtime_ns == when for k, when in kept.items())  # not computed twice


def test_slurm_shards_are_a_job_array_that_can_be_resumed(tmp_path, monkeypatch):
    """A stand-in for sbatch runs the first of two shards, as if the second had been cancelled; then there is one left."""
    tools = tmp_path / "bin"
    tools.mkdir()
    sbatch = '#!/bin/sh\nfor k in ${RUN_SHARDS}; do SLURM_ARRAY_TASK_ID=$k sh "$2" >> "$2.log" 2>&1 || exit 1; done\necho 17\n'
    for name, text in (("sbatch", sbatch), ("squeue", "#!/bin/sh\necho invalid job id >&2; exit 1\n")):
        (tools / name).write_text(text)
        (tools / name).chmod((tools / name).stat().st_mode | stat.S_IXUSR)
    monkeypatch.setenv("PATH", f"{tools}:{os.environ['PATH']}")
    monkeypatch.setenv("RUN_SHARDS", "0")
    undisturbed, campaign = made(tmp_path, spread(), "undisturbed", 4), made(tmp_path, spread(), "jobs", 4)
    compute_missing(undisturbed, Fragile())
    for left in (1, 0):
        done = commands.microvib(
            "campaign", "resume", str(campaign.folder), "--on", "slurm", "--workers", "2", cwd=tmp_path
        )
        assert done.exit_code == 0, done.stderr
        assert "Submitted job 17" in done.stdout
        assert len(campaign.missing()) == left
    assert bytes_of(campaign) == bytes_of(undisturbed)
    assert json.loads((campaign.folder / "slurm.json").read_text())["job"] == "17"


def slurm_answers() -> bool:
    try:
        return subprocess.run(["sinfo", "-h"], capture_output=True, timeout=10).returncode == 0
    except (OSError, subprocess.TimeoutExpired):
        return False


def test_a_slurm_job_cancelled_in_the_middle_is_resumed(tmp_path):
    if not slurm_answers():
        pytest.skip("no Slurm answers here")
    sized = spread(count=100, set=SHORT | {"record.duration": "20 s"})  # long enough to be cancelled
    calm, campaign = made(tmp_path, sized, "calm", 8), made(tmp_path, sized, "jobs", 8)
    compute_missing(calm, Fragile())

    def job() -> str:
        return json.loads((campaign.folder / "slurm.json").read_text())["job"]

    out, err = microvib("run", campaign.folder, "--on", "slurm", "--workers", 2).communicate(timeout=60)
    assert "Submitted job" in out, err
    wait_for(lambda: len(campaign.done()) >= 2)
    with pytest.raises(MicrovibError, match=r"its Slurm job \d+ has .*; wait for it, or scancel it"):
        submit(campaign, 2)
    subprocess.run(["scancel", job()], check=True)
    wait_for(lambda: not subprocess.run(["squeue", "-h", "-j", job()], capture_output=True).stdout.strip())
    assert campaign.missing()
    kept = {k: campaign.file(k).stat().st_mtime_ns for k in campaign.done()}
    out, err = microvib("resume", campaign.folder, "--on", "slurm", "--workers", 2).communicate(timeout=60)
    assert "Submitted job" in out, err
    wait_for(lambda: not campaign.missing())
    assert bytes_of(campaign) == bytes_of(calm)
    assert all(campaign.file(k).stat().st_mtime_ns == when for k, when in kept.items())


# -- statistics ------------------------------------------------------------------------------------------------------


def test_levels_are_never_pooled(tmp_path):
    """Five rates and eight draws: always above the limit at one rate, never at the others. A pooled figure would say 20 %."""
    rates = {"tracking.rate": [f"{x} deg/s" for x in (0.04, 0.05, 0.06, 0.07, 0.08)]}
    some = {"friction.breakaway": {"distribution": "uniform", "within": "1 percent"}}
    results = computed(tmp_path, study(vary=rates | some, sampling={"method": "random", "count": 8}))
    top = largest_line(results, EVERYTHING).reshape(5, 8)
    worst = int(top.min(axis=1).argmax())
    limit = 0.5 * (top[worst].min() + np.delete(top, worst, axis=0).max())
    assert top[worst].min() > limit > np.delete(top, worst, axis=0).max()  # between the worst rate and the others
    rows = [row for row in line_statistics(results, limit, EVERYTHING) if row.line == ANY]
    assert [row.above for row in rows] == [8 * (k == worst) for k in range(5)]
    assert [row.unknown for row in rows] == [8 * (k != worst) for k in range(5)]  # another limit than the study's
    assert {row.level.draws for row in rows} == {8}
    assert rows[worst].exceedance.low == pytest.approx(0.025 ** (1 / 8))  # of eight draws, not of forty
    assert (at_any_level(results, limit, EVERYTHING).above, at_any_level(results, limit, EVERYTHING).draws) == (8, 8)


def test_of_levels_alone_no_probability_is_told(tmp_path):
    results = computed(tmp_path, study(vary={"driver.microsteps": [4, 8, 16, 32]}))
    rows = [row for row in line_statistics(results, 1e-9, EVERYTHING) if row.line == ANY]
    assert [row.above for row in rows] == [1, 1, 1, 1]
    assert all(row.exceedance is None and np.isnan(row.median.value) for row in rows)
    assert at_any_level(results, 1e-9, EVERYTHING) is None
    summary = summarise(results, 1e-9, EVERYTHING)
    assert " % (" not in report_text(summary)


def test_a_percentile_needs_draws_that_bound_it():
    x = np.random.default_rng(1).random(400)
    for q, least in ((0.5, 6), (0.95, 72), (0.99, 368)):
        assert draws_needed(q) == least
        assert np.isnan(quantile(x[: least - 1], q).value)
        assert np.isfinite([quantile(x[:least], q).low, quantile(x[:least], q).high]).all()


def test_quantile_intervals_cover_as_often_as_they_say():
    rng = np.random.default_rng(5)
    covered = [(e := quantile(rng.exponential(size=400), 0.95)).low <= -np.log(0.05) <= e.high for _ in range(400)]
    assert 0.92 <= np.mean(covered) <= 0.99
    assert np.isnan(quantile(rng.random(50), 0.99).high)  # fifty cases do not bound it


def test_proportions():
    none = proportion(0, 100)
    assert (none.value, none.low) == (0.0, 0.0)
    assert none.high == pytest.approx(1.0 - 0.025 ** (1 / 100))  # the exact bound


def test_sobol_indices_of_a_function_with_known_ones():
    """Ishigami's function: S = 0.3139, 0.4424, 0; S_T = 0.5576, 0.4424, 0.2437."""
    n, d = 4096, 3
    keys = ("motor.current", "reducer.stiffness", "array.inertia")
    some = {key: {"distribution": "normal", "relative_deviation": "1 percent"} for key in keys}
    made = design(study(vary=some, sampling={"method": "sobol-indices", "count": n}))
    u = np.column_stack([x._frozen().cdf(made.samples[:, k]) for k, x in enumerate(made.uncertain)])
    x = np.pi * (2.0 * u - 1.0)
    f = np.sin(x[:, 0]) + 7.0 * np.sin(x[:, 1]) ** 2 + 0.1 * x[:, 2] ** 4 * np.sin(x[:, 0])
    first, total = _first_and_total(f.reshape(1, d + 2, n), n)
    np.testing.assert_allclose(first, [0.3139, 0.4424, 0.0], atol=0.02)
    np.testing.assert_allclose(total, [0.5576, 0.4424, 0.2437], atol=0.02)


def computed(tmp_path: Path, of: Study):
    campaign = made(tmp_path, of)
    compute_missing(campaign, Fragile())
    merge(campaign)
    return open_results(campaign)


@pytest.fixture(scope="module")
def sixteen(tmp_path_factory):
    """Results of eight draws at each of two levels."""
    return computed(tmp_path_factory.mktemp("sixteen"), spread(count=8))


def test_statistics_worst_cases_and_exceedance(sixteen):
    results = sixteen
    rows = {(row.level.number, row.line): row for row in line_statistics(results, 1e-9, EVERYTHING)}
    drive = results.of("drive_1")
    for level in (0, 1):
        row, own = rows[level, "drive_1"], drive.reshape(2, 8)[level]
        assert row.median.value == pytest.approx(np.median(own))
        assert row.worst == 8 * level + int(np.argmax(own))
        assert (row.count, row.above, row.exceedance.value) == (8, 8, 1.0)
        assert row.level.text == f"driver.microsteps {(8, 16)[level]}"
    assert governing(list(rows.values()))[0].worst == worst_cases(results, ANY, EVERYTHING)[0][0]
    assert worst_cases(results, "drive_1", EVERYTHING)[0] == (int(np.argmax(drive)), drive.max())
    band = line_statistics(results, None, (0.0, 5.0))
    assert all(row.line == ANY or row.frequency[1] <= 5.0 for row in band)
    data = results.dataset
    assert dict(data.sizes) == {"case": 16, "line": len(results.lines)}
    assert data["reducer.stiffness"].attrs["units"] == "N*m/rad"
    data.close()


def test_the_report_has_the_worst_cases_as_a_table(sixteen):
    results = sixteen
    summary = summarise(results, None, EVERYTHING)
    document = campaign_report(summary, {})
    section = next(x for x in document.sections if x.title == "Worst cases")
    worst, of_lines = [x for x in section.blocks if isinstance(x, Table)]
    cases = [case for case, _ in summary.worst[ANY]]
    assert [c.title for c in worst.columns] == ["what", "unit", *(f"case {k}" for k in cases), "scenario"]
    cells = {row.cells[0]: row.cells[1:] for row in worst.rows}
    assert float(cells["largest line"][1]) == pytest.approx(1e3 * summary.worst[ANY][0][1], rel=1e-3)
    stiffness = results.scalar("reducer.stiffness")
    assert cells["reducer.stiffness"][0] == "N m/rad"
    assert [float(x) for x in cells["reducer.stiffness"][1:-1]] == pytest.approx(stiffness[cases], rel=1e-3)
    assert cells["reducer.stiffness"][-1] == f"{results.campaign.design.base.reducer.stiffness:.4g}"
    assert {row.cells[0] for row in of_lines.rows} == set(summary.worst)
    assert str(results.campaign.folder.parent) not in html(document)


def test_a_partly_computed_campaign_can_be_looked_at(tmp_path):
    campaign = made(tmp_path, spread(), chunk=3)
    compute_missing(campaign, Fragile(), shard=(0, 2))
    merge(campaign)
    results = open_results(campaign)
    assert int(np.sum(results.state == MISSING)) == 6
    assert [row.count for row in line_statistics(results, None, EVERYTHING) if row.line == ANY] == [3, 3]
    assert {row.level.failed for row in line_statistics(results, None, EVERYTHING)} == {3}


def test_effects_one_at_a_time_are_those_of_the_cases(tmp_path):
    results = computed(tmp_path, spread(sampling={"method": "one-at-a-time"}, vary={
        "reducer.stiffness": {"distribution": "uniform", "within": "20 percent"},
        "array.inertia": {"distribution": "uniform", "within": "1 percent"},
    }))  # fmt: skip
    found = tornado(results, "drive_1", EVERYTHING)
    drive = results.of("drive_1")
    by_key = {e.key: (e.low, e.high) for e in found.effects}
    assert by_key == {"reducer.stiffness": (drive[1], drive[2]), "array.inertia": (drive[3], drive[4])}
    assert found.effects[0].key == "reducer.stiffness"
    assert line_statistics(results, None, EVERYTHING) == []


def test_effects_of_a_sample_and_sobol_indices_name_what_matters(tmp_path):
    keys = {
        "reducer.stiffness": {"distribution": "uniform", "within": "20 percent"},
        "array.inertia": {"distribution": "uniform", "within": "0.1 percent"},
    }
    settled = {"record.settle": "3 s", "record.duration": "2 s", "record.sample_rate": "1024 Hz"}
    results = computed(tmp_path, study(vary=keys, set=settled, sampling={"method": "sobol-indices", "count": 8}))
    found = tornado(results, "drive_2", EVERYTHING)
    assert found.effects[0].key == "reducer.stiffness"
    assert found.explained > 0.8
    indices = sobol(results, "drive_2", EVERYTHING)
    assert indices.total[0].value > 10 * abs(indices.total[1].value)
    assert sobol(results, "drive_2", EVERYTHING) == indices  # the bootstrap too
