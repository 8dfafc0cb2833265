"""Gear trains: ratios and orders against published gearboxes and counted teeth, and the lines they make in a run."""

import math
from fractions import Fraction

import numpy as np
import pytest
from support.scenarios import NO_FRICTION, baseline, in_si

import microvib as mv
from microvib.errors import ScenarioError
from microvib.io.scenario_file import dump_scenario, load_scenario
from microvib.model.expected import expected_lines
from microvib.model.gear_train import GearStage, speeds, train_orders
from microvib.model.linear import coupled_modes, dynamic_stiffness, momentum_row
from microvib.model.orders import drive_orders
from microvib.model.reducer import Reducer
from microvib.reports.parameters import order_lines
from microvib.solve.steady.period import common_period
from microvib.solve.steady.state import steady_state
from microvib.studies.rates import _resonance_crossings


def stage(**keys):
    return in_si(GearStage, **keys)


def frequencies(rotor, *stages):
    """Frequencies [Hz] by stage and name, with the rotor at ``rotor`` [Hz]."""
    return {(x.stage, x.name): rotor * float(x.cycles) for x in train_orders(tuple(stages))}


def test_a_wind_turbine_gearbox_of_three_stages_has_its_published_figures():
    """The 750 kW test gearbox of NREL's Gearbox Reliability Collaborative (NREL/TP-5000-51885): 81.491 from carrier to generator.

    Teeth and ratio are quoted from memory of the report; they go together, since the ratio follows from the teeth to five digits.
    """
    fast = stage(pinion=22, wheel=88)
    slow = stage(pinion=23, wheel=82)
    planets = stage(sun=21, planet=39, ring=99, planets=3)
    found = frequencies(30.0, fast, slow, planets)
    assert abs(1 / speeds((fast, slow, planets))[-1]) == pytest.approx(81.491, rel=1e-5)
    assert found[1, "mesh"] == pytest.approx(660.0)
    assert found[2, "mesh"] == pytest.approx(172.5)
    assert found[3, "mesh"] == pytest.approx(36.45, rel=1e-3)
    assert found[3, "carrier"] == pytest.approx(22.09 / 60, rel=1e-3)
    assert found[3, "planet"] == pytest.approx(36.45 / 39, rel=1e-3)


def test_the_gearbox_of_a_diagnosis_challenge_has_its_published_orders():
    """Spur gears 32-96 and 48-80 (PHM Society data challenge, 2009): idler 1/3, output 1/5, meshes 32 and 16 per input turn.

    Teeth and "5 to 1" as on https://phmsociety.org/data-analysis-competition/apparatus/.
    """
    found = frequencies(1.0, stage(pinion=32, wheel=96), stage(pinion=48, wheel=80))
    assert found[1, "wheel"] == pytest.approx(1 / 3)
    assert found[2, "wheel"] == pytest.approx(1 / 5)
    assert (found[1, "mesh"], found[2, "mesh"]) == pytest.approx((32.0, 16.0))
    assert found[1, "hunting"] == pytest.approx(1 / 3)  # of every tooth with three others


def test_a_helicopter_planetary_has_its_published_frequencies():
    """Ring of 228, sun of 62, five planets of 83 teeth, carrier at 258 rpm: mesh near 980 Hz, planets pass at 21.5 Hz.

    Quoted from memory of the literature on a helicopter's main gearbox; the teeth fit (228 = 62 + 2 x 83), no source was looked up.
    """
    planets = stage(sun=62, planet=83, ring=228, planets=5)
    found = frequencies(4.3 / float(planets.lead), planets)
    assert found[1, "mesh"] == pytest.approx(980.4)
    assert found[1, "ring_pass"] == pytest.approx(21.5)
    assert found[1, "mesh - ring_pass"] == pytest.approx(980.4 - 21.5)
    assert found[1, "mesh + ring_tooth"] == pytest.approx(980.4 + 4.3)
    assert found[1, "2 planet"] == pytest.approx(2 * 980.4 / 83)
    assert found[1, "5 mesh"] == pytest.approx(5 * 980.4)


