"""The command that makes a reaction wheel of its measured waterfalls."""

from __future__ import annotations

from typing import Any

import click

from microvib.cli.common import Target, options, target_options
from microvib.errors import OptionError

_load_options = options(
    *(
        click.option(
            f"--{name}",
            multiple=True,
            metavar="FILE[:NAME]|CHANNEL",
            help=f"Waterfall of the {what}, and the matrix's name where a file has several; with a RECORDING, its channel.",
        )
        for name, what in (
            ("radial-force", "force across the spin axis; give it twice for both axes"),
            ("axial-force", "force along the spin axis"),
            ("radial-torque", "torque across the spin axis; give it twice for both axes"),
            ("axial-torque", "torque about the spin axis"),
        )
    )
)
_number_options = options(
    click.option(
        "--speeds", type=click.Choice(["rpm", "rad/s", "rps", "deg/s"]), help="Unit of the speeds."
    ),
    click.option(
        "--amplitude",
        type=click.Choice(["peak", "rms", "power", "psd"]),
        help="What the numbers are: amplitudes 0-to-peak or rms, squares of the rms, or densities.",
    ),
    click.option(
        "--window",
        type=click.Choice(["rectangular", "hann", "flat-top"]),
        help="Window of the spectra.",
    ),
    click.option("--force-unit", metavar="UNIT", help="Unit of forces, such as mN."),
    click.option("--torque-unit", metavar="UNIT", help="Unit of torques, such as 'mN*m'."),
    click.option(
        "--layout",
        type=click.Choice(["speeds-in-rows", "speeds-in-columns"]),
        help="Of a CSV file whose first cell does not say it, as 'rpm \\ Hz' does, and of a square MAT matrix.",
    ),
)


@click.command()
@click.argument("recording", required=False)
@_load_options
@_number_options
@click.option(
    "--tacho", metavar="CHANNEL", help="Of a RECORDING: channel with the pulses of a tacho."
)
@click.option("--pulses-per-rev", type=float, help="Pulses of the tacho per turn [default: 1].")
@click.option(
    "--resolution", metavar="FREQUENCY", help="Resolution of a RECORDING's spectra [default: 1 Hz]."
)
@target_options("Folder for harmonics.csv, wheel.yaml, tables and report [default: print only].")
def wheel(
    recording: str | None, radial_force: tuple[str, ...], axial_force: tuple[str, ...],
    radial_torque: tuple[str, ...], axial_torque: tuple[str, ...], tacho: str | None,
    pulses_per_rev: float | None, resolution: str | None, target: Target, **numbers: Any,
) -> None:  # fmt: skip
    """Find a reaction wheel's harmonics and structural modes in its measured waterfalls, spectra over
    speed as CSV, MAT or UFF 58, or in a RECORDING of a run-up with a tacho; for `microvib budget`.
    """
    from microvib.reports.wheel import wheel_outcome
    from microvib.studies.wheel import measured_wheel
    from microvib.studies.wheel_maps import Given, maps_of_files, maps_of_recording

    loads = {
        "radial_force": radial_force, "axial_force": axial_force,
        "radial_torque": radial_torque, "axial_torque": axial_torque,
    }  # fmt: skip
    if recording is None:
        of_recording = {
            "tacho": tacho, "pulses_per_rev": pulses_per_rev, "resolution": resolution
        }  # fmt: skip
        _refuse(of_recording, "is of a recording; waterfalls have their speeds")
        maps = maps_of_files(loads, Given(**numbers))
    else:
        _refuse(numbers, "is of a waterfall from a file; a recording says it")
        if tacho is None:
            raise OptionError("tacho", "a recording needs the channel of a tacho")
        maps = maps_of_recording(
            recording, loads, tacho,
            pulses_per_rev=1.0 if pulses_per_rev is None else pulses_per_rev,
            resolution=resolution or "1 Hz",
        )  # fmt: skip
    first = recording or next(text for texts in loads.values() for text in texts)
    target.present(wheel_outcome(measured_wheel(maps, first)))


def _refuse(given: dict[str, Any], why: str) -> None:
    """OptionError where one of some options is given."""
    for key, value in given.items():
        if value is not None:
            raise OptionError(key, why)
