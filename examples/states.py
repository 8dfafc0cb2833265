"""Test states 1 to 5 side by side, as the paper's Figures 11 and 12: what the array's frequency and inertia do to the lines.

python examples/states.py [states.png]
"""

import sys

from matplotlib.figure import Figure

import microvib as mv

GROUPS = {
    "Figure 11: states 1-3, frequency 1.19, 1.39, 1.59 Hz at 8.18 kg m²": (1, 2, 3),
    "Figure 12: states 1, 4, 5, inertia 8.18, 15.69, 22.99 kg m² at 1.19 Hz": (1, 4, 5),
}
LINES = ("array_mode_1", "drive_1", "drive_2", "drive_3", "full_step_1")


def run_states() -> dict[int, tuple[mv.Motion, dict[str, float]]]:
    """Motion and line amplitudes [N m] of each state."""
    result = {}
    for state in range(1, 6):
        motion = mv.simulate(f"state-{state}")
        table = mv.find_lines(motion)
        result[state] = motion, {name: table[name].amplitude for name in LINES}
    return result


def print_table(states: dict[int, tuple[mv.Motion, dict[str, float]]]) -> None:
    """Line amplitudes in mN m, one row for each state."""
    print("amplitude [mN m], 0-to-peak" + "".join(f"{name:>14s}" for name in LINES))
    for state, (_, amplitudes) in states.items():
        print(f"state {state:<21d}" + "".join(f"{1e3 * amplitudes[name]:14.4f}" for name in LINES))


def draw(states: dict[int, tuple[mv.Motion, dict[str, float]]], path: str) -> None:
    """Spectra of both groups, the low frequencies beside the whole range."""
    figure = Figure(figsize=(13.0, 7.6), layout="constrained")
    axes = figure.subplots(2, 2)
    for row, (title, members) in zip(axes, GROUPS.items(), strict=True):
        for state, colour, width in zip(
            members, ("C0", "C1", "C2"), (3.0, 1.8, 0.8), strict=True
        ):  # thinner on top, so that all show
            spectrum = mv.spectrum(states[state][0], window="hann")
            for ax, highest in zip(row, (5.0, 200.0), strict=True):
                shown = (spectrum.frequency > 0.2) & (spectrum.frequency <= highest)
                ax.semilogy(
                    spectrum.frequency[shown], 1e3 * spectrum.amplitude[shown],
                    color=colour, linewidth=width, label=f"state {state}",
                )  # fmt: skip
        for ax in row:
            ax.set(xlabel="frequency [Hz]", ylabel="amplitude, 0-to-peak [mN m]")
            ax.set_ylim(1e-3, 300)
            ax.legend(loc="upper right", fontsize=9)
        row[0].set_title(title, loc="left", fontsize=10)
    figure.savefig(path)
    print(f"Written: {path}")


if __name__ == "__main__":
    computed = run_states()
    print_table(computed)
    draw(computed, sys.argv[1] if len(sys.argv) > 1 else "states.png")
