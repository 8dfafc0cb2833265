"""Workers, coordinators and jobs that are killed, stopped, interrupted or cancelled in the middle: nothing is lost, and nothing is computed twice."""

from __future__ import annotations

import json
import os
import signal
import stat
import subprocess
import sys
import time
from pathlib import Path

import pytest
from support import commands
from support.campaigns import SHORT, Fragile, bytes_of, made, spread
from support.tiers import at_a_release

from microvib.errors import MicrovibError
from microvib.studies import workers as running
from microvib.studies.campaign.folder import open_campaign
from microvib.studies.campaign.results import merge
from microvib.studies.campaign.run import compute_missing
from microvib.studies.campaign.slurm import submit
from microvib.studies.workers import local


def microvib(*arguments: object, **options) -> subprocess.Popen:
    command = [sys.executable, "-m", "microvib", "campaign", *map(str, arguments)]
    return subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, **options
    )


def wait_for(condition, seconds: float = 240.0) -> None:
    until = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < until, "it took too long"
        time.sleep(0.02)


def children(pid: int) -> list[int]:
    try:
        return [int(p) for p in Path(f"/proc/{pid}/task/{pid}/children").read_text().split()]
    except OSError:
        return []


def alive(pid: int) -> bool:
    try:
        return Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()[0] != "Z"
    except OSError:
        return False


@pytest.mark.long
@pytest.mark.skipif(not Path("/proc/self/task").is_dir(), reason="needs /proc")
def test_a_stopped_worker_is_ended_and_its_cases_are_computed(tmp_path, monkeypatch):
    monkeypatch.setattr(running, "POLL_INTERVAL", 0.2)
    monkeypatch.setattr(running, "MAX_MISSED_HEARTBEATS", 15)
    campaign = made(tmp_path, spread(count=20), chunk=4)
    stopped: list[int] = []

    def progress(done, total):
        if done and not stopped:
            stopped.append(
                max(
                    p
                    for p in children(os.getpid())
                    if b"spawn_main" in Path(f"/proc/{p}/cmdline").read_bytes()
                )
            )
            os.kill(stopped[0], signal.SIGSTOP)

    with local(2) as backend:
        compute_missing(campaign, backend, progress=progress)
    assert stopped
    assert not alive(stopped[0])
    assert merge(campaign).done == 40


@pytest.mark.long
@pytest.mark.skipif(not hasattr(signal, "SIGSTOP"), reason="no process can be stopped")
def test_a_worker_that_hangs_ends_calls_with_a_sentence(monkeypatch):
    monkeypatch.setattr(running, "POLL_INTERVAL", 0.2)
    monkeypatch.setattr(running, "MAX_MISSED_HEARTBEATS", 15)
    with (
        running.parallel_calls(workers=2) as calls,
        pytest.raises(MicrovibError, match="was ended"),
    ):
        calls(signal.raise_signal, [(signal.SIGSTOP,)])


@pytest.mark.skipif(not hasattr(signal, "pthread_sigmask"), reason="there are no masks of signals")
def test_workers_leave_ctrl_c_to_the_coordinator_from_their_first_moment_on():
    """Twice: held back while they start, ignored then, which is all that there is on Windows."""
    with local(1) as backend:
        executor = backend.executor()
        assert (
            signal.SIGINT in executor.submit(signal.pthread_sigmask, signal.SIG_BLOCK, ()).result()
        )
        assert executor.submit(signal.getsignal, signal.SIGINT).result() == signal.SIG_IGN
    assert signal.SIGINT not in signal.pthread_sigmask(signal.SIG_BLOCK, ())


@pytest.fixture(scope="module")
def calm(tmp_path_factory) -> list[bytes]:
    """Chunks of a run that nothing happened to."""
    campaign = made(tmp_path_factory.mktemp("calm"), spread(count=30), "calm", 4)
    compute_missing(campaign, Fragile())
    return bytes_of(campaign)


