"""A drive as an FMU: the same code, image and wrapper as the C library, behind FMI's functions."""

from __future__ import annotations

import hashlib
import io
import os
import re
import uuid
import zipfile
from collections.abc import Sequence
from dataclasses import dataclass
from html import escape
from importlib.metadata import version as package_version
from pathlib import Path

import numpy as np

from microvib.errors import OptionError
from microvib.export.native.description import Description, model_description
from microvib.export.native.drive import (
    drive_image,
    exportable,
    load_weights,
    without_modes,
)
from microvib.export.native.icon import icon
from microvib.export.native.library import platforms_or_host
from microvib.export.native.linking import WRAPPER, link
from microvib.export.native.objects import code_objects, image_object, platform_of
from microvib.export.native.tones import (
    lines_of,
    tone_results,
    tone_table,
    tone_variables,
    with_lines,
)
from microvib.export.native.variables import Variable, variables_of
from microvib.io.scenario_file import dump_scenario
from microvib.io.writing import write_file
from microvib.model.rigid import COMPONENTS
from microvib.model.scenario import GivenScenario, Scenario
from microvib.solve import kernel
from microvib.solve.command import Command
from microvib.solve.noise import torque_noise
from microvib.solve.pack import pack
from microvib.solve.sampling import sample_buffer

TONES = ("tones.c",)
"""Files in C that stand in for the wrapper of a drive where there are lines alone."""
VERSIONS = (2, 3)
KINDS = ("source", "drive", "tones")
FOLDERS = {
    2: {"linux64": "linux64", "win64": "win64", "darwin64": "darwin64"},
    3: {
        "linux64": "x86_64-linux",
        "linux-arm64": "aarch64-linux",
        "win64": "x86_64-windows",
        "darwin64": "x86_64-darwin",
        "darwin-arm64": "aarch64-darwin",
    },
}
"""Folder of a platform's binary, by the version of FMI."""
STEP = 0.01
"""Communication step [s] that an FMU proposes, and of its reference results."""
REFERENCE_STEPS = 500
"""Communication steps of the reference results."""


def export_fmu(
    scenario: GivenScenario,
    path: str | os.PathLike[str],
    *,
    version: int = 2,
    kind: str = "source",
    platforms: Sequence[str] = (),
    overwrite: bool = False,
) -> Path:
    """Write an FMU for co-simulation of the drive of a scenario.

    Parameters
    ----------
    scenario : Scenario, str or path
        What is exported: it begins at rest, whatever its ``record`` says.
    path : str or path
        The file, whose name ends in ``.fmu``.
    version : int
        Version of FMI, 2 or 3.
    kind : str
        ``source``: the spacecraft's acceleration comes in, the disturbance torque goes out.
        ``drive``: the source without the modes of the array, which the host has: their torque comes
        in at the shaft, the shaft's motion goes out.
        ``tones``: lines that last alone, as sums of cosines, whatever the spacecraft does.
    platforms : sequence of str, optional
        Platforms that it shall run on, names of ``FOLDERS``; without any this machine's.
    overwrite : bool
        Replace a file that is there.

    Returns
    -------
    pathlib.Path
        The file.

    Raises
    ------
    MicrovibError
        For a scenario that cannot be exported, an option that is wrong, where there is no compiler
        for a platform, and where the file cannot be written.
    """
    target = Path(path)
    _check(target, version, kind)
    given = _given(scenario, kind)
    names = _checked_platforms(platforms, version)
    content = _tones(given) if kind == "tones" else _source(given)
    guid = _guid(content.image, version)
    description = Description(
        model=model_name(target),
        guid=guid,
        text=content.text,
        author="microvib",
        variables=content.variables,
        stop=REFERENCE_STEPS * STEP,
        step=STEP,
    )
    files: dict[str, bytes] = {
        "modelDescription.xml": model_description(description, version),
        "documentation/reference.csv": content.reference.encode(),
        "documentation/scenario.yaml": dump_scenario(given).encode(),
        "documentation/index.html": _page(description).encode(),
    }
    files |= _icons(version)
    for name in names:
        platform = platform_of(name)
        binary = platform.library.format(description.model)
        files[f"binaries/{FOLDERS[version][name]}/{binary}"] = content.binary(
            name, f"fmi{version}.c", f'MICROVIB_GUID="{guid}"'
        )
    write_file(target, _zipped(files), overwrite)
    return target


@dataclass(frozen=True)
class Content:
    """Content of an FMU that depends on its kind."""

    image: bytes
    wrapper: tuple[str, ...]
    """Its sources in C."""
    variables: list[Variable]
    text: str
    reference: str

    def binary(self, platform: str, source: str, define: str) -> bytes:
        """The shared library for a platform, of FMI's functions in a ``source``."""
        own = platform_of(platform)
        objects = {"image": image_object(own, self.image)}
        if self.wrapper == WRAPPER:
            objects |= code_objects(own)
        return link(own, (source, "fmu.c", *self.wrapper), objects, ("MICROVIB_BUILT_IN", define))


def _source(scenario: Scenario) -> Content:
    return Content(
        drive_image(scenario),
        WRAPPER,
        variables_of(scenario),
        _text(scenario),
        reference_results(scenario),
    )


