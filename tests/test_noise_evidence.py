"""Evidence of a drive with torque noise: what its figures scatter over draws, levels between the lines, and the noise's density."""

import math
from dataclasses import replace

import numpy as np
import pytest

from microvib.analysis.lines import lines_of_samples
from microvib.model.linear import coupled_modes
from microvib.signals.line_table import NOISE_DRIVEN
from microvib.solve.batch import simulate_torques
from microvib.studies.evidence import (
    Evidence,
    Simulated,
    observations,
    predicted,
    with_noise_scatter,
)
from microvib.studies.identify import identify
from microvib.studies.identify.hints import model_deficiency_hints, noise_may_release_stiction
from microvib.studies.noise_floor import max_torque_noise_density

DENSITY, RATE, SENSOR = 4e-6, 4096.0, 1e-3


def noisy(state_1, density, seed):
    noise = {"density": density, "highest": 200.0, "seed": seed}
    return state_1.with_si(
        {"friction.torque_noise": noise, "record.settle": 4.0, "record.duration": 8.0}
    )


def torque(scenario):
    return simulate_torques([scenario])[0].T_d


@pytest.fixture(scope="module")
def recorded(state_1):
    """Samples of a recording, the catalog's drive with a quarter of its noise, and the lines that this makes of it."""
    x = torque(noisy(state_1, DENSITY, 7)) + np.random.default_rng(7).normal(0.0, SENSOR, 32768)
    start = noisy(state_1, DENSITY / 4.0, 1)
    return x, start, lines_of_samples(x, RATE, start, measured=True)


def test_levels_are_those_of_another_draw_of_the_same_density_and_not_of_another(recorded, state_1):
    """The sensor's white noise, larger than the drive's in the quiet bands, is taken off."""
    x, start, table = recorded
    levels = [o for o in with_noise_scatter((), x, RATE, table, start) if o.form == "level"]
    assert len(levels) >= 2

    def off(density):
        lines = Simulated(table, torque(noisy(state_1, density, 12)), RATE)
        return np.array([(predicted(lines, o) - o.value) / o.uncertainty for o in levels])

    assert np.sqrt(np.mean(off(DENSITY) ** 2)) < 2.5
    assert np.max(off(2.5 * DENSITY)) > 4.0
    assert np.min(off(DENSITY / 2.5)) < -3.0


def test_a_mode_that_noise_drives_has_the_scatter_of_one_draw(recorded):
    x, start, table = recorded
    drawn = replace(
        table["array_mode_1"], status=NOISE_DRIVEN, noise_deviation=2e-3, noise_p95=5e-3
    )
    rows = tuple(drawn if line.name == drawn.name else line for line in table)
    table = replace(table, lines=rows)
    told = {
        o.form: o
        for o in with_noise_scatter(observations(table), x, RATE, table, start)
        if o.line == drawn.name
    }
    assert "decay" not in told
    both = math.hypot(drawn.amplitude_uncertainty, 2e-3)
    assert told["amplitude"].uncertainty == pytest.approx(math.sqrt(2.0) * both)
    mode = coupled_modes(start)[0]
    sigma = math.tau * mode.frequency * mode.damping
    own = math.hypot(drawn.frequency_uncertainty, math.sqrt(sigma / 16.0) / math.tau)
    assert told["frequency"].uncertainty == pytest.approx(math.sqrt(2.0) * own)


def test_without_noise_in_the_scenario_nothing_changes(recorded):
    x, start, table = recorded
    found = observations(table)
    assert (
        with_noise_scatter(found, x, RATE, table, start.with_si({"friction.torque_noise": None}))
        == found
    )


@pytest.mark.long
def test_the_density_of_torque_noise_is_identified(recorded):
    x, start, table = recorded
    told = with_noise_scatter(observations(table), x, RATE, table, start)
    one = Evidence("made", told, table.clock_ratio, 8.0, RATE)
    fit = identify(start, [one], ["friction.torque_noise.density"], starts=8, finishes=1)
    (found,) = [e for e in fit.estimates if "density" in e.key]
    assert found.identifiable
    assert abs(found.estimate - DENSITY) < 2.0 * found.standard_error
    assert found.standard_error > 0.04 * DENSITY  # a record of 8 s cannot tell it better


@pytest.mark.parametrize(
    ("rate", "duration"), [(0.06, 6.0), (0.05, 3.0), (0.01, 3.0), (0.01, 6.0), (0.01, 15.0)]
)
def test_noise_is_seen_whatever_lines_have_no_frequency_of_their_own(state_1, rate, duration):
    """Not resolved lines hide no floor; where lines leave no bin between them, the next period or the quietest bins tell it."""
    changes = {
        "tracking.rate": math.radians(rate),
        "record.settle": 4.0,
        "record.duration": duration,
    }
    start = state_1.with_si(changes)
    sensor = np.random.default_rng(7).normal(0.0, 5e-6, start.record.samples)
    told = []
    for density in (0.0, 1e-6):
        x = (
            torque(start.with_si({"friction.torque_noise": {"density": density, "seed": 3}}))
            + sensor
        )
        table = lines_of_samples(x, RATE, start, measured=True)
        assert any(math.isnan(line.frequency) for line in table)
        told.append(max_torque_noise_density(x, RATE, table, start))
    assert told[0] < 1e-11 < 1e-8 < told[1]


def test_what_no_band_tells_is_no_absence(state_1):
    """Of two seconds at 32 Hz no band has enough bins."""
    start = state_1.with_si(
        {"record.settle": 4.0, "record.duration": 2.0, "record.sample_rate": 32.0}
    )
    table = lines_of_samples(np.zeros(64), 32.0, start, measured=True)
    assert math.isinf(max_torque_noise_density(np.zeros(64), 32.0, table, start))
    lost = replace(Evidence("made", (), None, 2.0, 32.0), noise=math.inf)
    assert noise_may_release_stiction(lost, start)
    (sentence,) = model_deficiency_hints(
        [(lost, start)], [Simulated(table, np.zeros(64), 32.0)], ()
    )
    assert "too short to tell whether there is torque noise" in sentence
