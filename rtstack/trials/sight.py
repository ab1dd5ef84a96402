"""Where the tracker sees the object before the arms move, and whether what it sends can be believed."""

import time
from collections.abc import Iterator
from math import degrees

import numpy as np

from hal.base.arrays import Array
from hal.cell import LEFT, RIGHT, Cell
from hal.tracker import ObjectPose
from rtstack.model.cell_description import CellDescription
from rtstack.model.rotation import rotation_from_quaternion
from rtstack.model.tracker_description import NO_TRACKER
from rtstack.trials.errors import TrialError

LONGEST_LOOK_S = 1.0  # a camera has 20 pictures by then, and a clock of the tracker's own is known
_ENOUGH = 20  # poses one after the other: noise changes a bit of each
_FEW = 4  # in LONGEST_LOOK_S, of the slowest camera
_LYING_RAD = 0.8  # from upright: half way to its side
_Y_UP = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])  # as hal.tracker.TrackerFrames
# what a stream with a wrong setting makes of a place in the tracker's frame with z up, and how it is taken back
_MISTAKES = (
    ("it sends mm, and m are expected", 1e-3 * np.eye(3)),
    ('it streams y up: write up = "y" under [tracker], or have it stream z up', _Y_UP),
    ('it streams z up: write up = "z" under [tracker], or have it stream y up', _Y_UP.T),
    ("its x and y are exchanged", np.eye(3)[[1, 0, 2]]),
    *((f"its {axis} is mirrored: its frame is left-handed", np.diag(1.0 - 2.0 * np.eye(3)[k]))
      for k, axis in enumerate("xyz")),
)  # fmt: skip


def _looks(cell: Cell) -> Iterator[ObjectPose]:
    """Yield what the tracker shows while the arms' states are read, for LONGEST_LOOK_S. Raises HardwareError."""
    end_s = time.monotonic() + LONGEST_LOOK_S
    while time.monotonic() < end_s and cell.link is not None:
        ready = cell.link.wait()
        for bit, arm in zip((LEFT, RIGHT), cell.arms, strict=False):
            if ready & bit:
                arm.read()
        if not hasattr(shown := cell.tracker.latest(), "record"):
            kind = type(shown).__name__
            raise TrialError(f"latest of the tracker returned a {kind}, not a hal.tracker.ObjectPose: mend the tracker")
        yield shown


def object_before(cell: Cell, description: CellDescription) -> ObjectPose:
    """Return where the tracker sees the object, `seen` 0 where it does not, before the loop of an open cell runs. The
    arms' states, without which a tracker's times mean nothing, are read meanwhile, for LONGEST_LOOK_S at most. Raises
    HardwareError."""
    pose = cell.tracker.latest()
    if cell.own_clocks and description.tracker.kind != NO_TRACKER and not pose.record["seen"][0]:
        for pose in _looks(cell):
            if pose.record["seen"][0]:
                break
    return pose


def trouble_of(cell: Cell, description: CellDescription, object_name: str) -> str:
    """Return in one line why the tracker cannot be read, or shows nothing new of the object, "" where it can.
    object_name: "" for a run about none: only what can be told without it. Raises HardwareError."""
    tracker = description.tracker
    if tracker.kind == NO_TRACKER or not cell.own_clocks:
        return ""
    about, times, poses = object_name in description.objects, set[int](), set[bytes]()
    of_robot = tracker.kind == "udp" and tracker.clock == "robot"  # a simulated one, whose plant may stand still
    for pose in _looks(cell) if about or tracker.kind != "udp" else ():
        if pose.record["seen"][0]:
            times.add(pose.t_ns)
            poses.add(pose.position.tobytes() + pose.orientation_wxyz.tobytes())
        if len(times) > _ENOUGH and (of_robot or len(poses) > 1):
            return ""
    said = ""
    if len(times) < _FEW or not about:
        said = getattr(cell.tracker, "trouble", lambda _about: "")(about)
    if not about or said:
        pass
    elif not times:
        said = f"shows no fresh pose of {object_name}: start it, and look at its body, its markers and the firewall"
    elif len(times) == 1:
        said = f"has shown no new pose of {object_name} for {LONGEST_LOOK_S:g} s: its stream or its times stand still"
    elif len(poses) == 1 and len(times) >= _FEW and not of_robot:
        said = f"shows the same pose to the last bit in {len(times)} frames: it is frozen, start it again"
    return f"the tracker {tracker.kind} at {tracker.address} {said}" if said else ""


def check_sight(cell: Cell, description: CellDescription, object_name: str) -> None:
    """Raise TrialError where the tracker cannot be believed: see `trouble_of`. Raises HardwareError."""
    if said := trouble_of(cell, description, object_name):
        raise TrialError(f'{said}; without a tracker write kind = "{NO_TRACKER}" under [tracker]')


def check_place(description: CellDescription, pose: ObjectPose, place: Array) -> None:
    """Raise TrialError where a pose is not that of an object that stands upright in its place, (3,) m."""
    tracker, away = description.tracker, pose.position - place
    x, y, z = (round(1e3 * metres) for metres in away.tolist())
    up = rotation_from_quaternion(pose.orientation_wxyz)[2, 2]
    lean = float(np.arccos(np.clip(up, -1.0, 1.0)))
    if np.linalg.norm(away) <= tracker.place_tolerance_m and lean <= _LYING_RAD:
        return
    frame, origin = rotation_from_quaternion(np.array(tracker.orientation_wxyz)), np.array(tracker.position)
    seen = frame.T @ (pose.position - origin)
    as_if = [
        f"; as if {mistake}" for mistake, back in _MISTAKES
        if np.linalg.norm(origin + frame @ back @ seen - place) <= tracker.place_tolerance_m < np.linalg.norm(away)
    ]  # fmt: skip
    if lean > _LYING_RAD and not as_if:
        raise TrialError(
            f"the tracker shows the object turned by {degrees(lean):.0f} degrees from upright: set it up, or correct "
            "up and the orientations under [tracker]"
        )
    raise TrialError(
        f"the object is not in its place but x {x:+d}, y {y:+d}, z {z:+d} mm from it{''.join(as_if[:1])}: put it back, "
        "or correct [tracker] (a simulated one: start the simulated robot again)"
    )
