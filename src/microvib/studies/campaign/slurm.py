"""A campaign on Slurm: a job array, each job a shard that needs only the campaign's folder and this installation."""

from __future__ import annotations

import json
import shlex
import shutil
import subprocess
import sys
from collections.abc import Sequence

from microvib.errors import MicrovibError, OptionError
from microvib.io.writing import write_file
from microvib.studies.campaign.folder import Campaign

SCRIPT, JOBS, TODO = "slurm.sh", "slurm.json", "slurm-todo.txt"


def submit(campaign: Campaign, jobs: int, directives: Sequence[str] = (), *, only_write: bool = False) -> str:
    """Write the script of a job array over what is missing, and submit it; a sentence on what was done.

    ``directives`` are options of ``sbatch`` such as ``--time=02:00:00``. MicrovibError where jobs of this campaign are still
    waiting or running, or Slurm refuses.
    """
    missing = campaign.missing()
    if not missing:
        return f"Nothing to do: all {campaign.chunks} chunks are there."
    state = job_state(campaign)
    if state:
        raise MicrovibError(f"{campaign.folder}: its Slurm {state}; wait for it, or scancel it, then resume")
    count = min(jobs, len(missing))
    # What is missing now: while shards work it changes, and they would not agree on who takes what.
    write_file(campaign.folder / TODO, "\n".join(map(str, missing)) + "\n", overwrite=True)
    script = campaign.folder.resolve() / SCRIPT
    write_file(script, _script(campaign, count, directives), overwrite=True)
    if only_write:
        return f"Written: {script}. Submit it with: sbatch {script}"
    job = _sbatch(str(script))
    write_file(campaign.folder / JOBS, json.dumps({"job": job, "shards": count}) + "\n", overwrite=True)
    return (
        f"Submitted job {job}: {count} shards over {len(missing)} chunks. Look with: microvib campaign status {campaign.folder}"
        f"; whatever ends it: microvib campaign resume {campaign.folder} --on slurm"
    )


def _script(campaign: Campaign, count: int, directives: Sequence[str]) -> str:
    folder = campaign.folder.resolve()
    own = ["--job-name=microvib", f"--array=0-{count - 1}", f"--output={folder}/slurm-%a.log", "--open-mode=append"]
    lines = [f"#SBATCH {option}" for option in (*own, *directives)]
    command = shlex.join([sys.executable, "-m", "microvib", "campaign", "run", str(folder)])
    # One process for each CPU that Slurm gives; without a say, one.
    todo = shlex.quote(str(folder / TODO))
    shard = f'--workers "${{SLURM_CPUS_PER_TASK:-1}}" --shard "$SLURM_ARRAY_TASK_ID/{count}" --todo {todo}'
    return "\n".join(["#!/bin/sh", *lines, f"exec {command} {shard}", ""])


def _sbatch(script: str) -> str:
    if shutil.which("sbatch") is None:
        missing = "there is no sbatch here; log in where Slurm is, or only write the script"
        raise OptionError("on", missing, "slurm", remedy="no_submit")
    done = subprocess.run(["sbatch", "--parsable", script], capture_output=True, text=True, check=False)
    if done.returncode != 0:
        raise OptionError("on", f"sbatch says: {done.stderr.strip() or done.stdout.strip()}", "slurm")
    return done.stdout.strip().split(";")[0]


def job_state(campaign: Campaign) -> str:
    """The job of this campaign that Slurm still has, in words; empty if there is none."""
    path = campaign.folder / JOBS
    if not path.is_file() or shutil.which("squeue") is None:
        return ""
    job = str(json.loads(path.read_text(encoding="utf-8"))["job"])
    found = subprocess.run(["squeue", "-h", "-r", "-j", job, "-o", "%T"], capture_output=True, text=True, check=False)
    states = found.stdout.split() if found.returncode == 0 else []  # an old job is an error
    counts = [f"{states.count(state)} {state.lower()}" for state in dict.fromkeys(states)]
    return f"job {job} has {', '.join(counts)}" if counts else ""
