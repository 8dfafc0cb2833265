"""Subject of an export: a scenario, with its run where there is one."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from microvib.analysis.run import RunResult, run_scenario
from microvib.errors import MicrovibError, ObjectError, quoted_value
from microvib.io.file_access import WORKING_FOLDER, FileAccess
from microvib.io.runs import Run, read_run
from microvib.io.scenario_file import load_scenario
from microvib.model.scenario import Scenario
from microvib.solve.motion import Motion

Progress = Callable[[float, float], None]


@dataclass(frozen=True)
class Subject:
    """A scenario, and what its run found."""

    scenario: Scenario
    result: RunResult | None = None

    @property
    def run(self) -> RunResult:
        """Its run; MicrovibError where there is none."""
        if self.result is None:
            raise MicrovibError("this scenario was not run; a run is expected")
        return self.result

    @property
    def motion(self) -> Motion:
        """Motion of its run; MicrovibError where lines alone were kept."""
        motion = self.run.motion
        if motion is None:
            raise MicrovibError("this run kept lines only; one with its motion is expected")
        return motion

    def as_run(self, progress: Progress | None = None) -> Subject:
        """Subject with a run: its own, or one that is made now."""
        if self.result is not None:
            return self
        return Subject(self.scenario, run_scenario(self.scenario, progress=progress))


def subject_of(source: Any, files: FileAccess = WORKING_FOLDER) -> Subject:
    """Find what is to be exported: a scenario or its name, a run or its folder, a motion.

    Raises
    ------
    MicrovibError
        Where a name stands for neither a scenario nor the folder of a run.
    ObjectError
        For any other object.
    """
    if isinstance(source, Subject):
        return source
    if isinstance(source, Scenario):
        return Subject(source)
    if isinstance(source, RunResult):
        return Subject(source.scenario, source)
    if isinstance(source, Run):
        kept = RunResult.of_motion(source.motion, source.table, source.second_table)
        return Subject(kept.scenario, kept)
    if isinstance(source, Motion):
        from microvib.analysis.lines import find_lines

        return Subject(source.scenario, RunResult.of_motion(source, find_lines(source)))
    if not isinstance(source, (str, Path)):
        raise ObjectError(
            f"{quoted_value(source)} is of type {type(source).__name__}; expected a scenario, a run"
            " (mv.run_scenario), a motion (mv.simulate), or the name of a scenario or of a run's folder"
        )
    path = files.path(str(source))
    if path.is_dir():
        return subject_of(read_run(path))
    return Subject(load_scenario(str(source)))
