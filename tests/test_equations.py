"""One short test for each equation that is computed; the ledger in docs/paper.md lists them all."""

import math
import re
from pathlib import Path

import numpy as np
import pytest
from support.scenarios import in_si

import microvib as mv
from microvib.model.friction import Friction, SlipRing
from microvib.model.linear import _coupled_modes
from microvib.solve import kernel
from microvib.solve.channels import CHANNELS
from microvib.solve.command import Command
from microvib.solve.pack import pack
from microvib.structures.springs import torsion_frequency

ROOT = Path(__file__).parents[1]


@pytest.fixture
def no_detent(state_1):
    return state_1.with_({"motor.detent_torque": "0 N*m"})


def test_eq_1_reference_currents(state_1):
    _, reference = Command(state_1).microsteps(0.0, 2.0)
    # a quarter of an electrical turn is one full step of a four-beat motor: 16 microsteps, backwards (Eq. 19)
    assert reference[15] == pytest.approx([0.0, -0.6, -math.pi / 2, 0.0], abs=1e-15)
    assert reference[63, :2] == pytest.approx([0.6, 0.0], abs=1e-14)
    assert np.hypot(*reference[:, :2].T) == pytest.approx(0.6)


def test_eq_1_microsteps_come_at_the_driving_frequency_of_eq_26(state_1):
    times, reference = Command(state_1).microsteps(0.0, 1.0)
    assert np.diff(times) == pytest.approx(1 / state_1.driving_frequency)
    assert times[0] == pytest.approx(0.5 / state_1.driving_frequency)
    # a positive rate of the array turns the rotor backwards (Eq. 19)
    assert reference[0, 2] == pytest.approx(-2 * math.pi / 64)


def of_motor(scenario, i_A, i_B, theta_m, omega_m=0.0):
    """Motor torque and the voltages that the turning rotor adds to both phases, as the kernel computes them.

    A derivative gain shows in the phase voltages how the currents change: u = K_P (i* - i) + K_I x - K_D di/dt (Eq. 2).
    """
    scenario = scenario.with_si({"driver.derivative_gain": 0.01})
    driver, motor = scenario.driver, scenario.motor
    packed = pack(scenario)
    packed.state.y[[kernel.IA, kernel.IB, kernel.TM, kernel.WM]] = i_A, i_B, theta_m, omega_m
    now = dict(zip(CHANNELS, packed.snapshot(), strict=False))
    integrals = packed.state.y[[kernel.XA, kernel.XB]]
    emf = []
    for phase, x in zip("AB", integrals, strict=True):
        i, u = now[f"i_{phase}"], now[f"u_{phase}"]
        demand = driver.proportional_gain * (now[f"i_ref_{phase}"] - i) + driver.integral_gain * x
        change = (demand - u) / driver.derivative_gain
        emf.append(motor.winding_inductance * change + motor.winding_resistance * i - u)
    return now["T_e"], *emf


def test_eq_3_back_emf_balances_the_power_of_eq_4(no_detent):
    i_A, i_B, omega_m = 0.4, -0.3, 0.7
    torque, e_A, e_B = of_motor(no_detent, i_A, i_B, 0.123, omega_m)
    assert e_A != pytest.approx(0.0, abs=0.01)
    assert -(e_A * i_A + e_B * i_B) == pytest.approx(torque * omega_m)


def test_eq_4_stiffness_about_equilibrium(no_detent):
    d = 1e-6
    stiffness = -(of_motor(no_detent, 0.6, 0.0, d)[0] - of_motor(no_detent, 0.6, 0.0, -d)[0]) / (
        2 * d
    )
    assert (
        stiffness == pytest.approx(no_detent.motor.electromagnetic_stiffness) == pytest.approx(9.0)
    )


def test_eq_4_detent_torque_has_its_amplitude_and_four_periods_a_tooth(state_1, no_detent):
    motor = state_1.motor
    for theta_m in (0.01, 0.11, 0.3):
        detent = (
            of_motor(state_1, 0.4, -0.3, theta_m)[0] - of_motor(no_detent, 0.4, -0.3, theta_m)[0]
        )
        assert detent == pytest.approx(
            -motor.detent_torque * math.sin(4 * motor.rotor_teeth * theta_m)
        )


