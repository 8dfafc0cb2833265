"""How Matplotlib is imported: a command draws into files alone, and leaves out what only its users
in Python need.
"""

from __future__ import annotations

import sys
from types import ModuleType

_AXES_3D = "mpl_toolkits.mplot3d"


def import_matplotlib_lean() -> None:
    """Import Matplotlib later without axes in space and without the documentation that it writes
    for each of its classes.

    These take a third of its import's time. It counts for the whole process, and is therefore for a
    command in a process of its own. Nothing happens where Matplotlib is there already.
    """
    if "matplotlib" not in sys.modules and _AXES_3D not in sys.modules:
        none = ModuleType(_AXES_3D)
        none.__dict__["Axes3D"] = None  # by which Matplotlib tells that it has none
        sys.modules[_AXES_3D] = none


def import_artists() -> None:
    """Import what all of Matplotlib's classes come from, before any other part of it."""
    alone = getattr(sys.modules.get(_AXES_3D), "Axes3D", _AXES_3D) is None
    if not alone or "matplotlib.artist" in sys.modules:
        return
    from matplotlib import artist

    artist.kwdoc = lambda artist: ""
    if hasattr(
        artist.Artist, "_update_set_signature_and_docstring"
    ):  # of ``set`` of each class, for help alone
        artist.Artist._update_set_signature_and_docstring = classmethod(lambda cls: None)
