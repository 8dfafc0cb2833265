"""Six components, long runs, profiles: what a motion carries."""

import math

import numpy as np
import pytest

import microvib as mv
from microvib.analysis import stream as long_runs
from microvib.analysis.lines import find_lines, steady_lines
from microvib.solve import kernel
from microvib.solve.channels import CHANNELS
from microvib.solve.integration import Simulation
from microvib.solve.pack import pack

SHORT = {"record.settle": 1.0, "record.duration": 4.0}


def test_six_component_loads(state_1):
    H = state_1.array.H[0]
    participation = (0.5, -0.2, 0.0, 0.1, 0.3, H)
    coupling = (0.4, 0.0, 0.0, 0.02, -0.01, 8.18)
    changes = {
        "array.modes.0.interface_participation": participation,
        "array.interface_inertia": coupling,
    }
    motion = mv.simulate(state_1.with_si({**SHORT, **changes}))
    loads = motion.interface_loads()
    array = motion.scenario.array
    # acceleration of the mode by differences, against what the loads are made of
    eta_acceleration = np.gradient(motion["eta_rate"][:, 0], 1 / 4096)
    expected = -(np.outer(eta_acceleration, participation) + np.outer(motion["alpha_l"], coupling))
    scale = np.abs(loads).max(axis=0)
    slow = np.convolve(loads[:, 0] - expected[:, 0], np.ones(64) / 64, mode="valid")
    assert np.abs(slow).max() < 2e-2 * scale[0]
    assert loads[:, 5] == pytest.approx(motion["T_d"])
    # about the drive axis T_d is the array's share and the rotor's
    array_share = -(
        array.J_h * motion["alpha_l"]
        + array.H[0]
        * (motion["eta_rate"][:, 0] * -array.D[0] - motion["eta"][:, 0] * array.Lambda[0])
    )
    assert array_share == pytest.approx(-motion["T_l"], abs=1e-12)
    assert set(motion.dataset.data_vars) >= {"Fx", "Fy", "Fz", "Mx", "My", "Mz"}


def test_no_six_components_without_participation(state_1):
    motion = mv.simulate(state_1.with_si(SHORT))
    assert motion.interface_loads() is None
    for door in (mv.find_lines, mv.spectrum, type(motion).__getitem__):
        with pytest.raises(
            mv.MicrovibError,
            match=r"'Fz' is not in this motion, whose array has no participation .* T_d",
        ):
            door(motion, "Fz")
        with pytest.raises(
            mv.MicrovibError,
            match=r"^channel 'Tz' is not in this motion; there are i_A, .*E_damping$",
        ):
            door(motion, "Tz")
    with pytest.raises(mv.MicrovibError, match="'eta' has a column for each mode"):
        mv.find_lines(motion, "eta")


def test_lines_of_a_force_at_the_interface(state_1):
    """A mode that pulls along y as it twists: Fy is its participation there over that about the axis, times the modal torque."""
    H = float(state_1.array.H[0])
    changes = {
        "array.modes.0.interface_participation": (0.0, 3.0, 0.0, 0.0, 0.0, H),
        "record.settle": 1.0,
        "record.duration": 8.0,
    }
    scenario = state_1.with_si(changes)
    motion = mv.simulate(scenario)
    twist = -(motion["T_l"] - scenario.array.inertia * motion["alpha_l"])
    assert motion["Fy"] == pytest.approx(twist * 3.0 / H, abs=1e-9 * abs(twist).max())
    assert (motion["Mz"] == motion["T_d"]).all()
    force, torque = mv.find_lines(motion, "Fy"), mv.find_lines(motion)
    assert (force.unit, torque.unit) == ("N", "N*m")
    assert " N " in str(force).splitlines()[0]
    k = int(np.argmin(abs(np.fft.rfftfreq(twist.size, 1 / 4096) - force["drive_1"].frequency)))
    assert force["drive_1"].bin_amplitude == pytest.approx(
        2 / twist.size * abs(np.fft.rfft(motion["Fy"]))[k], rel=1e-6
    )
    assert force["drive_1"].status == "ok"
    assert mv.find_lines(motion, "Mz")["drive_1"] == torque["drive_1"]
    assert mv.find_lines(motion, "Fx").notable() == ()
    kept = mv.simulate(state_1.with_si(SHORT), channels=("T_d",))
    with pytest.raises(
        mv.MicrovibError,
        match=r"of which alpha_l, eta, eta_rate, T_d were not kept; there are T_d$",
    ):
        mv.find_lines(kept, "Fy")


