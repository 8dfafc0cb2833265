"""How many modes of the array are enough: lines of the drive of state 1 with the array of Table 1, with more and more of its modes.

python examples/modes_kept.py [1 3 10 60]
"""

from __future__ import annotations

import sys

import microvib as mv

LINES = ("full_step_1", "drive_1", "drive_2", "drive_3")


def lines_with(count: int) -> tuple[float, float, dict[str, float]]:
    """Residual inertia [kg m^2], highest frequency kept [Hz] and amplitudes [N m] with ``count`` modes of ``reference-array``."""
    scenario = mv.load_scenario("state-1", {"array.fem": "reference-array", "array.modes": count})
    table = mv.find_lines(mv.simulate(scenario))
    amplitudes = {name: table[name].amplitude for name in LINES}
    return scenario.array.J_h, scenario.array.modes[-1].frequency, amplitudes


def main(counts: list[int]) -> None:
    print(f"{'modes':>5s} {'up to Hz':>9s} {'J_h kg m²':>10s}" + "".join(f"{name + ' mN m':>18s}" for name in LINES))
    for count in counts:
        J_h, highest, amplitudes = lines_with(count)
        print(
            f"{count:5d} {highest:9.2f} {J_h:10.4f}"
            + "".join(f"{1e3 * amplitude:18.3f}" for amplitude in amplitudes.values())
        )


if __name__ == "__main__":
    main([int(text) for text in sys.argv[1:]] or [1, 3, 10, 60])
