"""Windows, statistics and blur of pointing errors against time windows, closed forms and known processes."""

import math

import numpy as np
import pytest
from scipy.integrate import dblquad

from microvib.errors import MicrovibError
from microvib.signals import pointing as p

T, APART = 0.4, 0.9
FREQUENCIES = (1e-3, 0.05, 0.7, 1.19, 2.5, 3.7, 11.3)


def averaged(metric: str, f: float) -> float:
    """Mean square over all phases of one line of amplitude sqrt(2), from windows of time."""
    nodes, shares = np.polynomial.legendre.leggauss(60)
    t, shares = 0.5 * T * nodes, 0.5 * shares
    phase = 2.0 * np.pi * np.arange(32)[:, None] / 32
    x, later = (
        np.sqrt(2.0) * np.cos(2.0 * np.pi * f * (t + shift) + phase) for shift in (0.0, APART)
    )
    mean = (x * shares).sum(axis=1, keepdims=True)
    line = (x * t * shares).sum(axis=1, keepdims=True) / (t**2 * shares).sum() * t
    within = {
        "ape": x[:, :1],
        "mpe": mean,
        "smear": line,
        "rpe": x - mean,
        "jitter": x - mean - line,
        "stability": (later - x)[:, :1],
        "pde": (later * shares).sum(axis=1, keepdims=True) - mean,
    }[metric]
    weights = shares if within.shape[1] > 1 else np.ones(1)
    return float(np.mean((within**2 * weights).sum(axis=1)))


@pytest.mark.parametrize("metric", p.METRICS)
def test_weights_are_those_of_windows_averaged_over_phases(metric: p.Metric) -> None:
    for f in FREQUENCIES:
        assert p.metric_weight(metric, f, T, APART) == pytest.approx(
            averaged(metric, f), rel=1e-6, abs=1e-14
        )


def test_slow_lines_keep_their_digits() -> None:
    u = np.pi * 1e-4 * T
    assert float(p.metric_weight("rpe", 1e-4, T)) == pytest.approx(u**2 / 3.0, rel=1e-6)
    assert float(p.metric_weight("jitter", 1e-4, T)) == pytest.approx(u**4 / 45.0, rel=1e-6)
    assert (
        float(p.metric_weight("pde", 0.0, T)) == 0.0
    )  # where a drift of the mean must leave nothing


def test_a_rational_approximation_of_rpe_is_too_low() -> None:
    s = 2.0 * np.pi * 0.85 / T
    z = 1j * s * T
    rational = abs(z * (z + math.sqrt(12.0)) / (z**2 + 6.0 * z + 12.0))
    assert rational**2 / float(p.metric_weight("rpe", 0.85 / T, T)) == pytest.approx(
        1.0 - 0.084, abs=1e-3
    )


SIGMA, TAU = 3.0, 0.25


@pytest.mark.parametrize("apart", [5.0, 6000.0, 1e7])
@pytest.mark.parametrize("start", [0.0, 0.3])
def test_instants_an_orbit_apart(apart: float, start: float) -> None:
    """A density that is constant from ``start`` on, in closed form; of the pde at high frequencies twice the mpe."""
    f, S = np.linspace(start, 4000.0, 4001), np.ones(4001)
    change = np.diff(
        2.0
        * (
            np.array([start, 4000.0])
            - np.sin(2.0 * np.pi * np.array([start, 4000.0]) * apart) / (2.0 * np.pi * apart)
        )
    )
    assert p.mean_square_of_density("stability", f, S, 1e-3, apart) == pytest.approx(
        change[0], rel=1e-5
    )
    mean = p.mean_square_of_density("mpe", f, S, 1e-3)
    assert p.mean_square_of_density("pde", f, S, 1e-3, apart) == pytest.approx(2.0 * mean, rel=3e-4)


def gauss_markov(metric: str) -> float:
    """Mean square of a process with covariance SIGMA^2 exp(-|t|/TAU), in closed form but for one integral."""
    r = T / TAU
    mean = 2.0 * (r - 1.0 + math.exp(-r)) / r**2
    centred, _ = dblquad(
        lambda b, a: 2.0 * a * b * math.exp(-(a - b) / TAU),
        -0.5 * T,
        0.5 * T,
        -0.5 * T,
        lambda a: a,
    )
    smear = 12.0 * centred / T**4
    lagged = (
        math.exp(-APART / TAU) * (2.0 * math.cosh(r) - 2.0) / r**2
    )  # windows that do not overlap
    found = {
        "ape": 1.0,
        "mpe": mean,
        "rpe": 1.0 - mean,
        "smear": smear,
        "jitter": 1.0 - mean - smear,
        "stability": 2.0 * (1.0 - math.exp(-APART / TAU)),
        "pde": 2.0 * (mean - lagged),
    }
    return SIGMA**2 * found[metric]