def test_lines_of_a_force_in_the_steady_state(state_1):
    H = float(state_1.array.H[0])
    state = steady_lines(
        state_1.with_si({"array.modes.0.interface_participation": (0.0, 3.0, 0.0, 0.0, 0.0, H)})
    ).state
    force, torque = mv.find_lines(state, "Fy"), mv.find_lines(state, "T_l")
    array = state.scenario.array
    twist = -(state["T_l"] - array.inertia * state["alpha_l"])
    assert state["Fy"] == pytest.approx(twist * 3.0 / H, abs=1e-9 * abs(twist).max())
    assert (force.unit, torque.unit) == ("N", "N*m")
    assert force["drive_1"].amplitude > 0.0
    with pytest.raises(mv.MicrovibError, match="'Tz' is not in this motion"):
        mv.find_lines(state, "Tz")


def test_drive_axis_chooses_the_component(state_1):
    changes = {
        "array.modes.0.interface_participation": (0, 0, 0, state_1.array.H[0], 0, 0),
        "array.drive_axis": "x",
    }
    motion = mv.simulate(state_1.with_si({**SHORT, **changes}))
    assert motion.interface_loads()[:, 3] == pytest.approx(motion["T_d"])


def test_a_record_that_starts_with_the_motion(state_1):
    motion = mv.simulate(state_1.with_si({"record.settle": 0.0, "record.duration": 1.0}))
    assert motion.time[0] == 0.0
    assert motion["T_d"].shape == (4096,)
    assert (
        abs(motion["T_d"][:30]).max() < 1e-3
    )  # the first microstep comes after 9.4 ms; the filter reaches 2 ms ahead


def test_start_track_stop_and_reverse(state_1):
    legs = [
        {"rate": "0.06 deg/s", "ramp": "0.5 s", "hold": "1 s"},
        {"rate": "0 deg/s", "hold": "1 s"},
        {"rate": "-0.06 deg/s"},
    ]
    motion = mv.simulate(
        state_1.with_si(
            {"record.settle": 0.0, "record.duration": 4.0, "tracking": {"profile": legs}}
        )
    )
    angle = motion["theta_l"]
    at = lambda t: angle[int(t * 4096)]  # noqa: E731
    rate = np.radians(0.06)
    assert at(1.5) == pytest.approx(
        rate * 1.25, abs=1.2e-4
    )  # friction winds the gear up by 7e-5 rad
    assert at(2.45) == pytest.approx(at(2.0), abs=2e-5)
    assert motion["stuck_output"][int(2.3 * 4096)] == pytest.approx(1.0)
    assert at(3.9) == pytest.approx(at(2.4) - rate * 1.4, abs=2e-4)
    kinds = {line.kind for line in mv.find_lines(motion)}
    assert kinds == {"array mode"}  # the rate changes in the record: the clock has no lines


def test_negative_rate_mirrors(state_1):
    forward = mv.simulate(state_1.with_si(SHORT))
    backward = mv.simulate(state_1.with_si({**SHORT, "tracking.rate": "-0.06 deg/s"}))
    assert backward["T_d"] == pytest.approx(-forward["T_d"], abs=1e-9)


def test_loss_of_synchronism_has_a_time(state_1):
    with pytest.raises(mv.SynchronismLost, match="loss of synchronism at t =") as caught:
        mv.simulate(state_1.with_({"tracking.rate": "300 deg/s"}))
    assert 0.0 < caught.value.time < 1.0


