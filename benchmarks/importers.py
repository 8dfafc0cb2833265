"""FMUs in importers other than FMPy: libcosim of the Open Simulation Platform (``pip install libcosimpy``, FMI
2.0) and Ecos (``pip install ecospy``, which needs libtbb 12; FMI 2.0 and 3.0). Those that are installed
run state-1 for 5 s in steps of 10 ms; its torque is compared with the reference results in the FMU.
"""

from __future__ import annotations

import importlib.util
import io
import tempfile
import zipfile
from collections.abc import Iterator
from pathlib import Path

import numpy as np

import microvib as mv

STEPS, STEP = 500, 0.01


def by_libcosim(fmu: Path) -> list[float]:
    """T_d after each step."""
    from libcosimpy.CosimExecution import CosimExecution
    from libcosimpy.CosimObserver import CosimObserver
    from libcosimpy.CosimSlave import CosimLocalSlave

    execution = CosimExecution.from_step_size(step_size=STEP * 1e9)
    slave = execution.add_local_slave(CosimLocalSlave(fmu_path=str(fmu), instance_name="drive"))
    observer = CosimObserver.create_last_value()
    execution.add_observer(observer)
    found = []
    variables = execution.slave_variables(slave_index=slave)
    (torque,) = [x.reference for x in variables if x.name.decode() == "T_d"]
    for _ in range(STEPS):
        assert execution.step()
        found += observer.last_real_values(slave_index=slave, variable_references=[torque])
    return found


def by_ecos(fmu: Path) -> list[float]:
    """T_d after each step."""
    from ecospy import EcosSimulation, EcosSimulationStructure

    structure, found = EcosSimulationStructure(), []
    structure.add_model("drive", str(fmu))
    with EcosSimulation(structure=structure, step_size=STEP) as simulation:
        simulation.init()
        for _ in range(STEPS):
            simulation.step()
            found.append(simulation.get_real("drive::T_d"))
    return found


IMPORTERS = (("libcosimpy", by_libcosim, ("fmu2",)), ("ecospy", by_ecos, ("fmu2", "fmu3")))


def results(folder: Path) -> Iterator[str]:
    """A line for each importer and version of FMI."""
    for module, run, versions in IMPORTERS:
        for version in versions:
            if importlib.util.find_spec(module) is None:
                yield f"{module} {version}: not installed"
                continue
            fmu = mv.export_as("state-1", version, folder / f"{module}-{version}.fmu")
            content = zipfile.ZipFile(fmu).read("documentation/reference.csv")
            reference = np.genfromtxt(io.BytesIO(content), delimiter=",", names=True)["T_d"]
            off = np.max(np.abs(np.array(run(fmu)) - reference)) / np.max(np.abs(reference))
            yield f"{module} {version}: T_d within {off:.1e} of its largest"


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as folder:
        for line in results(Path(folder)):
            print(line)