def test_planets_pass_one_another_where_their_tips_do():
    """Sun of 62, five of 83 in a ring of 228 (a helicopter's) just pass; four stand unequally in another's, 27 in 99."""
    distance = 145 * math.sin(math.pi / 5)  # of two planets' axes, in modules
    assert 85 < distance < 85.3
    assert stage(sun=62, ring=228, planets=5).planets == 5
    with pytest.raises(ScenarioError, match="6 of 83 teeth overlap"):
        stage(sun=62, ring=228, planets=6, equally_spaced=False)
    assert stage(sun=27, planet=35, ring=99, planets=4, equally_spaced=False).orders[
        "mesh"
    ].cycles == Fraction(27 * 99, 126)


@pytest.mark.parametrize(
    ("fixed", "driven", "lead"),
    [
        ("ring", "sun", Fraction(20, 20 + 70)),  # 1 / (1 + R/S), the same way
        ("ring", "carrier", Fraction(90, 20)),
        ("carrier", "sun", Fraction(-20, 70)),  # a star: -S/R
        ("carrier", "ring", Fraction(-70, 20)),
        ("sun", "ring", Fraction(70, 90)),  # 1 / (1 + S/R), the same way
        ("sun", "carrier", Fraction(90, 70)),
    ],
)
def test_each_arrangement_turns_as_counted_teeth_do(fixed, driven, lead):
    """Against wheels that roll: turned with the locked train first, then on the carrier until the fixed member is back."""
    planets = stage(sun=20, ring=70, fixed=fixed, input=driven)
    assert planets.lead == lead
    # columns: carrier, sun, planet, ring; rows: all as one block; carrier held, sun one turn
    together, rolled = np.ones(4), np.array([0.0, 1.0, -20 / 25, -20 / 70])
    names = ["carrier", "sun", "planet", "ring"]
    M = np.array([[x[names.index(m)] for x in (together, rolled)] for m in (fixed, driven)])
    a, b = np.linalg.solve(M, [0.0, 1.0])
    turned = dict(zip(names, a * together + b * rolled, strict=True))
    for name in names:
        assert float(planets.speeds[name]) == pytest.approx(turned[name], abs=1e-12)
    orders = {name: float(order.cycles) for name, order in planets.orders.items()}
    assert orders["mesh"] == pytest.approx(20 * abs(turned["sun"] - turned["carrier"]))
    assert orders["mesh"] == pytest.approx(70 * abs(turned["ring"] - turned["carrier"]))
    assert orders["mesh"] == pytest.approx(25 * abs(turned["planet"] - turned["carrier"]))
    assert orders["planet"] == pytest.approx(abs(turned["planet"] - turned["carrier"]))
    assert orders["ring_pass"] == pytest.approx(3 * abs(turned["ring"] - turned["carrier"]))


@pytest.mark.parametrize(("pinion", "wheel"), [(23, 67), (20, 60), (18, 24)])
def test_the_same_two_teeth_meet_as_often_as_counting_says(pinion, wheel):
    meets = next(
        n for n in range(1, pinion * wheel + 1) if n % pinion == 0 and n % wheel == 0
    )  # teeth gone by
    assert stage(pinion=pinion, wheel=wheel).orders["hunting"].cycles == Fraction(pinion, meets)