def test_progress_is_reported_and_interrupts_pass(state_1):
    seen = []

    def stop_half_way(done: float, total: float) -> None:
        seen.append(done / total)
        if done > 2.0:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        mv.simulate(state_1.with_si(SHORT), progress=stop_half_way)
    assert seen == sorted(seen)


def test_only_the_channels_that_are_asked_for(state_1):
    motion = mv.simulate(state_1.with_si(SHORT), channels=("T_d",))
    assert list(motion.channels) == ["T_d"]
    with pytest.raises(
        mv.ChannelError, match="channel 'T_x' does not exist; available channels: i_A"
    ):
        mv.simulate(state_1.with_si(SHORT), channels=("T_x",))


def test_lines_of_a_stream_are_those_of_the_motion(state_1, monkeypatch):
    scenario = state_1.with_si({"record.settle": 2.0, "record.duration": 24.0})
    whole = find_lines(mv.simulate(scenario))
    table, invariants, _ = long_runs.lines_of_stream(scenario, 8)
    assert table == whole
    monkeypatch.setattr(long_runs, "BLOCK_SAMPLES", 1 << 15)
    blocks, _, solver = long_runs.lines_of_stream(scenario, 8)
    assert solver["line_blocks"] == 3
    assert blocks["drive_1"].amplitude == pytest.approx(whole["drive_1"].amplitude, rel=1e-3)
    assert blocks["drive_1"].bin_amplitude == pytest.approx(
        whole["drive_1"].bin_amplitude, rel=1e-9
    )
    assert invariants.energy < 1e-4


def test_a_long_stream_keeps_no_history(state_1):
    run = Simulation(
        state_1.with_si({"record.settle": 0.0, "record.duration": 60.0}), channels=("T_d",)
    )
    sizes = [block["T_d"].size for block in run]
    assert max(sizes) < 5000
    assert sum(sizes) == 60 * 4096


def test_subharmonics_of_stick_and_slip_are_listed_though_not_expected(state_1):
    friction = {"friction.coulomb": 0.1, "friction.breakaway": 0.5, "friction.stribeck_rate": 1e-3}
    record = {"record.settle": 60.0, "record.duration": 24.0, "record.sample_rate": 1024.0}
    scenario = state_1.with_si(
        {**friction, **record, "reducer.damping": 0.5, "motor.detent_torque": 0.0}
    )
    table = mv.find_lines(mv.simulate(scenario))
    unexpected = {line.origin: line.amplitude for line in table if line.kind == "other"}
    # this drive repeats itself only every five microsteps
    assert unexpected["6/5 of the driving frequency"] == pytest.approx(0.0554, rel=0.02)
    assert unexpected["3/5 of the driving frequency"] == pytest.approx(0.0429, rel=0.02)


def test_a_mode_that_cannot_be_seen_is_not_found_on_a_line_of_the_clock(state_1):
    modes = [
        {"frequency": 1.19, "damping": 0.01, "effective_inertia": 8.0},
        *({"frequency": f, "damping": 0.01, "participation": 0.0} for f in (43.3, 63.35, 66.7)),
    ]
    scenario = state_1.with_si(
        {**SHORT, "record.duration": 16.0, "array.modes": modes, "array.rigid_inertia": None}
    )
    table = mv.find_lines(mv.simulate(scenario))
    for k in (2, 3, 4):
        assert table[f"array_mode_{k}"].status not in ("ok", "decaying", "growing")
    assert table["array_mode_1"].status == "decaying"


def test_no_microstep_is_lost_where_the_command_is_cut_into_pieces(state_1):
    from microvib.solve.command import Command

    # 20.1 microsteps per second: some fall on whole seconds to rounding
    rate = 20.1 * state_1.driver.microstep(state_1.motor) / 100
    command = Command(state_1.with_si({"tracking.rate": rate}))
    counts = (
        np.concatenate([command.microsteps(t, t + 1.0)[1][:, 2] for t in range(46)])
        * 64
        / (2 * np.pi)
    )
    assert np.diff(counts) == pytest.approx(-1.0)
    for t in range(46):
        assert np.all(command.microsteps(t, t + 1.0)[0] < t + 1.0)