@pytest.mark.skipif(not Path("/proc/self/task").is_dir(), reason="needs /proc")
@pytest.mark.parametrize(
    "what",
    [
        "interrupt",
        pytest.param("worker", marks=pytest.mark.long),
        *map(at_a_release, ("coordinator", "group")),
    ],
)
def test_whatever_is_killed_nothing_is_lost_and_nothing_twice(tmp_path, calm, what):
    """Kill in the middle, resume, and compare with a run that nothing happened to."""
    campaign = made(tmp_path, spread(count=30), "killed", 4)
    process = microvib("run", campaign.folder, "--workers", 2, start_new_session=True)
    wait_for(lambda: len(campaign.done()) >= 2)
    workers = children(process.pid)
    if what == "worker":
        os.kill(max(workers), signal.SIGKILL)
    elif what == "coordinator":
        process.kill()
    elif what == "group":
        os.killpg(process.pid, signal.SIGKILL)
    else:
        os.killpg(process.pid, signal.SIGINT)
    out, err = process.communicate(timeout=240)
    wait_for(
        lambda: not any(alive(pid) for pid in workers)
    )  # no worker goes on without its coordinator
    if what == "worker":
        assert process.returncode == 0, err
        assert "60 of 60 cases computed, 0 of them failed" in out
    else:
        assert campaign.missing()
    if what == "interrupt":
        assert process.returncode == 130
        assert "Interrupted; computed cases are kept" in err
        assert "Traceback" not in err
    kept = {k: campaign.file(k).stat().st_mtime_ns for k in campaign.done()}
    compute_missing(open_campaign(campaign.folder), Fragile())
    assert bytes_of(campaign) == calm
    assert all(
        campaign.file(k).stat().st_mtime_ns == when for k, when in kept.items()
    )  # not computed twice


@pytest.mark.release
def test_slurm_shards_are_a_job_array_that_can_be_resumed(tmp_path, monkeypatch):
    """A stand-in for sbatch runs the first of two shards, as if the second had been cancelled; then there is one left."""
    tools = tmp_path / "bin"
    tools.mkdir()
    sbatch = '#!/bin/sh\nfor k in ${RUN_SHARDS}; do SLURM_ARRAY_TASK_ID=$k sh "$2" >> "$2.log" 2>&1 || exit 1; done\necho 17\n'
    for name, text in (
        ("sbatch", sbatch),
        ("squeue", "#!/bin/sh\necho invalid job id >&2; exit 1\n"),
    ):
        (tools / name).write_text(text)
        (tools / name).chmod((tools / name).stat().st_mode | stat.S_IXUSR)
    monkeypatch.setenv("PATH", f"{tools}:{os.environ['PATH']}")
    monkeypatch.setenv("RUN_SHARDS", "0")
    undisturbed, campaign = (
        made(tmp_path, spread(), "undisturbed", 4),
        made(tmp_path, spread(), "jobs", 4),
    )
    compute_missing(undisturbed, Fragile())
    for left in (1, 0):
        done = commands.microvib(
            "campaign",
            "resume",
            str(campaign.folder),
            "--on",
            "slurm",
            "--workers",
            "2",
            cwd=tmp_path,
        )
        assert done.exit_code == 0, done.stderr
        assert "Submitted job 17" in done.stdout
        assert len(campaign.missing()) == left
    assert bytes_of(campaign) == bytes_of(undisturbed)
    assert json.loads((campaign.folder / "slurm.json").read_text())["job"] == "17"


def slurm_answers() -> bool:
    try:
        return subprocess.run(["sinfo", "-h"], capture_output=True, timeout=10).returncode == 0
    except (OSError, subprocess.TimeoutExpired):
        return False


def test_a_slurm_job_cancelled_in_the_middle_is_resumed(tmp_path):
    if not slurm_answers():
        pytest.skip("no Slurm answers here")
    sized = spread(
        count=100, set=SHORT | {"record.duration": "20 s"}
    )  # long enough to be cancelled
    calm, campaign = made(tmp_path, sized, "calm", 8), made(tmp_path, sized, "jobs", 8)
    compute_missing(calm, Fragile())

    def job() -> str:
        return json.loads((campaign.folder / "slurm.json").read_text())["job"]

    out, err = microvib("run", campaign.folder, "--on", "slurm", "--workers", 2).communicate(
        timeout=240
    )
    assert "Submitted job" in out, err
    wait_for(lambda: len(campaign.done()) >= 2)
    with pytest.raises(
        MicrovibError, match=r"its Slurm job \d+ has .*; wait for it, or scancel it"
    ):
        submit(campaign, 2)
    subprocess.run(["scancel", job()], check=True)
    wait_for(
        lambda: (
            not subprocess.run(["squeue", "-h", "-j", job()], capture_output=True).stdout.strip()
        )
    )
    assert campaign.missing()
    kept = {k: campaign.file(k).stat().st_mtime_ns for k in campaign.done()}
    out, err = microvib("resume", campaign.folder, "--on", "slurm", "--workers", 2).communicate(
        timeout=240
    )
    assert "Submitted job" in out, err
    wait_for(lambda: not campaign.missing())
    assert bytes_of(campaign) == bytes_of(calm)
    assert all(campaign.file(k).stat().st_mtime_ns == when for k, when in kept.items())
