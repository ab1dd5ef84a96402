"""Robots at their addresses over the Franka Control Interface, and the tracker that watches their object."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import cast

from hal.base.realtime import obtainable
from hal.cell import Cell
from hal.clock_relation import ClockRelation
from hal.errors import ConnectionLost, HardwareError
from hal.extensions import ExtensionError, ExtensionPoint, blaming, require
from hal.fci import FciPair, ask_for_urdf, limits_in, open_pair
from hal.limits import CollisionBehaviour, OwnLimits
from hal.pad import Pad
from hal.tracker import ClosableTracker, TrackerRequest
from rtstack.cells.kinds import CellKind, CellRequest
from rtstack.cells.metal import check_boxes, check_measured, check_real_cell, on_this_machine
from rtstack.cells.robot_clock import RobotClock
from rtstack.model.cell_description import CellDescription
from rtstack.model.tracker_description import TrackerDescription
from rtstack.safety.limits import ForcePhase
from rtstack.trials.errors import TrialError
from rtstack.trials.tightening import check_models, difference_of_limits, limits_of_arms

Factory = Callable[[TrackerRequest], ClosableTracker]
TRACKERS = ExtensionPoint[Factory]("rtstack.trackers", "tracker", cast(type, Callable))


def fci_addresses(kind: str) -> dict[str, str]:
    """Return the arms' addresses by side, of fci:LEFT,RIGHT, or of one arm: fci:LEFT, fci:,RIGHT. Raises TrialError."""
    scheme, _, addresses = kind.partition(":")
    left, _, right = addresses.partition(",")
    given = {side: address for side, address in (("left", left), ("right", right)) if address}
    if scheme != "fci" or not given or "," in right:
        raise TrialError(f"cell {kind!r}: the robots' addresses are given as fci:LEFT,RIGHT; one arm's as fci:LEFT")
    if left == right:
        raise TrialError(f"cell {kind!r}: two arms have two addresses")
    return given


def _addresses(kind: str, description: CellDescription) -> tuple[str, ...]:
    """Return the address of each arm of a cell. Raises TrialError where they are of other arms than the cell's."""
    given = fci_addresses(kind)
    if tuple(given) != description.sides:
        has = " and ".join(f"a {side}" for side in description.sides)
        raise TrialError(f"cell {kind!r}: {description.name} has {has} arm: give the address of each, and of no other")
    return tuple(given.values())


def pad_tools(description: CellDescription) -> tuple[Pad | None, Pad | None]:
    """Return what the left and the right arm carry, as the robots are told of it, None where there is no arm."""
    pads = dict(zip(description.sides, description.pads, strict=True))
    return pads.get("left"), pads.get("right")


def approach_collisions(description: CellDescription) -> CollisionBehaviour:
    """Return the thresholds with which all arms are connected to: nothing is to be met until a run says so."""
    return limits_of_arms(description)[0].collisions(ForcePhase.APPROACH)  # a cell's table is one for all arms


def _check(argument: str, description: CellDescription, cell_file: Path | None) -> None:
    check_real_cell(_addresses(f"fci:{argument}", description), description, cell_file)
    _tracker(description.tracker)


def _measured(argument: str, description: CellDescription, cell_file: Path | None) -> None:
    check_measured(_addresses(f"fci:{argument}", description), description, cell_file)


def _simulated(argument: str, description: CellDescription) -> bool:
    """A real arm must never be reported as simulated: only arms on this machine can be."""
    return description.simulated and all(map(on_this_machine, fci_addresses(f"fci:{argument}").values()))


def _open(request: CellRequest) -> Cell:
    if request.faults is not None:
        raise TrialError(f"cell {request.kind!r}: only a simulated robot has scripted faults: rtstack sim --faults")
    addresses = _addresses(request.kind, request.description)
    check_real_cell(addresses, request.description, request.cell_file)
    if not request.led:
        check_measured(addresses, request.description, request.cell_file)
    check_boxes(request.description, request.cell_file, request.led)
    robot_clock = ClockRelation()
    tracker = _listen(request.description.tracker, request.object_name, robot_clock)
    try:
        own, said = own_limits(addresses)
        check_models(request.description, own)
        real = request.description.enforce_realtime and not all(map(on_this_machine, addresses))
        if real and obtainable().scheduler != "fifo":
            raise TrialError(
                "this user gets no real-time scheduling (SCHED_FIFO): `sudo rtstack host-setup --user NAME`, then log "
                "in again; for commissioning: enforce_realtime = false in the cell's file"
            )
        given = fci_addresses(request.kind)
        pair = open_pair(
            given.get("left"), given.get("right"), pad_tools(request.description),
            approach_collisions(request.description), enforce_realtime=real,
        )  # fmt: skip
    except BaseException:
        tracker.close()
        raise
    warnings = [said or difference_of_limits(request.description, own)]
    if not request.description.simulated and request.description.joint_friction is None:
        warnings.append("friction is compensated with the model's numbers, not these arms': rtstack identify-friction")
    clock = RobotClock(pair, robot_clock)
    link = ClosingLink(pair, clock.wait, tracker.close)
    return Cell(
        request.kind, pair.left, pair.right, tracker, link, own_clocks=True, sensors=(clock,),
        own_limits=own, cycles=pair.cycles, warning="; ".join(filter(None, warnings)),
    )  # fmt: skip


def own_limits(addresses: Sequence[str]) -> tuple[tuple[OwnLimits, ...] | None, str]:
    """Return what the robots say of their limits, or None and why they do not: a robot that takes no client says so
    itself, when it is connected to. Raises ConnectionLost."""
    try:
        return tuple(limits_in(ask_for_urdf(address), f"the arm at {address}") for address in addresses), ""
    except ConnectionLost:  # libfranka would wait for longer, with Python's lock
        raise
    except HardwareError as error:
        return None, f"the limits of the cell's file are not compared with the robots': {error}"


def _tracker(tracker: TrackerDescription) -> Factory:
    try:
        return TRACKERS.load(tracker.kind)
    except ExtensionError as error:
        raise TrialError(f"{error}; see [tracker] kind in the cell's file") from None


def _listen(tracker: TrackerDescription, object_name: str, robot_clock: ClockRelation) -> ClosableTracker:
    """Listen for the object's poses. Raises HardwareError with one line, TrialError for an unknown tracker or body."""
    factory = _tracker(tracker)
    try:
        with blaming(f"the tracker {tracker.kind} cannot be opened", factory, error=TrialError):
            require(made := factory(tracker.request(object_name, robot_clock)), "latest", "close")
            if not hasattr(shown := made.latest(), "record"):
                raise TypeError(f"latest returned a {type(shown).__name__}, not a hal.tracker.ObjectPose")
            return made
    except ValueError as error:
        raise TrialError(f"the tracker of the cell's file: {error}") from None
    except (OSError, OverflowError) as error:
        reason = error.strerror if isinstance(error, OSError) else str(error)
        raise HardwareError(
            f"cannot listen for the object's poses at {tracker.address}: {reason}; end the program that listens "
            "there, or give the cell's file another address under [tracker]"
        ) from None


class ClosingLink:
    """The link to the arms of a pair. wait: for their next state; close_rest: closes what ends with them."""

    def __init__(self, pair: FciPair, wait: Callable[[], int], close_rest: Callable[[], None]) -> None:
        self._pair, self._close_rest = pair, close_rest
        self.start, self.wait = pair.start, wait
        self.stop, self.recover = pair.stop, pair.recover
        self.set_collisions = pair.set_collisions

    def close(self) -> None:
        self._pair.close()
        self._close_rest()


fci = CellKind(_open, _check, _simulated, _measured)
