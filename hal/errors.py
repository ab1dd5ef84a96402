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


class NoGripper(HardwareError):
    """No hand is mounted on the arm."""


class GripperFailed(HardwareError):
    """The gripper refuses a command: it was never homed, or a value is out of its range."""


class GripperAborted(GripperFailed):
    """A gripper's command was ended by stop, or by another command."""
