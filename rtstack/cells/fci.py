"""Robots at two addresses over the Franka Control Interface, and the tracker that watches their object."""

from collections.abc import Callable
from pathlib import Path
from typing import cast

from hal.cell import Cell
from hal.clock_relation import ClockRelation
from hal.collisions import CollisionBehaviour
from hal.errors import HardwareError
from hal.extensions import ExtensionError, ExtensionPoint
from hal.fci import FciPair, Tool, ask_for_urdf, limits_in, open_pair
from hal.limits import OwnLimits
from hal.tracker import ClosableTracker, TrackerRequest
from rtstack.cells.kinds import CellKind, CellRequest
from rtstack.cells.metal import check_boxes, check_measured, check_real_cell, on_this_machine
from rtstack.cells.robot_clock import RobotClock
from rtstack.model.cell_description import CellDescription, TrackerDescription
from rtstack.safety.limits import ForcePhase
from rtstack.trials.errors import TrialError
from rtstack.trials.tightening import check_models, difference_of_limits, limits_of_arms

TRACKERS = ExtensionPoint[Callable[[TrackerRequest], ClosableTracker]](
    "rtstack.trackers", "tracker", cast(type, Callable)
)


def fci_addresses(kind: str) -> tuple[str, str]:
    """Return LEFT and RIGHT of fci:LEFT,RIGHT. Raises TrialError."""
    scheme, _, addresses = kind.partition(":")
    left, _, right = addresses.partition(",")
    if scheme != "fci" or not left or not right or "," in right:
        raise TrialError(f"cell {kind!r}: the robots' addresses are given as fci:LEFT,RIGHT")
    if left == right:
        raise TrialError(f"cell {kind!r}: two arms have two addresses")
    return left, right


def pad_tools(description: CellDescription) -> tuple[Tool, Tool]:
    """Return what the left and the right arm carry, as the robots are told of it."""
    left, right = map(Tool.of, description.pads)
    return left, right


def approach_collisions(description: CellDescription) -> CollisionBehaviour:
    """Return the thresholds with which both arms are connected to: nothing is to be met until a run says so."""
    return limits_of_arms(description)[0].collisions(ForcePhase.APPROACH)  # a cell's table is one for both arms


def _check(argument: str, description: CellDescription, cell_file: Path | None) -> None:
    check_real_cell(fci_addresses(f"fci:{argument}"), description, cell_file)
    _tracker(description.tracker)


def _measured(argument: str, description: CellDescription, cell_file: Path | None) -> None:
    check_measured(fci_addresses(f"fci:{argument}"), description, cell_file)


def _simulated(argument: str, description: CellDescription) -> bool:
    """A real arm must never be reported as simulated: only arms on this machine can be."""
    return description.simulated and all(map(on_this_machine, argument.split(",")))


def _open(request: CellRequest) -> Cell:
    if request.faults is not None:
        raise TrialError(f"cell {request.kind!r}: only a simulated robot has scripted faults: rtstack sim --faults")
    left, right = fci_addresses(request.kind)
    check_real_cell((left, right), request.description, request.cell_file)
    if not request.led:
        check_measured((left, right), request.description, request.cell_file)
    check_boxes(request.description)
    own, said = _own_limits((left, right))
    check_models(request.description, own)
    robot_clock = ClockRelation()
    tracker = _listen(request.description.tracker, request.object_name, robot_clock)
    try:
        real = request.description.enforce_realtime and not (on_this_machine(left) and on_this_machine(right))
        pair = open_pair(
            left, right, pad_tools(request.description), approach_collisions(request.description),
            enforce_realtime=real,
        )  # fmt: skip
    except BaseException:
        tracker.close()
        raise
    clock = RobotClock(pair, robot_clock)
    return Cell(
        request.kind, pair.left, pair.right, tracker, _TrackedLink(pair, tracker, clock), own_clocks=True,
        sensors=(clock,), own_limits=own, cycles=pair.cycles,
        warning=said or difference_of_limits(request.description, own),
    )  # fmt: skip


def _own_limits(addresses: tuple[str, str]) -> tuple[tuple[OwnLimits, OwnLimits] | None, str]:
    """Return what both robots say of their limits, or None and why they do not: a robot that takes no client says so
    itself, when it is connected to."""
    try:
        left, right = (limits_in(ask_for_urdf(address), f"the arm at {address}") for address in addresses)
    except HardwareError as error:
        return None, f"the limits of the cell's file are not compared with the robots': {error}"
    return (left, right), ""


def _tracker(tracker: TrackerDescription) -> Callable[[TrackerRequest], ClosableTracker]:
    try:
        return TRACKERS.load(tracker.kind)
    except ExtensionError as error:
        raise TrialError(f"{error}; see [tracker] kind in the cell's file") from None


def _listen(tracker: TrackerDescription, object_name: str, robot_clock: ClockRelation) -> ClosableTracker:
    """Listen for the object's poses. Raises HardwareError with one line, TrialError for an unknown tracker or body."""
    factory = _tracker(tracker)
    try:
        return factory(tracker.request(object_name, robot_clock))
    except ValueError as error:
        raise TrialError(f"the tracker of the cell's file: {error}") from None
    except (OSError, OverflowError) as error:
        reason = error.strerror if isinstance(error, OSError) else str(error)
        raise HardwareError(
            f"cannot listen for the object's poses at {tracker.address}: {reason}; end the program that listens "
            "there, or give the cell's file another address under [tracker]"
        ) from None


class _TrackedLink:
    """Both arms at their addresses, and the tracker that is listened to."""

    def __init__(self, pair: FciPair, tracker: ClosableTracker, clock: RobotClock) -> None:
        self._pair = pair
        self._tracker = tracker
        self.start, self.wait, self.move = pair.start, clock.wait, pair.move
        self.stop, self.recover = pair.stop, pair.recover
        self.set_collisions = pair.set_collisions

    def close(self) -> None:
        """Disconnect, and stop listening."""
        self._pair.close()
        self._tracker.close()


fci = CellKind(_open, _check, _simulated, _measured)