def test_two_rings_and_a_stepped_planet_make_a_large_ratio():
    """Rings of 74 and 80 teeth about a planet of 69 and 75: 1 - 74 x 75 / (69 x 80) = -1/184, counted tooth by tooth."""
    two = stage(ring=74, planet=69, planet_2=75, ring_2=80, planets=1)
    assert (two.driven, two.output) == ("carrier", "ring_2")
    assert two.lead == Fraction(-1, 184)
    # one turn of the carrier: the planet rolls off 74 teeth of 69 backwards on its carrier, the second ring 75/80 of that
    on_carrier = -Fraction(74, 69)
    assert two.speeds["planet"] == 1 + on_carrier
    assert two.lead == 1 + on_carrier * Fraction(75, 80)
    assert two.order("mesh") == 74
    assert two.order("mesh_2") == 80 * abs(two.lead - 1) == 75 * two.order("planet")
    assert two.order("hunting_ring") == Fraction(74, 74 * 69)
    names = {x.name for x in train_orders((two,))}
    assert {"mesh", "mesh_2", "2 mesh_2", "mesh_2 + ring_2_tooth", "mesh - planet"} <= names
    turned = stage(ring=74, planet=69, planet_2=75, ring_2=80, planets=1, fixed="ring_2")
    assert turned.lead == 1 - Fraction(69, 74) * Fraction(80, 75)


def test_a_stepped_planet_between_sun_and_ring_and_between_two_suns():
    """Sun S, planet P and Q, ring R: 1 + P R / (S Q) turns of the sun for one of the carrier; with P = Q the plain stage."""
    stepped = stage(sun=20, planet=40, planet_2=20, ring=80, planets=4)
    assert 1 / stepped.lead == 1 + Fraction(40 * 80, 20 * 20)
    plain, alike = stage(sun=18, ring=72, planet=27), stage(sun=18, ring=72, planet=27, planet_2=27)
    for name in (
        "sun",
        "carrier",
        "planet",
        "mesh",
        "sun_tooth",
        "ring_tooth",
        "sun_pass",
        "ring_pass",
        "hunting_ring",
    ):
        assert plain.order(name) == alike.order(name)
    assert plain.order("mesh") == alike.order("mesh_2")
    suns = stage(sun=74, planet=69, planet_2=75, sun_2=80, planets=1, fixed="sun")
    assert (suns.driven, suns.output) == ("carrier", "sun_2")
    assert suns.lead == 1 - Fraction(74 * 75, 69 * 80)


@pytest.mark.parametrize(
    ("keys", "sentence"),
    [
        ({"ring": 74, "planet": 69, "planet_2": 75, "ring_2": 80}, "planets: 3 of 69 teeth overlap"),
        ({"ring": 74, "planet": 69, "planet_2": 80, "ring_2": 80, "planets": 1}, "ring_2: 80 teeth leave no room"),
        ({"sun": 20, "planet": 40, "planet_2": 21, "ring": 80, "planets": 3}, "3 alike cannot be assembled at equal angles"),
        ({"sun": 74, "planet": 69, "planet_2": 75, "sun_2": 80, "planets": 1}, "fixed: this stage has no ring; its members are"),
        ({"ring": 80, "planet": 40, "planet_2": 20, "ring_2": 40, "planets": 1}, "turn at the same speed about the carrier"),
        ({"ring": 74, "planet": 69, "ring_2": 80}, "of stepped planets planet and planet_2 with sun and ring, ring and ring_2"),
    ],
)  # fmt: skip
def test_stepped_planets_that_cannot_be_are_a_sentence(keys, sentence):
    with pytest.raises(ScenarioError, match=sentence):
        baseline().with_({"reducer.train": [keys], "reducer.ratio": None})


def test_a_train_with_a_stepped_planet_has_its_lines():
    two = {"ring": 74, "planet": 69, "planet_2": 75, "ring_2": 80, "planets": 1}
    two["errors"] = [{"order": "mesh_2", "amplitude": "5 arcsec"}]
    scenario = baseline().with_({"reducer.train": [two], "reducer.ratio": None})
    assert scenario.reducer.ratio == pytest.approx(184.0)
    rotor = 184.0 * scenario.tracking.rate / (2.0 * math.pi)
    expected = 80 * (1 + 1 / 184) * rotor
    found = [line.frequency for line in expected_lines(scenario, "2000 Hz")]
    assert min(abs(f / expected - 1.0) for f in found) < 1e-9


