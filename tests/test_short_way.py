"""The blocked-load method to a craft: against pyyeti, against the whole system, against the coupled run; congruence; what is refused."""

import math
from dataclasses import replace

import numpy as np
import pytest
from support import craft as whole
from support.craft_scenarios import DAMPED, FLEXIBLE, scenario_of

import microvib as mv
from microvib.analysis.hub_lines import hub_lines
from microvib.analysis.short_way import blocked_load_solution, method_differences
from microvib.model.coupling import (
    Source,
    blocked_load_method,
    couple_source_to_hub,
    driving_line_map,
    line_of_sight_noise_density,
    receiver_of,
    rotation_about_axis,
    source_of,
)
from microvib.model.linear import coupled_modes, linear_lines, staircase_torque
from microvib.model.rigid import rigid_motion_at
from microvib.units import Si

FREQUENCY = np.array([0.07, 0.4, 0.46, 1.1, 1.23, 3.3, 8.9, 17.2, 53.3, 160.0])
CRAFTS = [
    whole.FullCraft(),
    whole.FullCraft(bandwidth=0.3),
    FLEXIBLE,
    replace(FLEXIBLE, bandwidth=0.0),
]


def whole_response(full: whole.FullCraft, torque: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Acceleration of the interface (m, 6) and hub coordinates (m, n_q) by torques on the rotor, from the whole matrices."""
    (K, C), found = full.powered(), []
    for f, on_rotor in zip(FREQUENCY, torque, strict=True):
        s = 2j * math.pi * f
        found.append(
            np.linalg.solve(s**2 * full.M + s * C + K, np.r_[np.zeros(full.n - 1), on_rotor])
        )
    q = np.array(found)[:, : full.n_q]
    return -((2.0 * math.pi * FREQUENCY[:, None]) ** 2) * (q @ full.root.T), q


@pytest.mark.parametrize("full", CRAFTS)
def test_the_short_way_is_the_whole_system(full: whole.FullCraft) -> None:
    scenario, torque = scenario_of(full), np.linspace(1.0, 2.0, FREQUENCY.size) * np.exp(0.7j)
    source = source_of(scenario)
    found = blocked_load_method(scenario, FREQUENCY, source.blocked(FREQUENCY, torque))
    a, q = whole_response(full, torque)
    assert np.all(np.abs(found.acceleration - a).max(axis=1) < 1e-8 * np.abs(a).max(axis=1))
    assert found.los is not None
    if not full.flexible:
        assert found.los == pytest.approx(q[:, 3:5], rel=1e-8)


@pytest.mark.parametrize("full", CRAFTS)
def test_against_norton_and_thevenin_in_pyyeti(full: whole.FullCraft) -> None:
    """pyyeti makes both apparent masses from mass, damping and stiffness matrices, and couples them."""
    frclim = pytest.importorskip("pyyeti.frclim")
    scenario = scenario_of(full)
    source, hub = source_of(scenario), receiver_of(scenario)
    blocked = source.blocked(FREQUENCY, np.full(FREQUENCY.size, 1.0 + 0.5j))
    n = source.M.shape[0]
    free = [np.block([[source.mass, source.G], [source.G.T, source.M]])]
    free += [np.pad(X, ((6, 0), (6, 0))) for X in (source.C, source.K)]
    at_interface = np.hstack([np.eye(6), np.zeros((6, n))])
    n_q = full.n_q
    on_hub = [full.hub_M[:n_q, :n_q], full.C[:n_q, :n_q], full.K[:n_q, :n_q], full.root]
    masses = [
        frclim.calcAM(side, FREQUENCY, fs=pytest.importorskip("pyyeti.ode").FreqDirect(*side[:3]))
        for side in ([*free, at_interface], on_hub)
    ]
    alone = np.array(
        [np.linalg.solve(masses[0][:, k], blocked[k]) for k in range(FREQUENCY.size)]
    ).T
    theirs = frclim.ntfl(*masses, alone, FREQUENCY)
    ours = couple_source_to_hub(FREQUENCY, blocked, source.apparent_mass(FREQUENCY), hub)
    for k in range(FREQUENCY.size):
        assert (
            np.abs(ours.acceleration[k] - theirs.A[:, k]).max()
            < 1e-8 * np.abs(theirs.A[:, k]).max()
        )
        assert np.abs(ours.loads[k] - theirs.F[:, k]).max() < 1e-8 * np.abs(theirs.F[:, k]).max()


def test_locked_hinges_have_the_mass_of_the_formula() -> None:
    scenario = scenario_of(whole.FullCraft())
    source, w = source_of(scenario, powered=False), 2.0 * np.pi * FREQUENCY
    assert scenario.craft is not None
    wanted = np.broadcast_to(source.residual, (w.size, 6, 6)).astype(complex)
    for f, z, p in zip(
        whole.FREQUENCIES, whole.DAMPING, scenario.craft.participation.T, strict=True
    ):
        w_k = 2.0 * np.pi * f
        factor = (w_k**2 + 2j * z * w_k * w) / (w_k**2 - w**2 + 2j * z * w_k * w)
        wanted = wanted + factor[:, None, None] * np.outer(p, p)
    assert source.apparent_mass(FREQUENCY) == pytest.approx(wanted, rel=1e-9, abs=1e-9)


def test_a_powered_drive_is_not_a_locked_hinge_below_its_resonances() -> None:
    """At rest both carry the whole mass; at the array mode about the drive axis the drive's springs matter."""
    scenario = scenario_of(whole.FullCraft())
    powered_mass, locked = (
        source_of(scenario, powered=p).apparent_mass(np.array([1e-4, 1.19])) for p in (True, False)
    )
    assert powered_mass[0] == pytest.approx(locked[0], abs=1e-5 * np.abs(locked[0]).max())
    assert abs(powered_mass[1, 4, 4] / locked[1, 4, 4] - 1.0) > 0.2


@pytest.mark.parametrize("full", [whole.FullCraft(damping=np.zeros(4)), *DAMPED.values()])
def test_the_linear_lines_of_the_coupled_drive(full: whole.FullCraft) -> None:
    """T_d of ``linear_lines`` on a craft, by its decoupled modes, and the torque about the drive axis by the blocked-load method."""
    scenario = scenario_of(full)
    lines = linear_lines(scenario)
    f = np.array([line.frequency for line in lines])
    torque = staircase_torque(scenario, np.arange(1, 9))
    found = blocked_load_method(scenario, f, source_of(scenario).blocked(f, torque))
    assert found.loads[:, 3:] @ full.axis == pytest.approx(
        np.array([line.amplitude for line in lines]), rel=1e-7
    )


@pytest.mark.parametrize("full", DAMPED.values())
def test_modes_with_the_powered_drive_are_those_of_the_whole_system(full: whole.FullCraft) -> None:
    (K, C), M, n = full.powered(), full.M, full.n
    state = np.block([[np.zeros((n, n)), np.eye(n)], [-np.linalg.solve(M, np.hstack([K, C]))]])
    values = np.linalg.eigvals(state)
    values = values[values.imag > 1e-3 * np.abs(values)]
    modes = coupled_modes(scenario_of(full))
    assert np.sort([mode.frequency for mode in modes]) == pytest.approx(
        np.sort(values.imag) / math.tau, rel=1e-6
    )
    assert np.sort([mode.damping for mode in modes]) == pytest.approx(
        np.sort(-values.real / np.abs(values)), rel=1e-5
    )


def test_congruence_turns_and_moves() -> None:
    full, angle = whole.FullCraft(), math.radians(40.0)
    here, there = (scenario_of(replace(full, angle=full.angle + x)) for x in (0.0, angle))
    turn = rotation_about_axis(whole.AXIS, angle)
    turned, direct = source_of(here).turned(turn), source_of(there)
    for mine, wanted in zip((turned.mass, turned.G), (direct.mass, direct.G), strict=True):
        assert mine == pytest.approx(wanted, abs=1e-9)
    # Seen from the hub's centre, the source's mass and its blocked loads move as a body and its forces do.
    moved, T = direct.about(whole.PLACE), rigid_motion_at(whole.PLACE)
    assert moved.apparent_mass(FREQUENCY) == pytest.approx(
        T.T @ direct.apparent_mass(FREQUENCY) @ T, rel=1e-9, abs=1e-9
    )
    forces = direct.blocked(FREQUENCY, np.ones(FREQUENCY.size))
    moments = forces[:, 3:] + np.cross(whole.PLACE, forces[:, :3])
    assert moved.blocked(FREQUENCY, np.ones(FREQUENCY.size)) == pytest.approx(
        np.hstack([forces[:, :3], moments]), abs=1e-9
    )


def test_a_chart_is_its_points_one_by_one() -> None:
    full = whole.FullCraft(bandwidth=0.1)
    scenario, rates, angles = (
        scenario_of(full),
        np.radians([0.02, 0.06, 0.11]),
        np.radians([0.0, 75.0]),
    )
    found = driving_line_map(scenario, rates, angles, 3)
    assert found.los is not None
    for i, angle in enumerate(angles):
        for j, rate in enumerate(rates):
            one = scenario.with_si(
                {"tracking.rate": float(rate), "spacecraft.array_angle": float(angle)}
            )
            f = found.frequency[j]
            assert f == pytest.approx([line.frequency for line in linear_lines(one, 3)])
            single = blocked_load_method(
                one, f, source_of(one).blocked(f, staircase_torque(one, np.arange(1, 4)))
            )
            assert found.los[i, j] == pytest.approx(single.los, rel=1e-9)
            assert found.loads[i, j] == pytest.approx(single.loads, rel=1e-9, abs=1e-12)


def test_lines_below_what_a_free_hub_can_say_are_left_out() -> None:
    scenario = scenario_of(whole.FullCraft())
    found = blocked_load_method(scenario, np.array([0.04, 0.06]), np.ones((2, 6)))
    assert found.los is not None
    assert np.all(np.isnan(found.los[0]))
    assert np.all(np.isfinite(found.los[1]))


def test_the_short_way_of_a_run_against_the_coupled_run() -> None:
    """Detent torque and current loop are in both runs; what they do to each other through the hub's motion is not."""
    scenario = scenario_of(
        whole.FullCraft(damping=np.full(4, 0.05)), **{"record.settle": 20.0, "record.duration": 6.0}
    )
    lines, short = blocked_load_solution(scenario)
    result = mv.run_scenario(scenario)
    assert result.motion is not None
    rows = method_differences(lines, short, hub_lines(result.motion, result.table))
    assert {row.line for row in rows} >= {"drive_1", "drive_2", "full_step_1"}
    assert all(row.los_error < 0.02 for row in rows if row.share > 1e-4)
    locked = couple_source_to_hub(lines.frequency, lines.loads, source_of(scenario, powered=False).apparent_mass(lines.frequency),
                     receiver_of(scenario))  # fmt: skip
    worse = method_differences(lines, locked, hub_lines(result.motion, result.table))
    assert max(row.los_error for row in worse[:3]) > 2.0 * max(row.los_error for row in rows[:3])


@pytest.mark.parametrize("stiffness", [8400.0, None])
def test_torque_noise_through_the_linearised_drive(stiffness: float | None) -> None:
    """On the output, positive and negative on both sides of it: the whole matrices."""
    full = whole.FullCraft(bandwidth=0.3)
    changes = {
        "friction.torque_noise": {"density": Si(2e-6), "lowest": Si(0.05), "highest": Si(200.0)}
    }
    scenario = scenario_of(full, **changes, **({} if stiffness else {"reducer.stiffness": "rigid"}))
    found = line_of_sight_noise_density(scenario, FREQUENCY)
    K, C = (full if stiffness else replace(full, stiffness=1e9)).powered()
    for k, f in enumerate(FREQUENCY):
        s, on = 2j * math.pi * f, np.zeros(full.n)
        on[-2] = 1.0
        angle = np.linalg.solve(s**2 * full.M + s * C + K, on)[3:5]
        assert found[k] == pytest.approx(2e-6 * np.abs(angle) ** 2, rel=1e-7 if stiffness else 1e-3)


def test_more_mass_in_modes_than_there_is_is_refused() -> None:
    source = source_of(scenario_of(whole.FullCraft()), powered=False)
    with pytest.raises(
        mv.MicrovibError, match="D_0: the residual mass of the source has the eigenvalue"
    ):
        Source(0.2 * source.mass, source.G, source.M, source.C, source.K)


def test_firm_ground_is_refused() -> None:
    with pytest.raises(mv.MicrovibError, match="spacecraft: missing"):
        source_of(mv.load_scenario("state-1"))
