"""Lines of the third flux harmonic at three currents, beside those of the detent torque and of a driver table.

``python benchmarks/flux_harmonics.py`` prints full_step_1 and full_step_2 of state 1's steady state.
"""

from __future__ import annotations

from typing import Any

import microvib as mv

CURRENTS = ("0.3 A", "0.6 A", "1.2 A")
NO_DETENT = {"motor.detent_torque": "0 N*m"}
AMPLITUDE = 0.0556


def flux(*orders: int, amplitude: float = 0.025) -> dict[str, Any]:
    return {"motor.flux_harmonics": [{"order": k, "amplitude": amplitude} for k in orders]}


TABLE = {"harmonics": [{"order": 4, "amplitude": f"{AMPLITUDE} rad"}]}
CAUSES = {
    "detent torque of 10 mN m": {},
    "third flux harmonic": NO_DETENT | flux(3, amplitude=AMPLITUDE),
    "driver table of order 4": NO_DETENT | {"driver.table": TABLE},
}


def tell_lines() -> None:
    print("full_step_1, full_step_2 [mN m] at", ", ".join(CURRENTS))
    for name, changes in CAUSES.items():
        told = []
        for current in CURRENTS:
            scenario = mv.load_scenario("state-1").with_({**changes, "motor.current": current})
            state = mv.steady_state(scenario)
            per_line = scenario.driver.beats * scenario.driver.microsteps // 4
            f = scenario.driving_frequency / per_line
            lines = [abs(state.harmonics()[round(k * f / state.frequency)]) for k in (1, 2)]
            told.append(", ".join(f"{1e3 * line:.3g}" for line in lines))
        print(f"  {name:25s} {' | '.join(told)}")


if __name__ == "__main__":
    tell_lines()