def test_inertia_and_stiffness_are_reflected_by_energy():
    first = stage(pinion=20, wheel=60, input_inertia=2e-7, output_inertia=5e-6, stiffness=400.0)
    second = stage(
        sun=20, ring=70, planets=3, input_inertia=1e-6, planet_inertia=3e-7, stiffness=5000.0
    )
    reducer = reducer_of(first, second, wave_generator_inertia=1e-7)
    omega = -1 / 3  # second stage's sun, for one of the rotor
    carrier = omega * 20 / 90
    planet = carrier - (omega - carrier) * 20 / 25
    energy = 1e-7 + 2e-7 + 5e-6 * omega**2 + 1e-6 * omega**2 + 3 * 3e-7 * planet**2
    assert reducer.input_inertia == pytest.approx(energy)
    assert reducer.ratio == pytest.approx(3 * 4.5)
    assert reducer.h == pytest.approx(13.5)  # one mesh turns about: as a harmonic reducer does
    twist = 1.0 / 5000.0 + 1.0 / (400.0 * 4.5**2)  # at the output, of 1 N m there
    assert reducer.stiffness == pytest.approx(1.0 / twist)
    assert reducer_of(second, damping=0.1).h == pytest.approx(-4.5)


def reducer_of(*stages, **keys):
    given = {"wave_generator_inertia": 0.0, "damping": 1.0, **keys}
    return in_si(Reducer, train=stages, **given)


THREE = {"motor.phases": 3, "driver.beats": 6}
SPUR = [{"pinion": 20, "wheel": 53}, {"sun": 18, "ring": 72, "planets": 3}]
"""53/20 x 90/18 = 13.25, and the output turns against the rotor."""
GEARED = {
    "reducer": {
        "train": [
            {**SPUR[0], "errors": [{"order": "mesh", "amplitude": 4e-5}, {"order": "3 wheel", "amplitude": 3e-4, "phase": 0.7}]},
            {**SPUR[1], "errors": [{"order": "mesh + carrier", "amplitude": 2e-5}]},
        ],
        "wave_generator_inertia": 5e-6,
        "stiffness": 9000.0,
        "damping": 5.0,
    },
    "tracking.rate": math.radians(10.0), "driver.microsteps": 4, "motor.detent_torque": 0.0,
    "array.modes": [], "array.rigid_inertia": None, "array.inertia": 0.02,
    **NO_FRICTION, "sources": {},
}  # fmt: skip


def geared(**changes):
    given = {key: value for key, value in GEARED.items() if key != "reducer"}
    return baseline().with_si({**given, "reducer": in_si(Reducer, **GEARED["reducer"]), **changes})


def by_linear_drive(scenario, frequency, amplitude):
    """Line of an error at the output [rad]: spring and damper of the gear push with it on both shafts."""
    dynamic, omega = dynamic_stiffness(scenario, frequency), 2 * math.pi * frequency
    gear = np.r_[-1.0 / scenario.reducer.h, -1.0, np.zeros(len(dynamic) - 2)]
    pushed = np.linalg.solve(dynamic, -gear * (9000.0 + 5.0j * omega) * amplitude)
    return abs(omega**2 * (momentum_row(scenario, omega / (2.0 * math.pi)) @ pushed))


