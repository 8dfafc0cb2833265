"""The command that finds rate profiles which leave an array's modes quiet."""

from __future__ import annotations

import click

from microvib.cli.common import (
    Target,
    load,
    parse_limit,
    set_option,
    target_options,
    with_precompilation,
)
from microvib.cli.progress import progress_bar


@click.command()
@click.argument("scenario")
@click.option("--initial-rate", default="0 deg/s", metavar="RATE", help="Rate of the array before.")
@click.option(
    "--final-rate", metavar="RATE", help="Rate of the array after it [default: the scenario's]."
)
@click.option(
    "--angle",
    metavar="ANGLE",
    help="Angle to be gained on a target that moves with the final rate, e.g. '20 deg': rewind, catch-up.",
)
@click.option("--largest-rate", metavar="RATE", help="Largest rate while an angle is gained.")
@click.option(
    "--largest-acceleration",
    metavar="ACCELERATION",
    help="Largest acceleration of the array, e.g. '0.1 deg/s^2' [default: rates may jump].",
)
@click.option(
    "--limit",
    metavar="TORQUE|FILE",
    help="Largest ringing of a mode at the end of it, e.g. '2 mN*m', or a CSV file of a curve over frequency"
    " [default: by --attenuation].",
)
@click.option(
    "--attenuation",
    default=30.0,
    metavar="DB",
    help="Without --limit: how far [dB] ringing must be below that of a step of the rate.",
)
@click.option(
    "--frequency-uncertainty",
    default="10 percent",
    metavar="PART",
    help="Part by which the modes' frequencies may be off either way.",
)
@click.option(
    "--damping-uncertainty",
    default="50 percent",
    metavar="PART",
    help="Part by which their dampings may be off either way.",
)
@click.option(
    "--friction-uncertainty",
    default="0 percent",
    metavar="PART",
    help="Part by which friction on the output may be off either way.",
)
@click.option(
    "--linear",
    is_flag=True,
    help="Use the linearised drive alone, without runs of the full model: nothing is judged.",
)
@set_option
@target_options("Folder for tables, pictures, profile and scenario [default: print only].")
@with_precompilation
def profile(
    scenario: str, initial_rate: str, final_rate: str | None, angle: str | None, largest_rate: str | None,
    largest_acceleration: str | None, limit: str | None, attenuation: float, frequency_uncertainty: str,
    damping_uncertainty: str, friction_uncertainty: str, linear: bool, settings: tuple[str, ...],
    target: Target,
) -> None:  # fmt: skip
    """Find the shortest rate profile of SCENARIO, for a start, a stop, a rewind or a catch-up, that
    leaves the array's modes ringing below a limit, beside trapezoid, S curve and input shapers.
    """
    from microvib.reports.profiles import profile_outcome
    from microvib.studies.profiles.plan import plan_profile

    loaded = load(scenario, settings)
    allowed = parse_limit(limit, None)
    with progress_bar("simulating", "runs") as progress:
        plan = plan_profile(
            loaded,
            initial_rate=initial_rate,
            final_rate=final_rate,
            angle=angle,
            largest_rate=largest_rate,
            largest_acceleration=largest_acceleration,
            limit=allowed,
            attenuation=attenuation,
            frequency_uncertainty=frequency_uncertainty,
            damping_uncertainty=damping_uncertainty,
            friction_uncertainty=friction_uncertainty,
            runs=not linear,
            progress=progress,
        )
    target.present(profile_outcome(plan))
