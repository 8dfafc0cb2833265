"""Ctrl-C where threads and processes work: it comes between waits, never inside one.

An interrupt inside the standard library's futures may leave one of their locks taken for ever, and
the program then waits for it.
"""

from __future__ import annotations

import os
import signal
import threading
from collections.abc import Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from contextlib import contextmanager
from typing import Any, TypeVar

POLL_INTERVAL = 0.2
"""Seconds after which an interrupt is seen."""
MAX_PENDING_INTERRUPTS = 3
"""Interrupts that wait to be seen, of which the last is not held back: something hangs."""

T = TypeVar("T")
_pending: list[int] = []


@contextmanager
def deferred_interrupts() -> Iterator[None]:
    """In this context Ctrl-C ends what goes on where ``check_interrupt``, ``any_done`` or
    ``result`` is called, and nowhere else.

    Nothing changes in a thread that is not the main one, or where Ctrl-C means something else
    already.
    """
    main = threading.current_thread() is threading.main_thread()
    if not main or signal.getsignal(signal.SIGINT) is not signal.default_int_handler:
        yield
        return
    _pending.clear()
    signal.signal(signal.SIGINT, _note)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, signal.default_int_handler)
    check_interrupt()


@contextmanager
def threads(count: int | None = None) -> Iterator[ThreadPoolExecutor]:
    """So many threads, one per core by default; an interrupt waits for what is under way and not
    for what has not begun.
    """
    with deferred_interrupts():
        pool = ThreadPoolExecutor(count or os.cpu_count() or 1)
        try:
            yield pool
        finally:
            pool.shutdown(cancel_futures=True)


def _note(number: int, frame: Any) -> None:
    _pending.append(number)
    if len(_pending) >= MAX_PENDING_INTERRUPTS:
        raise KeyboardInterrupt


def check_interrupt() -> None:
    """KeyboardInterrupt if Ctrl-C came meanwhile."""
    if _pending and threading.current_thread() is threading.main_thread():
        _pending.clear()
        raise KeyboardInterrupt


def any_done(futures: Iterable[Future[T]]) -> set[Future[T]]:
    """Futures that are done; where none is, those that are after a short wait."""
    check_interrupt()
    done = wait(futures, timeout=POLL_INTERVAL, return_when=FIRST_COMPLETED).done
    check_interrupt()
    return done


def result(future: Future[T]) -> T:
    """Wait for a future; return its result, or raise its exception."""
    while not any_done([future]):
        pass
    return future.result()