@pytest.mark.parametrize("turn", [1.0, -1.0], ids=["forward", "backward"])
@pytest.mark.parametrize("way", ["against", "with"])
def test_lines_of_a_train_stand_where_its_teeth_put_them_with_the_size_of_its_errors(way, turn):
    """The sizes by the linear drive, on whose output spring and damper of the gear push with the error."""
    scenario = geared(
        **{
            "record.duration": 20.0,
            "record.settle": 5.0,
            "tracking.rate": turn * math.radians(10.0),
        },
        **({"reducer.train.0.internal": True} if way == "with" else {}),
    )
    assert scenario.reducer.h == pytest.approx(13.25 if way == "against" else -13.25)
    rotor = 13.25 * 10.0 / 360
    sun = rotor * 20 / 53
    carrier = sun * 18 / 90
    wanted = {
        "stage_1_mesh": (20 * rotor, 4e-5 / 5),
        "stage_1_3_wheel": (3 * rotor * 20 / 53, 3e-4 / 5),
        "stage_2_mesh_plus_carrier": (18 * (sun - carrier) + carrier, 2e-5),
    }
    listed = {x.name: x for x in expected_lines(scenario, "100 Hz")}
    motion = mv.simulate(scenario)
    table = {x.name: x for x in mv.find_lines(motion)}
    assert motion["theta_m"][-1] * turn * (-1.0 if way == "against" else 1.0) > 10.0
    assert motion["theta_l"][-1] * turn > 1.0
    assert motion.invariants.torque_forms < 1e-9
    assert motion.invariants.energy < 1e-5
    for name, (frequency, amplitude) in wanted.items():
        assert listed[name].frequency == pytest.approx(frequency, rel=1e-9)
        assert table[name].frequency == pytest.approx(frequency, rel=1e-3)
        assert table[name].kind == "gear train"
        expected = by_linear_drive(scenario, frequency, amplitude)
        assert table[name].amplitude == pytest.approx(expected, rel=0.01), name


def test_the_steady_state_takes_the_true_period_however_long():
    """53 and 20 teeth: many turns of the rotor; of the mesh alone, a twentieth of one."""
    scenario = geared()
    turn, orders = 4 * 4 * 50, [x.order for x in scenario.reducer.errors]
    n = next(
        n
        for n in range(4, 100 * turn, 4)
        if all((n * order / turn).denominator == 1 for order in orders)
    )
    assert n > 13 * turn
    assert common_period(scenario) == (n, 4)
    assert steady_state(scenario).microsteps == n
    mesh = [{"order": "mesh", "amplitude": 4e-5}]
    scenario = scenario.with_si({"reducer.train.0.errors": mesh, "reducer.train.1.errors": []})
    assert common_period(scenario) == (40, 4)
    (line,) = (x for x in steady_lines(scenario) if x.name == "stage_1_mesh")
    assert line.amplitude == pytest.approx(
        by_linear_drive(scenario, line.frequency, 4e-5 / 5), rel=0.01
    )


def steady_lines(scenario):
    return mv.find_lines(scenario.with_si({"motor.detent_torque": 0.01}), start="steady")


def test_a_train_is_written_and_read_without_what_follows_from_it(tmp_path):
    scenario = geared()
    text = dump_scenario(scenario)
    assert " ratio:" not in text
    path = tmp_path / "geared.yaml"
    path.write_text(text)
    again = load_scenario(path)
    assert again.reducer == scenario.reducer
    wider = again.with_({"reducer.train.0.wheel": 54})
    assert wider.reducer.ratio == pytest.approx(54 / 20 * 5)
    assert again.with_({"reducer.ratio": 13.25}).reducer == scenario.reducer
    stages = {
        "reducer.train": [{"pinion": 20, "wheel": 60, "stiffness": 50.0}],
        "reducer.ratio": None,
        "reducer.stiffness": None,
    }
    assert baseline().with_si({**stages, "sources": {}}).reducer.stiffness == 50.0
    with pytest.raises(ScenarioError, match=r"reducer\.ratio: missing"):
        baseline().with_({"reducer.ratio": None})