def _tones(scenario: Scenario) -> Content:
    lines = lines_of(scenario)
    times = [STEP * k for k in range(1, REFERENCE_STEPS + 1)]
    text = (
        f"Disturbance lines of the solar array drive and array of '{scenario.title}': sums of"
        " cosines, of its lines that last; phases count from the first sample of its record."
        " Nothing acts back: no transients, no motion of the spacecraft."
    )
    return Content(
        tone_table(lines),
        TONES,
        tone_variables(list(lines)),
        text,
        tone_results(lines, times),
    )


def _check(target: Path, version: int, kind: str) -> None:
    if version not in VERSIONS:
        raise OptionError("version", "of FMI is not written; 2 or 3 is expected", str(version))
    if kind not in KINDS:
        raise OptionError("kind", f"of FMU is not written; expected is {', '.join(KINDS)}", kind)
    if target.suffix != ".fmu":
        raise OptionError("path", "must end in .fmu, which importers ask for", str(target))


def _given(scenario: GivenScenario, kind: str) -> Scenario:
    """The scenario of an FMU of a kind."""
    if kind == "tones":
        return with_lines(scenario)
    if kind == "drive":
        return without_modes(exportable(scenario))
    return exportable(scenario)


def _checked_platforms(platforms: Sequence[str], version: int) -> list[str]:
    names = platforms_or_host(platforms)
    for name in names:
        if name not in FOLDERS[version]:
            raise OptionError(
                "platforms",
                f"is none of FMI {version}; there are {', '.join(FOLDERS[version])}",
                name,
            )
    return names


def model_name(target: Path) -> str:
    """Name of the model, a word that C takes, by that of the file."""
    word = re.sub(r"\W", "_", target.stem, flags=re.ASCII)
    return f"_{word}" if not word or word[0].isdigit() else word


def _guid(image: bytes, version: int) -> str:
    """Token of a drive, which never changes, so that a binary fits the description that it came with."""
    code = f"{version} {package_version('microvib')}".encode()
    digest = hashlib.sha256(image + code).digest()
    return "{" + str(uuid.UUID(bytes=digest[:16])) + "}"


def _text(scenario: Scenario) -> str:
    return (
        f"Disturbance torque source: solar array drive and array of '{scenario.title}'."
        " It begins at rest. T_d contains the torque that inertias make of hub_acceleration; a host"
        " that computes this acceleration from T_d of the step before is stable only where the"
        " inertia of its spacecraft is larger than that of the array. What is not among the parameters"
        f" is fixed at export: {_what_feeds(scenario)}, inertias, frequencies and participation of"
        " modes, shapes of friction, errors of gear and driver, noise, a profile of rates."
        f"{_repeats(scenario)}"
        " Binaries only: there is no C source of the compiled equations."
    )


def _what_feeds(scenario: Scenario) -> str:
    """Windings and what drives them, in words."""
    if not scenario.driver.pulsed:
        return "windings and current loop"
    return f"windings, pulses and clamp ({scenario.driver.clamp})"


def _repeats(scenario: Scenario) -> str:
    """Sentence on the time after which torque noise repeats; empty without."""
    noise, rate = torque_noise(scenario)
    if not noise.size:
        return ""
    return f" Torque noise is one draw, which repeats after {0.5 * noise.size / rate:.6g} s."


def reference_results(scenario: Scenario) -> str:
    """Results of the default experiment as CSV, computed by the solver in Python: time, T_d, its mean
    over each communication step, and the loads.
    """
    packed, command, weights = pack(scenario), Command(scenario), load_weights(scenario)
    silent = np.zeros((0, packed.columns))
    names = [name for name in COMPONENTS if len(weights)]
    lines = [",".join(["time", "T_d", "T_d_mean", *names])]
    for k in range(1, REFERENCE_STEPS + 1):
        begun, stop = STEP * (k - 1), STEP * k
        before = packed.momentum
        samples = sample_buffer(silent, begun, stop - begun)
        status = packed.advance(stop, samples, *command.microsteps(begun, stop))
        assert status == kernel.OK, status
        values = packed.snapshot()
        loads = weights @ values if len(weights) else []
        mean = (before - packed.momentum) / (stop - begun)
        numbers = [stop, values[kernel.T_D], mean, *loads]
        lines.append(",".join(f"{float(number):.17g}" for number in numbers))
    return "\n".join(lines) + "\n"


def _page(said: Description) -> str:
    """One page on the FMU, which importers show."""
    rows = "".join(
        f"<tr><td>{v.name}</td><td>{v.causality}</td><td>{v.unit}</td><td>{escape(v.meaning)}</td></tr>\n"
        for v in said.variables
    )
    return (
        f"<!DOCTYPE html>\n<html lang='en'><head><meta charset='utf-8'><title>{said.model}</title>"
        f"</head><body><h1>{said.model}</h1>\n<p>{escape(said.text)}</p>\n<p>reference.csv holds results of"
        f" the default experiment, communication steps of {said.step:g} s without inputs, as"
        " microvib computes them; scenario.yaml is the scenario.</p>\n<table><tr><th>variable</th>"
        f"<th>causality</th><th>unit</th><th>meaning</th></tr>\n{rows}</table></body></html>\n"
    )


def _icons(version: int) -> dict[str, bytes]:
    """The icon, where a version of FMI has it."""
    return {"model.png" if version == 2 else "terminalsAndIcons/icon.png": icon()}


def _zipped(files: dict[str, bytes]) -> bytes:
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, content in files.items():
            archive.writestr(name, content)
    return packed.getvalue()
