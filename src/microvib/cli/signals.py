"""Ctrl-C before a command has begun and after it has ended: the process ends at once, and nothing
is printed.

In between it is a KeyboardInterrupt, which ``streams`` makes a sentence of.
"""

from __future__ import annotations

import _thread
import signal
import sys
import threading
from typing import Any


def exit_on_interrupt() -> bool:
    """Let Ctrl-C end the process itself; whether it did anything else, in this thread, before."""
    if signal.getsignal(signal.SIGINT) is not signal.default_int_handler:
        return False  # ignored, as in what runs in the background, or somebody else's
    try:
        signal.signal(signal.SIGINT, signal.SIG_DFL)
    except ValueError:  # not in the main thread
        return False
    return True


def restore_keyboard_interrupt() -> None:
    """Let Ctrl-C be a KeyboardInterrupt."""
    signal.signal(signal.SIGINT, signal.default_int_handler)


def redeliver_unraisable_interrupts() -> None:
    """Deliver once more an interrupt that came where Python can only report it, as in a destructor
    or in a callback of C code.
    """
    before = sys.unraisablehook

    def hook(unraisable: Any) -> None:
        if issubclass(unraisable.exc_type, KeyboardInterrupt):
            # From another thread, a moment later: here it would be reported once more.
            again = threading.Timer(0.01, _thread.interrupt_main)
            again.daemon = True
            again.start()
        else:
            before(unraisable)

    sys.unraisablehook = hook
