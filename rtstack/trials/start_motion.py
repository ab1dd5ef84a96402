"""The way of both arms to where a trial begins: whether one is needed, and whether it may be gone.

What a cell description knows is looked at: pads stay clear of table, floor, object and each other, links of the table
and the other arm. The arms follow the way under torque, with the judge (rtstack.trials.run).
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import atan2

import numpy as np
from numpy.typing import NDArray

from hal.base.arrays import Array
from hal.cell import Cell
from hal.displacement import Displacement
from hal.limits import CONTROL_PERIOD_S
from hal.tracker import ObjectPose
from rtstack.control.controller import ObservedArm
from rtstack.control.joint_law import JointLaw
from rtstack.control.parameters import FrictionParameters
from rtstack.control.records import POINT
from rtstack.control.tick import ArmController
from rtstack.loop.end import End
from rtstack.loop.watchdogs import Watchdog, WatchdogTrip
from rtstack.model.cell_description import CellDescription, ObjectDescription, StartMotionLimits
from rtstack.model.clearance import ARM_DISTANCE_M, Clearance
from rtstack.model.rotation import log_so3
from rtstack.safety.guided import reaching, standing
from rtstack.safety.limits import CONTROL_PAD_SPEED_FRACTION, PairLimits
from rtstack.samples import Level
from rtstack.trials.assembly import arm_controllers, cell_parameters
from rtstack.trials.errors import TrialError
from rtstack.trials.sight import check_place, object_before
from rtstack.trials.tightening import limits_of_arms

REFUSED = "on its way to the start pose"  # how a WayRefused begins
CLEAR_OF_TABLE_M = 0.005  # at home the pads are 10 mm above it
CLEAR_OF_OBJECT_M = 0.01
CLEAR_OF_EACH_OTHER_M = 0.05
DIP_M = 0.001  # a straight way in the joints is none in space
LOOKS = 60  # along the way
NEWTON_STEPS = 20
# A pad is no faster, m/s: at 0.16 one met a table 30 mm higher than the file says with 86 N before the judge's stop
SLOW_M_S = 0.1
SETTLE_S = 0.3  # the arms come to rest at the end of the way
REACH_M = 0.01  # a straight way in the joints is none in space
MOVED_RAD = 0.02  # further from where the way began an arm was moved after it had been looked at
_EXACT = 1e-8  # m and rad
# s(x) = 10 x^3 - 15 x^4 + 6 x^5 over x = 0..1 has its largest slope at 1/2, its largest curvature at 1/2 -+ sqrt(3)/6
_STEEPEST, _MOST_CURVED = 15.0 / 8.0, 10.0 / np.sqrt(3.0)


@dataclass(frozen=True, slots=True)
class JointPath:
    """A straight way in joint space for all arms, from rest to rest, arriving together. start, goal (arms, 7): rad."""

    start: Array
    goal: Array
    duration_s: float

    @classmethod
    def between(cls, start: Array, goal: Array, limits: StartMotionLimits) -> "JointPath":
        """Return the quickest way between two postures (arms, 7) on which no joint exceeds the limit."""
        furthest = float(np.abs(goal - start).max())
        duration_s = max(
            _STEEPEST * furthest / limits.speed_rad_s, np.sqrt(_MOST_CURVED * furthest / limits.acceleration_rad_s2)
        )
        return cls(np.array(start), np.array(goal), float(duration_s))

    def at(self, t_s: float) -> Array:
        """Return the posture (arms, 7), rad, at a time since the start: a quintic, held before and after."""
        x = min(max(t_s / self.duration_s, 0.0), 1.0) if self.duration_s > 0.0 else 1.0
        return self.start + (10.0 - 15.0 * x + 6.0 * x * x) * x**3 * (self.goal - self.start)


class WayRefused(TrialError):
    """The straight way of the joints to the start leads too near to something; nothing has moved."""


@dataclass(frozen=True, slots=True)
class StartMotion:
    """A way that may be gone."""

    path: JointPath
    limits: StartMotionLimits

    def laws(
        self, arms: Sequence[ArmController], friction: Sequence[FrictionParameters], now: Array
    ) -> tuple[list[JointLaw], float]:
        """Return the law of each arm from `now` (arms, 7), rad, to the start, and how long they lead, s. Raises
        TrialError where the arms are not where the way began."""
        if np.abs(now - self.path.start).max() > MOVED_RAD:
            raise TrialError("an arm was moved before its way to the start began: give the command again")
        path = JointPath.between(now, self.path.goal, self.limits)
        path = replace(path, duration_s=max(path.duration_s, self.path.duration_s))
        t_s = np.arange(max(2, round(path.duration_s / CONTROL_PERIOD_S) + 1)) * CONTROL_PERIOD_S
        q = np.array([path.at(t) for t in t_s.tolist()])
        dq = np.gradient(q, CONTROL_PERIOD_S, axis=0)
        return [JointLaw(arm, q[:, k], dq[:, k], friction[k]) for k, arm in enumerate(arms)], path.duration_s + SETTLE_S

    @property
    def summary(self) -> str:
        """What happens, for the log."""
        furthest = np.abs(self.path.goal - self.path.start).max()
        return f"to the start pose in {self.path.duration_s:.1f} s, at most {furthest:.2f} rad a joint"


def _pad_speed(path: JointPath, arms: Sequence[ArmController]) -> float:
    """Return the largest speed of a pad along a way, m/s. arms: not those of a run, whose observers would see it."""
    t_s = np.linspace(0.0, path.duration_s, LOOKS)
    q = np.array([path.at(t) for t in t_s.tolist()])
    dq = np.gradient(q, t_s, axis=0)
    return max(
        float(np.linalg.norm(arm.observed_at(q[i, k], dq[i, k])["twist"][:3]))
        for i in range(LOOKS) for k, arm in enumerate(arms)
    )  # fmt: skip


class MeasuredPoints(Watchdog):
    """A point source whose points are where the arms are, and a watchdog that ends it after so many seconds."""

    def __init__(self, seconds: float | None, arms: int) -> None:
        self.points = np.zeros((arms, 1), POINT)
        self._most_ns = None if seconds is None else round(seconds * 1e9)
        self._began_ns: int | None = None
        self._now_ns = 0

    def listen(self) -> None:
        """See rtstack.loop.session.PointSource: nothing is asked for."""

    def step(self, side: int, arm: ObservedArm) -> None:
        """Write where the arm is: there is nothing to be followed."""
        point, work = self.points[side], arm.workspace[0]
        point["position"], point["rotation"] = work["position"], work["rotation"]
        if side == 0:
            self._now_ns = int(arm.sample["t_ns"][0])
            self._began_ns = self._now_ns if self._began_ns is None else self._began_ns

    def trip(self) -> WatchdogTrip | None:
        if self._most_ns is None or self._began_ns is None or self._now_ns - self._began_ns < self._most_ns:
            return None
        return WatchdogTrip(End.COMPLETED, "", Level.INFO)


def start_motion(
    cell: Cell, description: CellDescription, object_name: str,
    displacement: Displacement | float = 0.0, start: NDArray[np.void] | None = None,
) -> StartMotion | None:  # fmt: skip
    """Return the way of an open cell's arms to the points start (arms,) of POINT, by default to the description's home.
    None where they are there already, or begin there anyway (the plant in this process). Raises TrialError where the
    way must not be gone, or the tracker sees the object elsewhere than where it was put; HardwareError."""
    if cell.link is None:
        return None
    limits = description.start_motion
    thing, put, place = description.objects.get(object_name), Displacement.of(displacement), None
    if thing is not None:  # standing on the table
        place = np.array([put.x_m, put.y_m, description.table.top_z + thing.size[2] / 2.0])
    pose = None if place is None else object_before(cell, description)
    if place is not None and pose is not None and pose.record["seen"][0]:
        check_place(description, pose, place)
        place = pose.position
    arms = arm_controllers(description, cell_parameters(description))
    homes = description.home
    sides, goal = description.sides, homes
    if start is not None:
        goal = np.stack([posture(*each) for each in zip(arms, homes, start, sides, strict=True)])
    now = np.stack([arm.read().q.copy() for arm in cell.arms])
    distance = np.abs(goal - now)
    if distance.max() <= limits.tolerance_rad:
        return None
    arm, joint = np.unravel_index(distance.argmax(), distance.shape)
    if distance[arm, joint] > limits.longest_rad:
        if len(now) == 2 and np.abs(goal[::-1] - now).max() <= limits.longest_rad:
            raise TrialError("each arm stands where the other one starts: are their addresses or cables exchanged?")
        raise TrialError(
            f"joint {joint + 1} of the {sides[arm]} arm is {distance[arm, joint]:.2f} rad from the start pose, more "
            f"than longest_rad = {limits.longest_rad:g} under [start_motion]: bring the arm nearer by hand"
        )
    ranges = [model.limits for model in description.robots]
    outside = (goal < [each.q_lower for each in ranges]) | (goal > [each.q_upper for each in ranges])
    if outside.any():
        arm, joint = np.argwhere(outside)[0]
        raise TrialError(f"the start pose is beyond the limit of joint {joint + 1} of the {sides[arm]} arm")
    path = JointPath.between(now, goal, limits)
    fastest = min(SLOW_M_S, *(CONTROL_PAD_SPEED_FRACTION * own.ee_speed_max for own in limits_of_arms(description)))
    path = replace(path, duration_s=path.duration_s * max(1.0, _pad_speed(path, arms) / fastest))
    box = None if thing is None or place is None else _box(place, put.yaw_rad, thing)
    _look_along(path, arms, description, box)
    return StartMotion(path, limits)


def posture(arm: ArmController, near: Array, point: np.void, side: str) -> Array:
    """Return the joint positions (7,), rad, near `near` with the pose and the posture xi of a point, by Newton's
    method. Raises TrialError where there are none."""
    joint = arm.parameters.posture_joint
    q, local, error, jacobian = near.copy(), np.zeros(3), np.zeros(7), np.zeros((7, 7))
    jacobian[6, joint] = 1.0
    for _ in range(NEWTON_STEPS):
        work = arm.observed_at(q)
        log_so3(np.ascontiguousarray(work["rotation"].T @ point["rotation"]), local)
        error[:3] = point["position"] - work["position"]
        error[3:6] = work["rotation"] @ local
        error[6] = point["xi"] - q[joint]
        if np.abs(error).max() < _EXACT:
            return q
        jacobian[:6] = work["J"]
        q = q + np.linalg.lstsq(jacobian, error, rcond=None)[0]
    raise TrialError(f"the recording begins where the {side} arm of this cell cannot be: record one on this cell")


def _pad_box(arm: ArmController, q: Array, size: tuple[float, float, float]) -> Array:
    """Return the lowest and the highest corner (2, 3), m, of the pad's upright bounding box in the world."""
    work = arm.observed_at(q)
    half = np.array(size) / 2.0
    centre = work["position"] - work["rotation"][:, 2] * half[2]
    reach = np.abs(work["rotation"]) @ half
    return np.stack([centre - reach, centre + reach])


