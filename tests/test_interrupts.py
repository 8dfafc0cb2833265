"""Ctrl-C where threads or processes work: it ends what goes on, at once, and never leaves a lock taken."""

import os
import signal
import subprocess
import sys
import threading

import pytest

from microvib.studies.interrupts import any_done, check_interrupt, deferred_interrupts, result
from microvib.studies.workers import parallel_calls

posix = pytest.mark.skipif(
    os.name != "posix", reason="interrupts of one's own program are sent as signals"
)

INTERRUPTED_OFTEN = """
import random, signal
from microvib.studies.workers import parallel_calls

def quick(k):
    return k

random.seed(1)
ended = 0
for trial in range(150):
    try:
        with parallel_calls() as calls:
            signal.setitimer(signal.ITIMER_REAL, random.uniform(1e-3, 2e-2))
            calls(quick, [(k,) for k in range(3000)])
    except KeyboardInterrupt:
        ended += 1
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
print(ended)
"""


@posix
def test_work_that_is_interrupted_at_any_instant_ends():
    """An interrupt within the library's futures left a lock taken in a few of a hundred trials, and nothing ended any more."""
    program = (
        "import signal\nsignal.signal(signal.SIGALRM, lambda *_: signal.raise_signal(signal.SIGINT))"
        + INTERRUPTED_OFTEN
    )
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, timeout=60, check=False
    )
    assert done.returncode == 0, done.stderr
    assert int(done.stdout) > 50


@posix
def test_an_interrupt_is_held_until_it_is_looked_for():
    with deferred_interrupts(), deferred_interrupts():
        signal.raise_signal(signal.SIGINT)
        with pytest.raises(KeyboardInterrupt):
            check_interrupt()
        check_interrupt()
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler


@posix
def test_an_interrupt_after_the_last_look_is_not_lost():
    with pytest.raises(KeyboardInterrupt), deferred_interrupts():
        signal.raise_signal(signal.SIGINT)


@posix
def test_the_third_interrupt_in_a_row_is_not_held_back():
    """Whatever hangs, who presses Ctrl-C again and again is heard."""
    sent = []

    def press():
        for _ in range(5):
            sent.append(True)
            signal.raise_signal(signal.SIGINT)

    with pytest.raises(KeyboardInterrupt), deferred_interrupts():
        press()
    assert len(sent) == 3


def test_other_handlers_and_other_threads_are_left_alone():
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        with deferred_interrupts():
            assert signal.getsignal(signal.SIGINT) is signal.SIG_IGN
    finally:
        signal.signal(signal.SIGINT, before)
    seen = []

    def elsewhere():
        with deferred_interrupts():
            seen.append(signal.getsignal(signal.SIGINT))

    thread = threading.Thread(target=elsewhere)
    thread.start()
    thread.join()
    assert seen == [before]


def test_results_and_errors_come_back():
    with parallel_calls() as calls:
        assert calls(divmod, [(7, 2), (9, 4)]) == [(3, 1), (2, 1)]
        with pytest.raises(ZeroDivisionError):
            calls(divmod, [(1, 0)])


def test_waiting_goes_on_until_there_is_something():
    from concurrent.futures import Future

    future = Future()
    assert any_done([future]) == set()
    threading.Timer(0.05, future.set_result, (3,)).start()
    assert result(future) == 3


AT_AN_IMPORT = """
import signal, sys

class Interrupts:
    def find_spec(self, name, *rest):
        if name == NAME:
            signal.raise_signal(signal.SIGINT)

sys.meta_path.insert(0, Interrupts())
sys.argv = ["microvib", "show", "state-1"]
from microvib.cli.main import main
main()
"""


@posix
@pytest.mark.parametrize("name", ["shlex", "click.types", "microvib.cli.budget"])
def test_an_interrupt_before_a_command_has_begun_ends_it_without_a_word(name):
    done = subprocess.run(
        [sys.executable, "-c", f"NAME = {name!r}\n{AT_AN_IMPORT}"],
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )
    assert done.returncode == -signal.SIGINT
    assert (done.stdout, done.stderr) == ("", "")


@posix
def test_an_interrupt_within_a_command_is_a_sentence_wherever_it_comes():
    """Within an import of the command, and in a destructor, where Python itself would print a traceback and go on."""
    for name, where in (("microvib.io.scenario_file", ""), ("-", IN_A_DESTRUCTOR)):
        program = f"NAME = {name!r}\n{where}{AT_AN_IMPORT}"
        done = subprocess.run(
            [sys.executable, "-c", program], capture_output=True, text=True, timeout=60, check=False
        )
        assert done.returncode == 130
        assert done.stderr.strip() == "Interrupted; no file was left half-written."


IN_A_DESTRUCTOR = """
import signal, time
import microvib.io.scenario_file as files

class Dying:
    def __del__(self):
        signal.raise_signal(signal.SIGINT)

load = files.load_scenario

def loaded(*given):
    Dying()
    time.sleep(5.0)
    return load(*given)

files.load_scenario = loaded
"""


@posix
@pytest.mark.parametrize("ready", [False, True])
def test_a_coordinator_that_is_killed_leaves_nothing_on_the_terminal(ready):
    """Neither its workers, starting or at work, nor what clears away after them say anything; standard error ends with the last."""
    program = (
        "import os, signal\nfrom microvib.studies.workers import local\nif __name__ == '__main__':\n"
        "    with local(2) as backend:\n        pool = backend.executor()\n"
        f"        {'[f.result() for f in [pool.submit(os.getpid) for _ in range(4)]]' if ready else 'pass'}\n"
        "        [pool.submit(os.urandom, 1000) for _ in range(1000)]\n"
        "        os.kill(os.getpid(), signal.SIGKILL)\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, timeout=100, check=False
    )
    assert done.returncode == -signal.SIGKILL
    assert done.stderr == ""
