"""Whether the shafts of a drive stick in a motion, so that friction holds them at times."""

from __future__ import annotations

from typing import Protocol

import numpy as np

from microvib.model.drive_states import MAY_STICK, Sticking


class Shafts(Protocol):
    """A motion or a steady state, with its channels."""

    def __getitem__(self, name: str) -> np.ndarray:
        """Samples of a channel, (n,)."""
        ...


def sticking_of(motion: Shafts | None, *, repeats: bool = False) -> Sticking:
    """Which shafts of a drive stick at any time of a motion, or turn back.

    Where a rate changes its sign it is zero for an instant, and friction may hold a shaft there.
    Where no motion was kept, both may. ``repeats`` says that it is a steady motion.
    """
    if motion is None:
        return MAY_STICK
    return Sticking(
        _sticks(motion["stuck_rotor"], motion["omega_m"]),
        _sticks(motion["stuck_output"], motion["omega_l"]),
        float(np.min(np.abs(motion["omega_m"]))),
        float(np.min(np.abs(motion["omega_l"]))),
        repeats,
    )


def _sticks(stuck: np.ndarray, rate: np.ndarray) -> bool:
    return bool(np.any(stuck > 0.0) or np.min(rate) <= 0.0 <= np.max(rate))