def _box(centre: Array, yaw_rad: float, thing: ObjectDescription) -> Array:
    """Return the lowest and the highest corner (2, 3), m, of its upright bounding box."""
    c, s = abs(np.cos(yaw_rad)), abs(np.sin(yaw_rad))
    half = np.array([[c, s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]]) @ np.array(thing.size) / 2.0
    return np.stack([centre - half, centre + half])


def led_in(limits: PairLimits, description: CellDescription, q: Array) -> PairLimits:
    """Return the judge's limits on a way that begins at q (arms, 7), rad: the vendor's is outside of most boxes."""
    return reaching(limits, standing(q, description.bases, description.tools, limits), REACH_M)


def _look_along(
    path: JointPath, arms: Sequence[ArmController], description: CellDescription, thing: Array | None
) -> None:
    """Raise TrialError where a pad or a link would come too near to something, or does not get clear of it."""
    least: dict[tuple[str, str], float] = {}

    def look(what: str, to: str, gap: float, clear: float, within: float = -DIP_M) -> None:
        begins = least.setdefault((what, to), min(clear, max(gap - DIP_M, within)))
        if gap < (clear if t_s == path.duration_s else begins):
            raise WayRefused(
                f"{REFUSED} {what} would come too near to {to}: "
                "bring the arms clear of it by hand, or take the object away"
            )

    table = description.table
    half = np.array(table.size_xy) / 2.0
    board = np.array([[*(np.array(table.centre_xy) - half), -1.0], [*(np.array(table.centre_xy) + half), table.top_z]])
    floor = np.array([[-9.0, -9.0, -1.0], [9.0, 9.0, 0.0]])
    clearance, limits = Clearance(description), led_in(limits_of_arms(description), description, path.start)
    for t_s in np.linspace(0.0, path.duration_s, LOOKS):
        q = path.at(float(t_s))
        boxes = [_pad_box(arm, own, pad.size) for arm, own, pad in zip(arms, q, description.pads, strict=True)]
        links, apart = clearance.at(list(q))
        for side, arm, limit in zip(description.sides, arms, limits, strict=True):
            face = arm.workspace["position"][0]
            if np.any(face < limit.ee_lower) or np.any(face > limit.ee_upper):
                raise WayRefused(
                    f"{REFUSED} the {side} pad would leave its box (ee_lower, ee_upper under [safety]): "
                    "bring the arms nearer by hand (rtstack guide)"
                )
        for side, box, link in zip(description.sides, boxes, links, strict=True):
            look(f"the {side} pad", "the table", min(_gap(box, board), _gap(box, floor)), CLEAR_OF_TABLE_M)
            look(f"a link of the {side} arm", "the table", link, CLEAR_OF_TABLE_M)
            if thing is not None:
                look(f"the {side} pad", "the object", _gap(box, thing), CLEAR_OF_OBJECT_M, -np.inf)  # it may be turned
        if len(boxes) == 2:
            look("the left pad", "the right one", _gap(boxes[0], boxes[1]), CLEAR_OF_EACH_OTHER_M)
            look("the left arm", "the right one", apart, ARM_DISTANCE_M)


