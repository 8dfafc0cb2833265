"""State 1 with round values of what the paper does not give: a drive for tests whose figures are not to move with an identification."""

import microvib as mv

ROUND = {
    "motor.friction.viscous": 0.0255,
    "reducer.stiffness": 8400.0,
    "reducer.damping": 5.0,
    "array.rigid_inertia": 0.13,
    "array.modes.0.frequency": 1.19,
    "array.modes.0.damping": 0.01,
    "tracking.clock_ratio": 1.0,
}


def baseline() -> mv.Scenario:
    return mv.load_scenario("state-1").with_si(ROUND)
