"""What can go wrong at the boundary. Every message says what to do."""


class HardwareError(Exception):
    """Base class of everything that the hardware layer raises."""


class ConnectionLost(HardwareError):
    """The arm does not answer any more, or never did."""


class CommandRejected(HardwareError):
    """The arm refuses to move: a reflex is active, or a command broke a limit.

    errors: the vendor's names of the active errors.
    """

    def __init__(self, message: str, errors: tuple[str, ...] = ()) -> None:
        super().__init__(message)
        self.errors = errors


class RecoveryRefused(HardwareError):
    """The cause of the last reflex persists, so that the arm cannot be armed again."""


class UnknownObject(HardwareError):
    """The cell has no object of this name."""


class ObjectOutOfReach(HardwareError):
    """The object cannot be placed where it was asked for."""
