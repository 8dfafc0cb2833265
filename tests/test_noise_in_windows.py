"""Torque noise in a run's own windows: against the variance of its record in such windows, kept apart, and counted once."""

import math

import numpy as np
import pytest
from support import craft as whole
from support.craft_scenarios import scenario_of

import microvib as mv
from microvib.analysis.hub_lines import hub_lines
from microvib.analysis.pointing import NOISE_LABEL, HubLines
from microvib.signals.pointing import mean_square_of_density, metric_weight
from microvib.units import Si

NOISY = {"density": Si(2e-4), "lowest": Si(0.5), "highest": Si(40.0)}


def test_windows_of_a_run_have_lines_and_noise_once_each() -> None:
    full = whole.FullCraft(bandwidth=0.1, damping=np.full(4, 0.05))
    changes = {
        "friction.torque_noise": NOISY,
        "record.settle": Si(20.0),
        "record.duration": Si(80.0),
    }
    scenario = scenario_of(full, **changes, **{"record.sample_rate": Si(512.0)})
    motion = mv.simulate(scenario)
    hub = hub_lines(motion, mv.find_lines(motion))
    x = np.column_stack([motion["los_x"], motion["los_y"]])
    window = 0.125
    parts = x[: 64 * (len(x) // 64)].reshape(-1, 64, 2)
    lines, noise = hub.sums("rpe", window)
    found = parts.var(axis=1).mean(axis=0)
    assert lines + noise == pytest.approx(found, rel=0.2)
    assert np.all(lines < 0.5 * found)  # of which lines alone would be too little
    twice = hub.mean_squares("rpe", window).sum(axis=0) + noise
    assert hub.driven
    assert np.all(twice > lines + noise)
    row = next(
        r for r in hub.totals() if r["window_s"] == hub.windows[0] and r["metric"] == "jitter"
    )
    assert row["radial_rad"] ** 2 == pytest.approx(
        row["lines"]["radial_rad"] ** 2 + row["noise"]["radial_rad"] ** 2
    )
    ranked = dict(hub.ranking("rpe", window))
    assert ranked[NOISE_LABEL] == pytest.approx(math.sqrt(noise.sum()))
    assert not set(hub.driven) & {name for name, cost in ranked.items() if cost > 0.0}
    said = hub.summary()
    assert said["cumulative"]["rms_up_los_x_rad"][-1] == pytest.approx(
        math.sqrt(hub.sums("ape", 1.0).sum(axis=0)[0]), rel=1e-3
    )
    assert max(said["within"]["los_x_rad"], said["within"]["los_y_rad"]) > 2.5 * math.sqrt(
        hub.noise("ape", 1.0).max()
    )


def test_roughness_counts_in_windows_as_the_torque_noise_that_the_output_turns_past() -> None:
    scenario = scenario_of(
        whole.FullCraft(bandwidth=0.1),
        **{"friction.coulomb": Si(0.5), "friction.breakaway": Si(0.5)},
    )
    assert scenario.rate
    turns = abs(scenario.rate) / math.tau
    field = {"density": Si(2e-8 * turns / scenario.friction.torque(scenario.rate) ** 2)}
    field |= {"lowest": Si(0.5 / turns), "highest": Si(40.0 / turns)}
    rough = scenario.with_si({"friction.position": {"roughness": field}})
    noisy = scenario.with_si({"friction.torque_noise": {**NOISY, "density": Si(2e-8)}})
    both = noisy.with_si({"friction.position": {"roughness": field}})
    none = np.empty((0, 2))
    sums = [
        HubLines(one, (), np.empty(0), np.empty((0, 6)), none, none).noise("rpe", 0.125)
        for one in (rough, noisy, both)
    ]
    assert sums[1].min() > 0.0
    assert sums[0] == pytest.approx(sums[1], rel=1e-3)
    assert sums[2] == pytest.approx(2.0 * sums[1], rel=1e-3)


def test_without_noise_nothing_is_said_of_it() -> None:
    scenario = scenario_of(
        whole.FullCraft(bandwidth=0.1), **{"record.settle": Si(1.0), "record.duration": Si(2.0)}
    )
    motion = mv.simulate(scenario)
    hub = hub_lines(motion, mv.find_lines(motion))
    assert hub.density is None
    assert set(next(hub.totals())) == {"window_s", "metric", "los_x_rad", "los_y_rad", "radial_rad"}
    assert NOISE_LABEL not in dict(hub.ranking("rpe", 0.1))


@pytest.mark.parametrize("metric", ["ape", "mpe", "rpe", "smear", "jitter", "stability", "pde"])
def test_a_density_over_many_periods_of_a_window(metric: str) -> None:
    """Beyond ten thousand periods a weight counts by its mean; against the weight itself, sampled densely."""
    f = np.linspace(1.0, 40.0, 40)
    S = 1.0 / f
    window = 1000.0
    at = np.linspace(1.0, 40.0, 4_000_001)
    there = np.interp(at, f, S) * metric_weight(metric, at, window)
    wanted = float(np.trapezoid(there, at))
    assert mean_square_of_density(metric, f, S, window) == pytest.approx(wanted, rel=1e-4)