@pytest.mark.parametrize(
    ("changes", "sentence"),
    [
        (
            {"reducer.ratio": 13.0},
            r"reducer\.ratio: 13 is not what follows from the other keys, 13\.25; leave it out",
        ),
        (
            {"reducer.train.0.wheel": None},
            r"reducer\.train\.0: has the teeth of pinion; pinion and wheel are expected, or sun",
        ),
        (
            {"reducer.train.1.ring": 71},
            r"train\.1\.planet: ring less sun is 53, odd, so that planets have shifted profiles",
        ),
        (
            {"reducer.train.1.ring": 19},
            r"train\.1\.ring: 19 teeth leave no room for planets about a sun of 18",
        ),
        (
            {"reducer.train.1.planet": 40},
            r"train\.1\.planet: 40 teeth do not fit between a sun of 18 and a ring of 72",
        ),
        (
            {"reducer.train.1.planets": 4},
            r"train\.1\.planets: 4 cannot be assembled at equal angles between a sun of 18 and a ring of 72, since 90 teeth are"
            r" no multiple of 4; if they are spaced unequally, set equally_spaced: false",
        ),
        (
            {"reducer.train.1.planets": 5},
            r"train\.1\.planets: 5 of 27 teeth overlap about a sun of 18; at most 4 have room",
        ),
        (
            {"reducer.train.1.input": "ring"},
            r"train\.1\.input: the ring is the fixed member; another one is expected",
        ),
        (
            {"reducer.train.0.planet_inertia": 1e-7},
            r"train\.0\.planet_inertia: a spur stage has no planets",
        ),
        (
            {"reducer.train.0.errors.0.order": "2 sun"},
            r"errors\.0\.order: '2 sun' is not an order of this stage; the orders are pinion, wheel",
        ),
        (
            {"reducer.train.0.errors.0.order": "mesh - 20 pinion"},
            r"errors\.0\.order: 'mesh - 20 pinion' is no order",
        ),
        (
            {"reducer.train.1.output_inertia": 1e-5},
            r"train\.1\.output_inertia: is on the output; give it as reducer\.output_inertia",
        ),
        (
            {"reducer.train.0.stiffness": 50.0},
            r"reducer\.stiffness: 9000 is not what follows from the other keys, 1250; leave it out",
        ),
        (
            {"reducer.train.0.stiffness": 50.0, "reducer.stiffness": "rigid"},
            r"reducer\.stiffness: rigid is not what follows from the other keys, 1250; leave it out",
        ),
        ({"reducer.train": []}, r"reducer\.ratio: missing \(reduction ratio\)"),
        (
            {"reducer.train": [{"pinion": 50, "wheel": 40}]},
            r"reducer\.train: its ratio is 0\.8; 1 to 100 000 is expected",
        ),
    ],
)
def test_what_no_train_can_be_is_a_sentence(changes, sentence):
    with pytest.raises(ScenarioError, match=sentence):
        geared().with_si(changes)


@pytest.mark.parametrize("stiffness", ["rigid", 9000.0])
@pytest.mark.parametrize("memory", [False, True])
def test_an_output_that_turns_with_the_rotor_is_the_mirrored_drive(stiffness, memory):
    """Turn the rotor and phase B about: array and frictions feel the same, and the rotor's momentum counts the other way."""
    changes = {
        "reducer.stiffness": stiffness,
        "motor.friction.coulomb": 0.002, "motor.friction.breakaway": 0.003,
        "record.settle": 0.2, "record.duration": 1.0, "solver.accuracy": 2.5e-5,
    }  # fmt: skip
    if memory:
        changes["friction.presliding"] = {"stiffness": 2e4, "elements": 4}
    motions = []
    for internal in (False, True):
        reducer = {
            "train": [{"pinion": 10, "wheel": 1000, "internal": internal}],
            "wave_generator_inertia": 5e-6, "damping": 5.0, "stiffness": 9000.0,
        }  # fmt: skip
        motions.append(
            mv.simulate(
                baseline().with_si({"reducer": in_si(Reducer, **reducer), "sources": {}, **changes})
            )
        )
    one, other = motions
    assert one.solver["sticks"] > 3
    for channel, sign in {
        "theta_l": 1,
        "theta_m": -1,
        "i_A": 1,
        "i_B": -1,
        "T_l": 1,
        "T_f": 1,
        "T_f_m": -1,
        "T_e": -1,
    }.items():
        size = np.max(np.abs(one[channel]))
        np.testing.assert_allclose(
            other[channel], sign * one[channel], atol=1e-6 * size, err_msg=channel
        )
    own = one.scenario.rotor_inertia * one["alpha_m"]
    np.testing.assert_allclose(
        other["T_d"], one["T_d"] + 2.0 * own, atol=1e-6 * np.max(np.abs(one["T_d"]))
    )
    assert other.invariants.torque_forms < 1e-9
    assert other.invariants.energy < 1e-5


