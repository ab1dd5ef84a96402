"""A simulated cell that was built otherwise than its scene and the cell's file say: `[built]` of a profile."""

from dataclasses import dataclass, replace

import numpy as np

from hal.arrays import Array
from hal.tracker import ObjectPose, ObjectTracker
from sim_robot.plant_parameters import Vector3
from sim_robot.scene import ArmPlacement, Scene

_NONE: Vector3 = (0.0, 0.0, 0.0)
_INVERSE = np.array([1.0, -1.0, -1.0, -1.0])  # of a unit quaternion


@dataclass(frozen=True, slots=True)
class Built:
    """Displacements mm along, and turns (rotation vectors) deg about the world's axes, of the bases about themselves.

    swapped: what answers as the left arm is the right one. tracker_mm, tracker_deg: of the tracker's frame in the
    world, which a robot on the wire gives its poses in; pivot_mm: of the body that it follows, in the object's frame.
    """

    left_mm: Vector3 = _NONE
    left_deg: Vector3 = _NONE
    right_mm: Vector3 = _NONE
    right_deg: Vector3 = _NONE
    tracker_mm: Vector3 = _NONE
    tracker_deg: Vector3 = _NONE
    pivot_mm: Vector3 = _NONE
    swapped: bool = False

    @property
    def moved_tracker(self) -> bool:
        """Whether the tracker's frame is not the world's, or the body not in the object's middle."""
        return any((*self.tracker_mm, *self.tracker_deg, *self.pivot_mm))

    def to_tracker(self, place: Array) -> Array:
        """Return a place of the world (3,), m, in the tracker's frame."""
        turn = _quaternion(self.tracker_deg)
        return _turned(turn * _INVERSE, place - 1e-3 * np.array(self.tracker_mm))

    def body(self, position: Array, wxyz: Array) -> Array:
        """Return where the body that the tracker follows is in the world, (3,) m, for an object's pose there."""
        return position + _turned(wxyz, 1e-3 * np.array(self.pivot_mm))

    def tracker(self, tracker: ObjectTracker) -> ObjectTracker:
        """Return what a client is given: the tracker's poses in its own frame."""
        return MovedTracker(tracker, self) if self.moved_tracker else tracker

    def scene(self, scene: Scene) -> Scene:
        """Return the scene as it was built; the scene itself where nothing is wrong."""
        if not any((*self.left_mm, *self.left_deg, *self.right_mm, *self.right_deg, self.swapped)):
            return scene
        left = _moved(scene.left, self.left_mm, self.left_deg)
        right = _moved(scene.right, self.right_mm, self.right_deg)
        return replace(scene, left=right, right=left) if self.swapped else replace(scene, left=left, right=right)


def _moved(arm: ArmPlacement, mm: Vector3, deg: Vector3) -> ArmPlacement:
    x, y, z = (np.array(arm.T_world_base_position) + 1e-3 * np.array(mm)).tolist()
    wxyz = _product(_quaternion(deg), np.array(arm.T_world_base_wxyz))
    w, a, b, c = (wxyz / np.linalg.norm(wxyz)).tolist()
    return replace(arm, T_world_base_position=(x, y, z), T_world_base_wxyz=(w, a, b, c))


class MovedTracker:
    """An ObjectTracker that gives another one's poses in its own frame."""

    def __init__(self, tracker: ObjectTracker, built: Built) -> None:
        self._tracker, self._given, self._built = tracker, ObjectPose.empty(), built
        self._back = _quaternion(built.tracker_deg) * _INVERSE

    def latest(self) -> ObjectPose:
        """See ObjectTracker."""
        pose, given = self._tracker.latest(), self._given
        given.record[:] = pose.record
        given.position[:] = self._built.to_tracker(self._built.body(pose.position, pose.orientation_wxyz))
        given.orientation_wxyz[:] = _product(self._back, pose.orientation_wxyz)
        return given


def _quaternion(deg: Vector3) -> Array:
    """Return the quaternion wxyz (4,) of a rotation vector, deg."""
    half = np.radians(deg) / 2.0
    angle = float(np.linalg.norm(half))
    return np.array([np.cos(angle), *(half * np.sinc(angle / np.pi))])


def _turned(wxyz: Array, v: Array) -> Array:
    """Return v (3,) turned by a unit quaternion."""
    return _product(_product(wxyz, np.array([0.0, *v])), wxyz * _INVERSE)[1:]


def _product(p: Array, q: Array) -> Array:
    return np.array([p[0] * q[0] - p[1:] @ q[1:], *(p[0] * q[1:] + q[0] * p[1:] + np.cross(p[1:], q[1:]))])
