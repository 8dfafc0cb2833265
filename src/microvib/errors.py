"""What can go wrong, as sentences for the person who can mend it."""


class MicrovibError(Exception):
    """Base of all errors that are meant for the user; the text is one clear sentence."""


class ScenarioError(MicrovibError):
    """A scenario that cannot be read or is not valid: says which key, what was found and what is allowed."""


class SimulationError(MicrovibError):
    """A simulation that could not be carried to its end."""


class SynchronismLost(SimulationError):
    """The motor no longer follows its command; ``time`` [s] is when the rotor was half an electrical turn off."""

    def __init__(self, message: str, time: float) -> None:
        super().__init__(message)
        self.time = time


class OutputError(MicrovibError):
    """A result that could not be written; nothing was overwritten."""