def blocked_start(description: CellDescription, name: str, pose: ObjectPose) -> str:
    """Return in one line that an object stands where a pad starts; "" where it does not."""
    arms, thing = arm_controllers(description, cell_parameters(description)), description.objects[name]
    w, _, _, z = pose.orientation_wxyz.tolist()
    box = _box(pose.position, 2.0 * atan2(z, w), thing)
    for side, arm, q, pad in zip(description.sides, arms, description.home, description.pads, strict=True):
        if _gap(_pad_box(arm, q, pad.size), box) < CLEAR_OF_OBJECT_M:
            return f"{name} stands where the {side} pad starts: take it away"
    return ""


def rooms_mm(description: CellDescription) -> dict[str, list[list[int]]]:
    """Return by object its least and largest shift, mm: along x on the table and the pads, along y clear of them."""
    arms, table = arm_controllers(description, cell_parameters(description)), description.table
    pads = [arm.observed_at(q)["position"][1] for arm, q in zip(arms, description.home, strict=True)]
    lower, upper = np.array(table.centre_xy) + np.outer([-0.5, 0.5], table.size_xy)
    lower[1], upper[1] = max(lower[1], min(pads) + CLEAR_OF_OBJECT_M), min(upper[1], max(pads) - CLEAR_OF_OBJECT_M)
    halves = {name: np.array(thing.size[:2]) / 2.0 for name, thing in description.objects.items()}
    met = {name: np.outer([-1.0, 1.0], half * [1.0, np.inf]) for name, half in halves.items()}
    rooms = {name: np.clip([lower + half, upper - half], *met[name]) for name, half in halves.items()}
    return {name: (1e3 * room.T).astype(int).tolist() for name, room in rooms.items()}  # towards the object's place


def _gap(a: Array, b: Array) -> float:
    """Return how far two boxes are apart along the axis where they are furthest, m; negative where they overlap."""
    return float(np.maximum(a[0] - b[1], b[0] - a[1]).max())