@pytest.mark.parametrize("metric", p.METRICS)
def test_densities_against_a_gauss_markov_process(metric: p.Metric) -> None:
    f = np.concatenate([[0.0], np.geomspace(1e-4, 2e3, 40000)])
    S = 4.0 * SIGMA**2 * TAU / (1.0 + (2.0 * np.pi * f * TAU) ** 2)
    # Above the grid the weights have their mean values, the density falls with the square of the frequency.
    high = {"mpe": 0.0, "smear": 0.0, "pde": 0.0, "stability": 2.0}.get(metric, 1.0)
    tail = high * SIGMA**2 / (np.pi**2 * TAU * f[-1])
    assert p.mean_square_of_density(metric, f, S, T, APART) + tail == pytest.approx(
        gauss_markov(metric), rel=2e-6
    )


def test_cumulative_rms_adds_up_both_ways() -> None:
    f = np.linspace(0.0, 10.0, 101)
    S = 1.0 + f
    up, down = p.cumulative_rms(f, S), p.cumulative_rms(f, S, falling=True)
    assert up[-1] ** 2 == pytest.approx(10.0 + 50.0)
    assert up**2 + down**2 == pytest.approx(np.full(f.size, 60.0))


def test_levels_of_one_line_of_noise_and_of_their_sum() -> None:
    assert p.confidence_level_angle([2.0], 0.0) == pytest.approx(
        2.0 * math.sin(0.5 * math.pi * 0.997)
    )  # not 3 sigma = 2.12 A
    assert p.confidence_level_angle([], 1.0, 0.997) == pytest.approx(2.9677, rel=1e-4)
    rng = np.random.default_rng(4)
    draws = sum(
        a * np.cos(2.0 * np.pi * rng.random(4_000_000)) for a in (1.0, 0.4, 0.2)
    ) + 0.3 * rng.normal(size=4_000_000)
    assert p.confidence_level_angle([1.0, 0.4, 0.2], 0.3) == pytest.approx(
        np.quantile(np.abs(draws), 0.997), rel=2e-3
    )
    assert p.confidence_level_angle([1.0, 0.4, 0.2], 0.3) < p.worst_case_angle([1.0, 0.4, 0.2], 0.3)


def test_two_equal_lines_have_the_known_distribution() -> None:
    """|A cos a + A cos b| = 2 A |cos s cos d| with s, d uniform: its chance to be below x is an elliptic integral."""
    from scipy.integrate import quad

    x = p.confidence_level_angle([1.0, 1.0], 0.0, 0.9)
    below = quad(lambda s: 1.0 if x >= 2.0 * math.cos(s) else 2.0 / math.pi * math.asin(x / (2.0 * math.cos(s))), 0.0, math.pi / 2,
                 points=[math.acos(x / 2.0)])[0] / (math.pi / 2)  # fmt: skip
    assert below == pytest.approx(0.9, abs=1e-4)


def test_transfer_functions_are_those_of_the_motions_densities() -> None:
    nu, phases = 1.3, 2.0 * np.pi * (np.arange(4000) + 0.5) / 4000
    assert p.transfer_of_line(0.2, nu) == pytest.approx(
        np.mean(np.cos(2.0 * np.pi * nu * 0.2 * np.cos(phases)))
    )
    run = (np.arange(4000) + 0.5) / 4000 - 0.5
    assert p.transfer_of_smear(0.5, nu) == pytest.approx(
        np.mean(np.cos(2.0 * np.pi * nu * 0.5 * run)), abs=1e-6
    )
    draws = np.random.default_rng(1).normal(size=2_000_000)
    assert p.transfer_of_noise(0.1, nu) == pytest.approx(
        np.mean(np.cos(2.0 * np.pi * nu * 0.1 * draws)), abs=1e-3
    )


def test_a_slow_line_blurs_by_its_smear_a_fast_one_by_its_amplitude() -> None:
    nu = np.array([0.1, 0.3])
    fast = p.transfer_in_window(np.array([1000.5]), np.array([0.3]), 0.0, 1.0, nu)
    assert fast == pytest.approx(p.transfer_of_line(0.3, nu), abs=1e-6)
    f, A = 1e-3, 50.0
    slow = p.transfer_in_window(np.array([f]), np.array([A]), 0.0, 1.0, nu)
    assert slow == pytest.approx(
        p.transfer_of_smear(2.0 * np.pi * f * A / math.sqrt(2.0), nu), abs=1e-5
    )


