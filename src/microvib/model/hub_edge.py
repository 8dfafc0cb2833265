"""Frequency up to which a flexible hub is known, where modes are left out of it.

Residual modes keep the static compliance of what is left out. Below the first mode that is left out
they stand for it, less and less as it comes near; above, the hub has resonances that its model has
not. On the reference hub with 10 to 120 modes, responses of the payload to loads at the root and at
the wheels are right within 2.5 % of the largest up to 0.7 of the first mode that is left out
(``pytest tests/test_reference_hub.py``); for other hubs that is assumed.
"""

from __future__ import annotations

from dataclasses import dataclass

from microvib.model.scenario import Scenario

KNOWN_PART = 0.7
"""Part of the frequency of the first mode that is left out up to which responses are known."""
CLOSE_PART, CLOSE_ERROR = 0.25, 0.07
"""Part of that frequency from which responses are uncertain by the error, over their own amplitude (assumed: up to
6 % were seen beside a resonance at a third of it, on a hub of 72 modes of which six were kept)."""
LEAST_DAMPING = 1e-3
"""Damping ratio of modes that are left out at least (assumed)."""


@dataclass(frozen=True)
class HubEdge:
    """Where a hub's model ends, and what may be above."""

    left_out_from: float
    """Frequency of the first mode that is left out [Hz]."""
    factor: float
    """Times that a line above may be as large as the model has it (assumed): what a mode amplifies
    by that is damped like the least damped of those that are known, beside the model's own.
    """

    @property
    def frequency(self) -> float:
        """Frequency up to which the hub is known [Hz]."""
        return KNOWN_PART * self.left_out_from

    @property
    def close(self) -> float:
        """Frequency from which it is known less well [Hz]."""
        return CLOSE_PART * self.left_out_from

    @property
    def why(self) -> str:
        """Why what is above is not known, with what to do, as a clause."""
        return (
            f"what is above {self.frequency:.4g} Hz, for the hub's modes from {self.left_out_from:.4g} Hz on"
            " are left out (a larger spacecraft.hub.count, or more modes in its table)"
        )


def hub_edge(scenario: Scenario | None) -> HubEdge | None:
    """Where the model of a scenario's hub ends; None where no mode is known to be left out."""
    if scenario is None or scenario.spacecraft is None:
        return None
    hub = scenario.spacecraft.hub
    if hub.left_out_from is None:
        return None
    least = min((mode.damping for mode in hub.modes), default=LEAST_DAMPING)
    return HubEdge(hub.left_out_from, 1.0 + 0.5 / max(least, LEAST_DAMPING))
