"""The command that ranks what is not known."""

from __future__ import annotations

import math
from dataclasses import asdict

import click

from microvib.cli.common import load, set_option
from microvib.cli.progress import progress_bar
from microvib.cli.streams import echo


@click.command()
@click.argument("scenario")
@click.option("--json", "as_json", is_flag=True, help="Print JSON, in SI.")
@set_option
def sensitivity(scenario: str, as_json: bool, settings: tuple[str, ...]) -> None:
    """Rank, line by line, which value of SCENARIO matters most, of those whose sources note a range.

    Each goes to both ends of its range, and to extremes of the linearised drive in between, the others as they are;
    d ln/d ln is the sensitivity at the value itself.
    """
    from microvib.io.tables import to_json
    from microvib.studies.sensitivity import sensitivities

    loaded = load(scenario, settings)
    with progress_bar("simulating", "runs") as progress:
        found = sensitivities(loaded, progress=progress)
    if as_json:
        click.echo(to_json(asdict(found)), nl=False)
        return
    quantities = {key: quantity for key, _, quantity in loaded.entries()}
    for line in found:
        echo(f"\n{line.line}, {line.frequency:.4g} Hz, {1e3 * line.amplitude:.4g} mN m: {line.verdict}")
        echo(f"  {'value':42s} {'d ln/d ln':>9s} {'mN m over its range':>22s}  range")
        for effect in line.effects:
            quantity = quantities[effect.key]
            ends = [quantity.show(x) if quantity else f"{x:g}" for x in effect.range]
            low, high = (1e3 * x for x in effect.amplitudes)
            moved = f"{low:.4g} to {high:.4g}"
            none = math.isnan(effect.sensitivity) and not math.isnan(effect.slopes[0])
            slope = "none *" if none else f"{effect.sensitivity:.3g}"
            echo(f"  {effect.key:42s} {slope:>9s} {moved:>22s}  {ends[0]} to {ends[1]}")
            for value, amplitude in effect.between:
                at = quantity.show(value) if quantity else f"{value:g}"
                echo(f"    {1e3 * amplitude:.4g} mN m at {at}, where the linearised drive has an extreme")
            if none:
                echo(
                    f"    * {effect.slopes[0]:.3g} below and {effect.slopes[1]:.3g} above: the line jumps or bends there"
                )
    for case in found.failed:
        quantity = quantities[case.key]
        echo(f"\nNo run with {case.key} {quantity.show(case.value) if quantity else case.value}: {case.reason}")
    if found.left_out:
        echo("\nNot ranked:")
    for key, why in found.left_out.items():
        echo(f"  {key}: {why}")
