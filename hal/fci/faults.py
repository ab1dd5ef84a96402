"""pylibfranka's exceptions as hal's errors: one line, with the arm's name and address, and the vendor's error names."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager

import pylibfranka as franka

from hal.errors import CommandRejected, ConnectionLost, HardwareError
from hal.robot_errors import ROBOT_ERRORS
from hal.state import NEEDS_PERSON
from hal.wire import VERSION

# pylibfranka's exceptions have no base class of their own but RuntimeError; ValueError is what it says of NaN and Inf
VENDOR = (franka.FrankaException, RuntimeError, ValueError)
_INCOMPATIBLE = "Incompatible library version"  # pylibfranka has no class of its own for it


def names_in(text: str) -> tuple[str, ...]:
    """Return the vendor's error names in a message, in the order of the wire.

    libfranka spells one in two ways: tau_J_range_violation, and tau_j_range_violation in its list.
    """
    words = set("".join(c if c.isalnum() or c == "_" else " " for c in text.lower()).split())
    return tuple(name for name in ROBOT_ERRORS if name in words)


def as_hardware_error(error: Exception, arm: str) -> HardwareError:
    """Return hal's error for one of pylibfranka's. arm: what the arm is called, with its address."""
    text = " ".join(str(error).removeprefix("libfranka: ").removeprefix("libfranka robot: ").split())
    if isinstance(error, franka.NetworkException):
        return ConnectionLost(f"{arm} does not answer: {text}; check power, cable and FCI mode in Desk")
    names = names_in(text)
    if isinstance(error, franka.ControlException):
        remedy = "recover it first" if names else "start again"
        return CommandRejected(f"{arm} left torque control: {text}; {remedy}", names)
    if isinstance(error, franka.CommandException | franka.InvalidOperationException | ValueError):
        return CommandRejected(f"{arm} refused: {text.rstrip('.!')}" + _remedy(text), names)
    if text.startswith(_INCOMPATIBLE):
        text = f"{text.partition('. Please')[0]}: rtstack needs {VERSION}, of a Franka Research 3 with system 5.9 or "
        text += "newer: update it on Desk; for older boxes and Pandas see docs/howto/protocol.md"
    if isinstance(error, franka.RealtimeException):
        text += " Run `rtstack host-setup --kernel rt`; for commissioning: enforce_realtime = false in the cell's file"
    return HardwareError(f"{arm}: {text}")


def _remedy(text: str) -> str:
    """Return what to do about a refusal that a person has to clear away."""
    if "safety function" in text:
        return "; on its Desk page remove the rules of Watchman, or do the self-test that is due"
    modes = [mode for mode in NEEDS_PERSON if f'("{mode.name.replace("_", " ")}")' in text.upper()]
    return f"; {NEEDS_PERSON[modes[0]]}" if modes else ""


@contextmanager
def vendor_errors(
    called: str, explained: Callable[[Exception, str], HardwareError] = as_hardware_error
) -> Iterator[None]:
    """Raise hal's errors, as `explained` returns them, for pylibfranka's. Outside the loop: it costs too much there."""
    try:
        yield
    except VENDOR as error:
        raise explained(error, called) from None