@pytest.mark.parametrize(
    ("call", "says"),
    [
        (lambda: p.metric_weight("rpe", 1.0, 0.0), "window: 0 s"),
        (lambda: p.mean_square_of_density("rpe", np.array([1.0, 0.5]), np.ones(2), 1.0), "ascend"),
        (
            lambda: p.mean_square_of_density(
                "rpe", np.array([0.0, 1.0]), np.array([1.0, -1.0]), 1.0
            ),
            "negative",
        ),
        (lambda: p.mean_square_of_density("rpe", np.array([0.0, 1e9]), np.ones(2), 1.0), "pieces"),
        (lambda: p.confidence_level_angle([1.0], 0.0, 1.0), "confidence"),
    ],
)
def test_what_cannot_be_evaluated_is_said(call: object, says: str) -> None:
    with pytest.raises(MicrovibError, match=says):
        call()  # type: ignore[operator]


@pytest.mark.parametrize("metric", ["rpe", "smear", "jitter", "mpe", "pde"])
def test_levels_in_a_window_against_draws(metric: p.Metric) -> None:
    """Lines with random phases, instants anywhere in the window: means and straight lines taken off numerically."""
    f, A, T = np.array([0.4, 1.1, 2.7]), np.array([1.0, 0.7, 0.4]), 0.6
    rng = np.random.default_rng(8)
    phase = 2.0 * np.pi * rng.random((20_000, 3))
    tau = (np.arange(200) + 0.5) / 100.0 - 1.0
    x = sum(A[k] * np.cos(2.0 * np.pi * f[k] * 0.5 * T * tau + phase[:, [k]]) for k in range(3))
    mean = x.mean(axis=1, keepdims=True)
    line = (x @ tau)[:, None] / (tau @ tau) * tau
    after = sum(
        A[k] * np.sinc(f[k] * T) * np.cos(2.0 * np.pi * f[k] * T + phase[:, [k]]) for k in range(3)
    )
    found = {
        "rpe": x - mean,
        "smear": line,
        "jitter": x - mean - line,
        "mpe": mean,
        "pde": after - mean,
    }[metric]
    rows = np.abs(p.windowed_amplitudes(metric, f, A, T))
    shares = p.row_shares(metric, p.HALF_WINDOW)
    assert shares @ (0.5 * np.sum(rows**2, axis=1)) == pytest.approx(
        np.sum(p.mean_square_of_lines(metric, f, A, T)), rel=2e-3
    )
    for part in (0.9, 0.997):
        assert p.confidence_level_angle(rows, 0.0, part, shares=shares) == pytest.approx(
            np.quantile(np.abs(found), part), rel=0.01
        )
    most = p.worst_case_angle(
        p.windowed_amplitudes(metric, f, A, T, instants=p.UNIFORM_INSTANTS), 0.0
    )
    assert 0.8 * most < np.abs(found).max() <= 1.001 * most


@pytest.mark.parametrize("metric", ["rpe", "smear", "jitter"])
def test_what_lies_between_the_instants_of_a_window_is_covered(metric: p.Metric) -> None:
    """Slopes, curvatures and what lies between instants, against far finer instants."""
    f, T, ones = np.array([0.3, 2.0, 9.7, 31.0, 180.0, 2100.0]), 0.05, np.ones(6)
    fine = np.linspace(-1.0, 1.0, 200_001)
    u = np.pi * f * T
    turned = 1.0 if metric == "smear" else np.exp(-1j * np.outer(fine, u))
    shape = p.windowed_amplitudes(metric, f, ones, T, instants=fine) * turned
    slope = np.abs(np.gradient(shape, fine, axis=0))
    known = p.slope_in_window(metric, f, T, fine)
    inner = slice(2, -2)
    # pytest.approx compares a million numbers one by one, in ten seconds
    allowed = np.maximum(1e-3 * known[inner], 1e-4 * known.max())
    assert np.all(np.abs(slope[inner] - known[inner]) <= allowed)
    curved = np.abs(np.diff(shape, 2, axis=0)) / (fine[1] - fine[0]) ** 2
    assert np.all(curved.max(axis=0) <= p.curvature_in_window(metric, f, T) * 1.01 + 1e-4)
    for cells in (p.HALF_WINDOW, p.WHOLE_WINDOW):
        assert cells.shares.sum() == pytest.approx(1.0)
        middles = p.windowed_amplitudes(metric, f, ones, T, instants=cells.instants)
        if metric != "smear":
            middles = middles * np.exp(-1j * np.outer(cells.instants, u))
        cell = np.searchsorted(cells.instants + cells.reach, fine - 1e-12)
        inside = (cell < cells.instants.size) & (fine >= cells.instants[0] - cells.reach[0])
        away = np.abs(shape[inside] - middles[cell[inside]])
        assert np.all(away <= p.change_within_cells(metric, f, T, cells)[cell[inside]] + 1e-12)
    spacing = 0.01
    sizes = np.abs(shape)
    coarse = sizes[:: round(spacing / (fine[1] - fine[0]))]
    most = np.maximum(coarse[1:], coarse[:-1]).max(axis=0)
    assert np.all(
        sizes.max(axis=0) <= most + p.excess_between_instants(metric, f, T, spacing) + 1e-12
    )
