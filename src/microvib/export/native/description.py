"""modelDescription.xml of an FMU, for FMI 2.0 and 3.0."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from importlib.metadata import version

from microvib.export.native.variables import Variable

UNITS = {
    "A": {"A": 1},
    "V": {"kg": 1, "m": 2, "s": -3, "A": -1},
    "rad": {"rad": 1},
    "rad/s": {"rad": 1, "s": -1},
    "rad/s^2": {"rad": 1, "s": -2},
    "m/s^2": {"m": 1, "s": -2},
    "N*m": {"kg": 1, "m": 2, "s": -2},
    "N": {"kg": 1, "m": 1, "s": -2},
    "J": {"kg": 1, "m": 2, "s": -2},
    "s": {"s": 1},
    "1": {},
    "N*m/rad": {"kg": 1, "m": 2, "s": -2, "rad": -1},
    "N*m*s/rad": {"kg": 1, "m": 2, "s": -1, "rad": -1},
    "1/s": {"s": -1},
}
"""Exponents of base units in units; others have a name alone, since FMI has no halves of them."""
TOOL = "microvib"
FLAGS = {
    2: {
        "canHandleVariableCommunicationStepSize": "true",
        "canGetAndSetFMUstate": "true",
        "canSerializeFMUstate": "true",
        "canNotUseMemoryManagementFunctions": "true",
    },
    3: {
        "canHandleVariableCommunicationStepSize": "true",
        "canGetAndSetFMUState": "true",
        "canSerializeFMUState": "true",
    },
}
"""Capabilities of an FMU, by the version of FMI."""


@dataclass(frozen=True)
class Description:
    """Content of a modelDescription.xml."""

    model: str
    """Name of the model, and of the binaries."""
    guid: str
    text: str
    author: str
    variables: Sequence[Variable]
    stop: float
    """Default end of a simulation [s]."""
    step: float
    """Default communication step [s]."""


def model_description(said: Description, version_of_fmi: int) -> bytes:
    """The file for FMI 2 or 3."""
    about = {
        "fmiVersion": f"{version_of_fmi}.0",
        "modelName": said.model,
        "description": said.text,
        "author": said.author,
        "version": version(TOOL),
        "license": "Apache-2.0",
        "generationTool": f"{TOOL} {version(TOOL)}",
        "generationDateAndTime": datetime.now(UTC).strftime("%Y-%m-%dT%H:%M:%SZ"),
        "variableNamingConvention": "structured",
    }
    if version_of_fmi == 2:
        about |= {"guid": said.guid, "numberOfEventIndicators": "0"}
    else:
        about["instantiationToken"] = said.guid
    root = ET.Element("fmiModelDescription", about)
    ET.SubElement(root, "CoSimulation", {"modelIdentifier": said.model, **FLAGS[version_of_fmi]})
    _add_units(root, said.variables)
    ET.SubElement(
        root,
        "DefaultExperiment",
        {"startTime": "0", "stopTime": f"{said.stop:g}", "stepSize": f"{said.step:g}"},
    )
    listed = ET.SubElement(root, "ModelVariables")
    structure = ET.Element("ModelStructure")
    if version_of_fmi == 2:
        _add_variables_2(listed, structure, said.variables)
    else:
        _add_variables_3(listed, structure, said.variables)
    root.append(structure)
    ET.indent(root)
    return bytes(ET.tostring(root, encoding="utf-8", xml_declaration=True))


def _add_units(root: ET.Element, variables: Sequence[Variable]) -> None:
    listed = ET.SubElement(root, "UnitDefinitions")
    for name in sorted({variable.unit for variable in variables if variable.unit}):
        unit = ET.SubElement(listed, "Unit", {"name": name})
        if name in UNITS:
            exponents = {base: str(power) for base, power in UNITS[name].items()}
            ET.SubElement(unit, "BaseUnit", exponents)


def _number(variable: Variable, value: float) -> str:
    return str(int(value)) if variable.kind == "Integer" else repr(float(value))


def _values(variable: Variable) -> dict[str, str]:
    """Attributes of a variable's type: unit, bounds and start."""
    found = {"unit": variable.unit} if variable.unit else {}
    bounds = (("min", variable.lowest), ("max", variable.highest), ("start", variable.start))
    return found | {key: _number(variable, x) for key, x in bounds if x is not None}


def _common(variable: Variable) -> dict[str, str]:
    found = {
        "name": variable.name,
        "valueReference": str(variable.reference),
        "description": variable.meaning,
        "causality": variable.causality,
    }
    if variable.variability:
        found["variability"] = variable.variability
    elif variable.kind == "Integer":
        found["variability"] = "discrete"
    return found


def _add_variables_2(
    listed: ET.Element, structure: ET.Element, variables: Sequence[Variable]
) -> None:
    outputs = []
    for number, variable in enumerate(variables, 1):
        element = ET.SubElement(listed, "ScalarVariable", _common(variable))
        ET.SubElement(element, variable.kind, _values(variable))
        if variable.causality == "output":
            outputs.append(str(number))
    for kind in ("Outputs", "InitialUnknowns"):
        unknowns = ET.SubElement(structure, kind)
        for number_text in outputs:
            ET.SubElement(unknowns, "Unknown", {"index": number_text})


def _add_variables_3(
    listed: ET.Element, structure: ET.Element, variables: Sequence[Variable]
) -> None:
    names = {"Real": "Float64", "Integer": "Int64"}
    for variable in variables:
        ET.SubElement(listed, names[variable.kind], _common(variable) | _values(variable))
    for kind in ("Output", "InitialUnknown"):
        for variable in variables:
            if variable.causality == "output":
                reference = {"valueReference": str(variable.reference)}
                ET.SubElement(structure, kind, reference)
