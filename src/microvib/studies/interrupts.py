"""Ctrl-C where threads and processes work: it comes between waits, never inside one.

An interrupt inside the standard library's futures may leave one of their locks taken for ever, and the program then waits for it.
"""

from __future__ import annotations

import os
import signal
import threading
from collections.abc import Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from contextlib import contextmanager
from typing import Any, TypeVar

TICK = 0.2
"""Seconds after which an interrupt is seen."""
IMPATIENT = 3
"""Interrupts that wait to be seen, of which the last is not held back: something hangs."""

T = TypeVar("T")
_came: list[int] = []


@contextmanager
def held() -> Iterator[None]:
    """In this context Ctrl-C ends what goes on where ``look``, ``any_done`` or ``result`` is called, and nowhere else.

    Nothing changes in a thread that is not the main one, or where Ctrl-C means something else already.
    """
    main = threading.current_thread() is threading.main_thread()
    if not main or signal.getsignal(signal.SIGINT) is not signal.default_int_handler:
        yield
        return
    _came.clear()
    signal.signal(signal.SIGINT, _note)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, signal.default_int_handler)
    look()


@contextmanager
def threads(count: int | None = None) -> Iterator[ThreadPoolExecutor]:
    """So many threads, one per core by default; an interrupt waits for what is under way and not for what has not begun."""
    with held():
        pool = ThreadPoolExecutor(count or os.cpu_count() or 1)
        try:
            yield pool
        finally:
            pool.shutdown(cancel_futures=True)


def _note(number: int, frame: Any) -> None:
    _came.append(number)
    if len(_came) >= IMPATIENT:
        raise KeyboardInterrupt


def look() -> None:
    """KeyboardInterrupt if Ctrl-C came meanwhile."""
    if _came and threading.current_thread() is threading.main_thread():
        _came.clear()
        raise KeyboardInterrupt


def any_done(futures: Iterable[Future[T]]) -> set[Future[T]]:
    """Those of the futures that are done; where none is, those that are after a short wait."""
    look()
    done = wait(futures, timeout=TICK, return_when=FIRST_COMPLETED).done
    look()
    return done


def result(future: Future[T]) -> T:
    """What a future returns, or raises."""
    while not any_done([future]):
        pass
    return future.result()
