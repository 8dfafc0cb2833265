"""The record's filter: flat in its band, and nothing folds into it."""

import numpy as np
import pytest

from microvib.model.record import PASSBAND
from microvib.solve.sampling import MIN_FACTOR as FACTOR
from microvib.solve.sampling import Decimator, half_length

HALF = half_length(FACTOR)


def sampled(f: float, outputs: int = 256) -> np.ndarray:
    """Samples of a cosine of ``f`` cycles per output interval, from its exact interval means, in uneven blocks."""
    edges = (np.arange(FACTOR * (outputs + 64) + 1) - 0.5 - HALF) / FACTOR
    means = np.diff(np.sin(2 * np.pi * f * edges)) / (2 * np.pi * f) * FACTOR
    decimator = Decimator()
    blocks = [decimator.push(block[:, None]) for block in np.split(means, [100, 117, 600])]
    return np.concatenate(blocks)[:outputs, 0]


@pytest.mark.parametrize("f", [0.0003, 0.013, 0.1, 0.17, 0.25, 0.3, PASSBAND])
def test_a_tone_in_the_band_keeps_amplitude_and_phase(f):
    x = sampled(f)
    assert x == pytest.approx(np.cos(2 * np.pi * f * np.arange(x.size)), abs=2e-4)


@pytest.mark.parametrize(
    "f", [1 - PASSBAND, 0.8, 1.0, 1.2, 1 + PASSBAND, 2.1, FACTOR - 1 + PASSBAND]
)
def test_what_would_fold_into_the_band_is_80_db_down(f):
    assert np.max(np.abs(sampled(f))) < 1.2e-4


def test_a_ramp_passes_unchanged():
    rows = np.arange(2000.0)[:, None]
    out = Decimator().push(rows)[:, 0]
    assert out == pytest.approx(HALF + FACTOR * np.arange(out.size))


@pytest.mark.parametrize("f", [3.9, 4.1, FACTOR + PASSBAND, 7.7])
def test_about_multiples_of_the_inner_rate_the_boxcar_is_what_holds_it_back(f):
    assert np.max(np.abs(sampled(f))) < 1.1 * abs(np.sinc(f / FACTOR)) < 0.11


def test_low_sample_rates_do_not_alias_onto_lines():
    import microvib as mv

    scenario = mv.load_scenario("state-1").with_si({"record.settle": 4.0, "record.duration": 30.0})
    fine, coarse = (
        mv.find_lines(mv.simulate(scenario.with_si({"record.sample_rate": f})))
        for f in (4096.0, 50.0)
    )
    for name in ("full_step_1", "full_step_2"):
        assert coarse[name].amplitude == pytest.approx(fine[name].amplitude, rel=3e-3)
