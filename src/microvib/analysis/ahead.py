"""Start of compilation before anything else is imported, which shortens the first run on a machine."""

from microvib.signals import tone_fit, tone_kernel
from microvib.solve import decimate, propagate


def start_compilation() -> None:
    """Have machine code of the largest unit made beside what comes first; units whose turn comes
    after it, while one waits.
    """
    propagate.code.begin(decimate.code, tone_kernel.code, tone_fit.code)