@pytest.mark.parametrize("stiffness", ["rigid", "9000 N*m/rad"])
def test_a_ratio_that_turns_the_same_way_is_such_a_train(stiffness):
    short = {"record.settle": "0.2 s", "record.duration": "0.5 s", "reducer.stiffness": stiffness}
    by_ratio = mv.load_scenario("state-1", short).with_({"reducer.same_way": True})
    teeth = {"train": [{"pinion": 10, "wheel": 1000, "internal": True}]}
    by_teeth = by_ratio.with_si({"reducer": in_si(Reducer, **teeth, wave_generator_inertia=by_ratio["reducer.wave_generator_inertia"],
                                                  damping=by_ratio["reducer.damping"], stiffness=by_ratio["reducer.stiffness"])})  # fmt: skip
    one, other = mv.simulate(by_ratio), mv.simulate(by_teeth)
    assert np.array_equal(one["T_d"], other["T_d"])
    assert np.sign(one["omega_m"].mean()) == np.sign(one["omega_l"].mean())
    with pytest.raises(
        ScenarioError,
        match=r"same_way: the teeth of a train say which way its output turns; leave it out",
    ):
        by_teeth.with_({"reducer.same_way": True})


def test_show_prints_the_orders_and_marks_those_near_a_mode():
    mode = {"frequency": 2.0, "damping": 0.005, "effective_inertia": 0.5}
    text = order_lines(geared(**{"array.modes": [mode], "array.inertia": 0.6}))
    rows = {line.split("  ")[0]: line for line in text}
    assert "Hz at 10 deg/s" in text[0]
    assert rows["stage 1, mesh"].split()[3:5] == ["265", "7.361111"]
    assert rows["stage 2, mesh"].split()[3:5] == ["72", "2"]
    assert rows["stage 2, mesh"].endswith("<- near array_mode_1")
    assert rows["stage 2, mesh + sun_tooth"].endswith(
        "sideband of the mesh, sun_tooth"
    )  # 5.6 % off
    still = order_lines(baseline().with_si({"tracking.rate": 0.0}))
    assert "near" not in "".join(still)
    turn = [
        x
        for x in drive_orders(baseline().with_si(THREE))
        if x.name in ("full_step_1", "detent", "electrical_1")
    ]
    assert [x.per_turn for x in turn] == [6 * 5000, 6 * 5000, 5000]
    changing = {
        "tracking.rate": None,
        "tracking.profile": [{"rate": 0.001, "hold": 35.0}, {"rate": 0.002, "ramp": 20.0}],
    }
    assert "rate changes" in order_lines(geared(**changing))[0]


def test_rates_at_which_a_mesh_meets_a_mode_are_looked_at():
    mode = {"frequency": 2.0, "damping": 0.02, "effective_inertia": 0.02}
    scenario = geared(**{"array.modes": [mode], "array.inertia": 0.04})
    (seen,) = (x for x in coupled_modes(scenario) if x.fixed_frequency)
    crossings = _resonance_crossings(scenario, 4, (math.radians(1.0), math.radians(20.0)))
    met = (x.resonance for x in crossings)
    found = {x.line: x.rate for x in met if x.mode == seen.name}
    assert found["stage_1_mesh"] == pytest.approx(seen.frequency / 265 * 2 * math.pi)