def test_a_record_may_start_in_the_steady_state(state_1):
    steady = mv.simulate(state_1.with_({"record.start": "steady"}), channels=("T_d",))
    assert steady.solver["steady"] == "used"
    table = mv.find_lines(steady)
    assert table["array_mode_1"].amplitude < 1e-5  # 4.6e-3 from rest
    assert table["drive_1"].amplitude == pytest.approx(
        mv.find_lines(state_1, start="steady")["drive_1"].amplitude, rel=1e-4
    )


def test_where_no_steady_state_is_found_the_motion_begins_at_rest_and_says_why(state_1):
    ramp = {"tracking.rate": None, "tracking.profile": [{"rate": "0.06 deg/s", "ramp": "60 s"}]}
    short = {"record.settle": "0.2 s", "record.duration": "0.5 s"}
    both = [state_1.with_({**ramp, **short, "record.start": start}) for start in ("steady", "rest")]
    steady, rest = (mv.simulate(scenario, channels=("T_d",)) for scenario in both)
    assert steady.solver["steady"] == "not used: the rate changes in the record"
    assert np.array_equal(steady["T_d"], rest["T_d"])


def test_the_kernel_fills_its_row_in_the_order_in_which_channels_are_declared(state_1):
    assert [name.replace("P_", "E_") for name in kernel.CHANNELS] == list(CHANNELS)
    places = {
        "T_d": kernel.T_D,
        "T_d_force": kernel.T_D_FORCE,
        "E_kinetic": kernel.ENERGIES,
        "E_electrical": kernel.POWERS,
    }
    assert {name: list(CHANNELS).index(name) for name in places} == places
    packed = pack(state_1)
    state = {
        "i_A": 0.4,
        "i_B": -0.3,
        "theta_m": 0.123,
        "omega_m": -0.7,
        "theta_l": -0.001,
        "omega_l": 0.01,
    }
    packed.state.y[[kernel.IA, kernel.IB, kernel.TM, kernel.WM, kernel.TL, kernel.WL]] = list(
        state.values()
    )
    packed.state.clock[[kernel.REF_A, kernel.REF_B]] = 0.5, 0.2
    found = dict(zip(CHANNELS, packed.snapshot(), strict=False))
    expected = {**state, "i_ref_A": 0.5, "i_ref_B": 0.2, "stuck_rotor": 0.0, "stuck_output": 1.0}
    motor, driver, angle = state_1.motor, state_1.driver, 50 * 0.123
    torque = motor.torque_constant * (-0.3 * math.cos(angle) - 0.4 * math.sin(angle))
    expected["T_e"] = torque - motor.detent_torque * math.sin(4 * angle)
    expected["u_A"] = (
        driver.proportional_gain * 0.1 + driver.integral_gain * packed.state.y[kernel.XA]
    )
    expected["E_magnetic"] = 0.5 * motor.winding_inductance * (0.4**2 + 0.3**2)
    expected["E_joule"] = motor.winding_resistance * (0.4**2 + 0.3**2)  # as a power
    assert {name: found[name] for name in expected} == pytest.approx(expected)
    assert found["T_d"] == pytest.approx(found["T_d_force"])


def test_fourier_sums_of_a_block_are_those_of_its_samples():
    """Of a block in the midst of a long record, whose length is no whole number of rows; the direct sum has 1e-12 of rounding, too."""
    x = np.random.default_rng(1).standard_normal(10_007)
    samples, start, numbers = 86_400 * 4096 + 1, 200_000_123, [0, 1, 4_580_352, 86_400 * 2048]
    turns = [
        [(n * number % samples) / samples for n in range(start, start + x.size)]
        for number in numbers
    ]
    direct = np.exp(-2j * np.pi * np.array(turns)) @ x
    found = long_runs._bin_sums(x, start, numbers, samples)
    assert np.max(np.abs(found - direct)) < 1e-12 * x.size * np.max(np.abs(x))
    assert np.max(np.abs(found - direct)) < 1e-9 * np.max(np.abs(direct))
