"""A campaign on Slurm: a job array, each job a shard that needs only the campaign's folder and this
installation.
"""

from __future__ import annotations

import json
import re
import shlex
import shutil
import subprocess
import sys
from collections.abc import Sequence

from microvib.errors import MicrovibError, OptionError, quoted_value
from microvib.io.writing import write_file
from microvib.studies.campaign.folder import Campaign

SCRIPT, JOBS, TODO = "slurm.sh", "slurm.json", "slurm-todo.txt"


def submit(
    campaign: Campaign, jobs: int, directives: Sequence[str] = (), *, only_write: bool = False
) -> str:
    """Write the script of a job array over what is missing, and submit it; a sentence on what was
    done.

    ``directives`` are options of ``sbatch`` such as ``--time=02:00:00``. MicrovibError where jobs
    of this campaign are still waiting or running, or Slurm refuses.
    """
    missing = campaign.missing()
    if not missing:
        return f"Nothing to do: all {campaign.chunks} chunks are computed."
    state = job_state(campaign)
    if state:
        raise MicrovibError(
            f"{campaign.folder}: its Slurm {state}; wait for it, or scancel it, then resume"
        )
    count = min(jobs, len(missing))
    text = _script(campaign, count, directives)
    # What is missing now: while shards work it changes, and they would not agree on who takes what.
    write_file(campaign.folder / TODO, "\n".join(map(str, missing)) + "\n", overwrite=True)
    script = campaign.folder.resolve() / SCRIPT
    write_file(script, text, overwrite=True)
    if only_write:
        return f"Written: {script}. Submit it with: sbatch {shlex.quote(str(script))}"
    job = _sbatch(str(script))
    write_file(
        campaign.folder / JOBS, json.dumps({"job": job, "shards": count}) + "\n", overwrite=True
    )
    typed = shlex.quote(str(campaign.folder))
    return (
        f"Submitted job {job}: {count} shards over {len(missing)} chunks. Progress: microvib campaign status {typed}"
        f"; after an interruption: microvib campaign resume {typed} --on slurm"
    )


def _script(campaign: Campaign, count: int, directives: Sequence[str]) -> str:
    folder = campaign.folder.resolve()
    if not str(folder).isprintable():
        raise MicrovibError(
            f"{quoted_value(str(folder))}: a line break or another control character in a folder's"
            " name does not go into a"
            " script of Slurm; rename the folder"
        )
    log = str(folder).replace("%", "%%") + "/slurm-%a.log"
    own = ["--job-name=microvib", f"--array=0-{count - 1}", f"--output={log}", "--open-mode=append"]
    lines = [f"#SBATCH {_directive(option)}" for option in (*own, *directives)]
    command = shlex.join([sys.executable, "-m", "microvib", "campaign", "run", str(folder)])
    # One process for each CPU that Slurm gives; without a say, one.
    todo = shlex.quote(str(folder / TODO))
    shard = f'--workers "${{SLURM_CPUS_PER_TASK:-1}}" --shard "$SLURM_ARRAY_TASK_ID/{count}" --todo {todo}'
    return "\n".join(["#!/bin/sh", *lines, f"exec {command} {shard}", ""])


_DIRECTIVE = re.compile(
    r"(?P<name>--[A-Za-z][\w-]*|-[A-Za-z])((?P<between>=|\s+|(?<=^-\w))(?P<value>.+))?"
)
_PLAIN = re.compile(r"[\w@%+=:,./~^{}\[\]-]+")


def _directive(option: str) -> str:
    """An option of sbatch as a line of its script takes it: one line, its value in double quotes
    where it has blanks or the like.

    OptionError where it is no option.
    """
    found = _DIRECTIVE.fullmatch(option.strip())
    if found is None or not option.isprintable():
        raise OptionError(
            "sbatch",
            "is no option of sbatch; write one, such as --time=02:00:00, without line breaks",
            quoted_value(option),
        )
    if found["value"] is None:
        return found["name"]
    value = found["value"]
    if len(value) > 1 and value[0] == value[-1] == '"':
        value = value[1:-1]  # quoted for the script already
    if not _PLAIN.fullmatch(value):
        value = '"' + value.replace("\\", "\\\\").replace('"', '\\"') + '"'
    return f"{found['name']}{found['between'][:1]}{value}"


def _sbatch(script: str) -> str:
    if shutil.which("sbatch") is None:
        missing = "there is no sbatch here; log in where Slurm is, or only write the script"
        raise OptionError("on", missing, "slurm", remedy="no_submit")
    done = subprocess.run(
        ["sbatch", "--parsable", script], capture_output=True, text=True, check=False
    )
    if done.returncode != 0:
        raise OptionError(
            "on", f"sbatch says: {done.stderr.strip() or done.stdout.strip()}", "slurm"
        )
    return done.stdout.strip().split(";")[0]


def job_state(campaign: Campaign) -> str:
    """The job of this campaign that Slurm still has, in words; empty if there is none."""
    path = campaign.folder / JOBS
    if not path.is_file() or shutil.which("squeue") is None:
        return ""
    job = str(json.loads(path.read_text(encoding="utf-8"))["job"])
    found = subprocess.run(
        ["squeue", "-h", "-r", "-j", job, "-o", "%T"], capture_output=True, text=True, check=False
    )
    states = found.stdout.split() if found.returncode == 0 else []  # an old job is an error
    counts = [f"{states.count(state)} {state.lower()}" for state in dict.fromkeys(states)]
    if counts:
        return f"job {job} has {', '.join(counts)}"
    return ""
