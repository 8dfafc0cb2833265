"""Whether a run can be trusted: its invariants, each against a bar, with a verdict in words."""

from __future__ import annotations

from microvib.analysis.accuracy import read_error_estimate
from microvib.reports.document import Mark, Section, Table, Text, table
from microvib.solve.motion import BALANCE_TOLERANCE, JOULE_HEAT_TOLERANCE, Motion

_MEANINGS = {
    "torque_forms": "largest difference of momentum form and force form of T_d, over the largest T_d",
    "momentum": "mean torque that the change of angular momentum does not account for, over the largest T_d",
    "energy": "|energy in - stored - dissipated| over the electrical energy supplied",
    "energy_mechanical": (
        "the same over the energy beyond Joule heat, which is the stricter figure; allowed are"
        f" {BALANCE_TOLERANCE:g} of it and"
        f" {JOULE_HEAT_TOLERANCE:g} of the electrical energy"
    ),
}


def drives(motion: Motion) -> dict[str, Motion]:
    """Motions of the drives that step, by how a report calls what is theirs."""
    if motion.beside is None:
        return {"": motion.alone}
    return {"": motion.alone, ", second wing": motion.beside}


def failed_invariants(motion: Motion) -> list[str]:
    """Names of the invariants that do not hold, of any drive."""
    return list(
        dict.fromkeys(name for one in drives(motion).values() for name in one.invariants.broken)
    )


def invariants_sentence(motion: Motion) -> str:
    """Whether all invariants of one drive hold, with the two that say most."""
    values, fails = vars(motion.invariants), failed_invariants(motion)
    figures = f"momentum within {values['momentum']:.1e}, energy beyond Joule heat within {values['energy_mechanical']:.1e}"
    if fails:
        return f"NOT all hold ({', '.join(fails)}); {figures}"
    return f"all hold; {figures}"


def invariants_section(motion: Motion) -> Section:
    """Every invariant of each drive with its bar and verdict, and what they do not say."""
    return Section(
        "Can it be trusted?", tuple(x for one in drives(motion).items() for x in _of_drive(*one))
    )


def _of_drive(whose: str, motion: Motion) -> tuple[Text | Table, ...]:
    values, bars, fails = vars(motion.invariants), motion.invariants.bars, failed_invariants(motion)
    if fails:
        verdict = f"NOT to be used{whose}: {', '.join(fails)} above the bar."
    else:
        verdict = f"All invariants hold{whose}."
    holds = {name: "does NOT hold" if name in fails else "holds" for name in bars}
    rows = [
        (name.replace("_", " "), f"{values[name]:.2g}", f"{bar:.3g}", _MEANINGS[name], holds[name])
        for name, bar in bars.items()
    ]
    marks: dict[int, Mark] = {k: "fail" if name in fails else "pass" for k, name in enumerate(bars)}
    energy = (
        f"Since the start {values['energy_in']:.4g} J of electrical energy were supplied,"
        f" {values['energy_dissipated']:.4g} J"
        f" dissipated, {values['energy_stored']:.4g} J stored."
    )
    header = ["invariant", "value [1]", "at most [1]", "meaning", "verdict"]
    each = table(header, rows, "", marks)
    finer = "To see the lines converge, run again with `solver.refinement=2` and `4`: every step is then that many times finer."
    estimate = read_error_estimate(motion.solver)
    if estimate is not None:
        finer = f"The run was done again from the same state with finer steps: {estimate}."
    lines = f"These invariants do not bound the error of a line. {finer}"
    return Text(verdict), each, Text(energy), Text(lines)