def test_eq_5_and_7_friction(state_1):
    friction = state_1.friction
    fast = 100 * friction.stribeck_rate
    assert friction.torque(fast) == pytest.approx(0.0246 + 0.544_925 + 0.0255 * fast, abs=1e-6)
    assert friction.torque(-fast) == -friction.torque(fast)
    assert friction.torque(1e-12) == pytest.approx(friction.breakaway_torque, rel=1e-6)
    assert friction.torque(friction.stribeck_rate) == pytest.approx(
        0.0246 + 0.0216 / math.e + 0.544_925, abs=3e-6
    )


def test_eq_6_slip_ring():
    ring = in_si(
        SlipRing, contact_pairs=320, contact_force=0.042, friction_factor=1.53, ring_radius=0.0265
    )
    assert ring.torque == pytest.approx(0.54492, abs=1e-5)


def test_friction_without_slip_ring_is_eq_5():
    friction = in_si(Friction, coulomb=1.0, breakaway=1.0, stribeck_rate=1.0, viscous=2.0)
    assert friction.torque(3.0) == 7.0


def test_eq_14_lambda_and_damping(state_1):
    omega = 2 * math.pi * 1.19
    assert state_1.array.Lambda == pytest.approx([omega**2])
    assert pytest.approx([2 * 0.01 * omega]) == state_1.array.D


def test_eq_16_effective_inertia(state_1):
    array = state_1.array
    assert array.J_h + float(np.sum(array.H**2)) == pytest.approx(array.inertia)


def test_eq_17_effective_inertia_is_positive(state_1):
    from microvib.model.linear import matrices

    M, _, _ = matrices(state_1.with_({"reducer.stiffness": "rigid"}))
    # in theta_m; h² M is J_flex + J + h² J_m at the output
    assert 100**2 * M[0, 0] == pytest.approx(8.18 + 100**2 * 0.252e-4)


def test_eq_24_with_the_factor_that_gives_hertz():
    assert torsion_frequency(57.2, 1.0, 8.18) == pytest.approx(1.19, abs=5e-4)  # k l² [N m]
    assert torsion_frequency(635.0, 0.30, 8.18) == pytest.approx(1.19, abs=2e-3)


def test_eq_25_full_step(state_1):
    assert math.degrees(state_1.driver.full_step(state_1.motor)) == pytest.approx(1.8)


def test_eq_26_driving_frequency(state_1):
    assert state_1.driving_frequency == pytest.approx(53.3333, abs=1e-4)


def test_the_ledger_has_a_row_for_each_equation_and_each_row_a_module():
    rows = re.findall(
        r"^\| (\d+) \| (.+?) \| (.+?) \| (.+?) \|$",
        (ROOT / "docs/paper.md").read_text(),
        re.MULTILINE,
    )
    assert [int(number) for number, *_ in rows] == list(range(1, 27))
    for number, _, modules, verdict in rows:
        for module in re.findall(r"`(.+?)`", modules):
            path = ROOT / "src/microvib" / module
            assert path.is_file(), module
            if not verdict.startswith("not used"):
                assert int(number) in equations_named_in(path), (
                    f"Eq. {number} is not named in {module}"
                )


def equations_named_in(path: Path) -> set[int]:
    """Numbers after "Eq." in a file, ranges spelled out."""
    groups = re.findall(r"Eq\. ([\d, -]+)", " ".join(path.read_text().split()))
    ranges = re.findall(r"(\d+)(?:-(\d+))?", " ".join(groups))
    return {n for first, last in ranges for n in range(int(first), int(last or first) + 1)}


def test_many_coupled_modes_are_those_of_the_whole_eigenproblem(state_1, monkeypatch):
    modes = [
        {"frequency": f"{3 * k} Hz", "damping": 0.01, "effective_inertia": f"{4 / k**1.5} kg*m^2"}
        for k in range(1, 121)
    ]
    scenario = state_1.with_(
        {"array.modes": modes, "array.inertia": "15 kg*m^2", "array.rigid_inertia": None}
    )
    exact = mv.coupled_modes(scenario)
    monkeypatch.setattr("microvib.model.linear.MAX_DENSE_MODES", 40)
    _coupled_modes.cache_clear()
    near = mv.coupled_modes(scenario)
    _coupled_modes.cache_clear()
    assert [m.name for m in near] == [m.name for m in exact]
    assert near != exact
    for a, b in zip(near, exact, strict=True):
        assert a.frequency == pytest.approx(b.frequency, rel=1e-4), b
        assert a.damping == pytest.approx(b.damping, rel=0.02), b
