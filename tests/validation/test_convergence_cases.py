"""The two parameter sets of the design note's convergence check, by the paper's protocol: 30 s to settle, 16 s FFT."""

from functools import cache

import pytest
from support.scenarios import baseline

import microvib as mv

# 53.013 / 53.3333, which the note rounds to 0.994. A nearest bin that is 0.4 bins away from its line reads 2 % more or
# less for 6e-6 of clock, so the digits matter.
PRINTED_CLOCK = 0.99399375
SETS = {
    "first": (
        {
            "array.rigid_inertia": 0.1289,
            "reducer.stiffness": 4882.0,
            "reducer.damping": 1.2385,
            "motor.friction.viscous": 0.01832,
            "array.modes.0.damping": 0.01,
        },
        {1.125: 0.004357, 53.0: 0.04019, 106.0: 0.00814, 159.0625: 0.00166, 3.3125: 0.00462},
    ),
    "second": (
        {
            "array.rigid_inertia": 0.0657010166,
            "reducer.stiffness": 8444.79,
            "reducer.damping": 0.205505,
            "motor.friction.viscous": 0.0372838,
            "array.modes.0.damping": 0.00939526,
        },
        {1.1875: 0.00382, 53.0: 0.0303, 106.0: 0.0187, 159.0625: 0.00348, 3.3125: 0.00510},
    ),
}


@cache
def bins(name, clock, refinement=1):
    """Amplitude by bin frequency: rectangular window, mean-free, 2 |X| / N; and the table of lines."""
    changes = {**SETS[name][0], "tracking.clock_ratio": clock, "solver.refinement": refinement}
    motion = mv.simulate(baseline().with_si(changes), channels=("T_d",))
    spectrum = mv.spectrum(motion)
    return dict(zip(spectrum.frequency, spectrum.amplitude, strict=True)), mv.find_lines(motion)


@pytest.mark.parametrize("name", SETS)
def test_all_lines_are_the_printed_ones_at_the_clock_that_was_rounded(name):
    amplitude, _ = bins(name, PRINTED_CLOCK)
    for frequency, printed in SETS[name][1].items():
        # worst measured 0.0054, the first set's third harmonic, printed with three digits
        assert amplitude[frequency] == pytest.approx(printed, rel=0.008), frequency


@pytest.mark.parametrize("name", SETS)
def test_default_settings_are_converged(name):
    default, _ = bins(name, 0.994)
    fine, _ = bins(name, 0.994, refinement=8)
    for frequency in SETS[name][1]:
        assert default[frequency] == pytest.approx(fine[frequency], rel=1e-3), (
            frequency
        )  # worst measured 3.5e-4


@pytest.mark.parametrize("name", SETS)
def test_drive_lines_fall_into_the_bins_of_the_test(name):
    _, table = bins(name, 0.994)
    assert [table[f"drive_{k}"].bin_frequency for k in (1, 2, 3)] == [53.0, 106.0, 159.0625]


@pytest.mark.parametrize("name", SETS)
def test_largest_bin_near_each_printed_line_is_the_printed_one(name):
    amplitude, _ = bins(name, 0.994)
    for frequency in SETS[name][1]:
        near = {f: a for f, a in amplitude.items() if abs(f - frequency) <= 0.25}
        assert max(near, key=near.get) == frequency
