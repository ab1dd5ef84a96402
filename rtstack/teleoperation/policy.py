"""Policies that lead the arms as an operator does: what they see, what they answer, and those that packages offer.

A policy acts under a lease of its own, which the operator who has control gives and whose clutch takes it back.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, Protocol, cast

import numpy as np
from numpy.typing import NDArray

from hal.base.arrays import Array
from hal.extensions import ExtensionPoint, blame, defined_at
from rtstack.cameras.newest import Picture
from rtstack.loop.mailbox import CHUNK, CHUNK_POSES
from rtstack.model.arm_model import ArmModel
from rtstack.model.rotation import quaternion_from_rotation
from rtstack.samples import SIDES
from rtstack.teleoperation.reach import UNIT_TOLERANCE

SLOWEST_HZ, FASTEST_HZ = 10, 50  # of the observations
LONGEST_STEP_S = 0.5  # between two poses of a chunk


@dataclass(frozen=True, slots=True)
class Observation:
    """What a policy is shown, all of one instant. Arrays are of the cell's arms, left before right, in the world.

    number: counts from 1; t_ns: the robot's time of the first arm's state; t_s: since the policy began to lead. q, dq
    (arms, 7): rad, rad/s; pose (arms, 7): of the middle of the pad's face, m, wxyz; pose_ref (arms, 7): what is asked
    of it, after the filter; force (arms, 3): N, on the pad; object_pose (7,): as the tracker saw it last, None before.
    pictures: the newest of each of the cell's cameras that was taken at t_ns or before, by the camera's name.
    """

    number: int
    t_ns: int
    t_s: float
    q: Array
    dq: Array
    pose: Array
    pose_ref: Array
    force: Array
    object_pose: Array | None
    pictures: Mapping[str, Picture] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class Chunk:
    """What a policy answers: where the pads, or the joints, are to be; pose k (k + 1) step_s after the observation.

    poses (n, arms, 7): m, wxyz, in the world; or joints (n, arms, 7): rad. 1 to CHUNK_POSES of them. finished: the
    policy is done and gives the lease back; the rest is not looked at then.
    """

    step_s: float = 0.02
    poses: Array | None = None
    joints: Array | None = None
    finished: bool = False

    def problem(self, arms: int) -> str | None:
        """Return in one line why it is no answer, None where it is one. arms: how many the cell has."""
        given = [each for each in (self.poses, self.joints) if each is not None]
        if len(given) != 1:
            return "a chunk has poses, or joints"
        values = np.asarray(given[0])
        if values.ndim != 3 or values.shape[1:] != (arms, 7) or not 1 <= len(values) <= CHUNK_POSES:
            return f"a chunk is (n, {arms}, 7) with n from 1 to {CHUNK_POSES}, not {values.shape}"
        if not np.isfinite(values).all():
            return "a number of the chunk is not finite"
        if self.poses is not None and (np.abs(np.linalg.norm(values[..., 3:], axis=-1) - 1.0) > UNIT_TOLERANCE).any():
            return "a quaternion of the chunk is not of length one"
        if not 1e-3 <= self.step_s <= LONGEST_STEP_S:
            return f"step_s is from 0.001 to {LONGEST_STEP_S}"
        return None

    def record(self, models: Mapping[str, ArmModel], posture_joint: int) -> NDArray[np.void]:
        """Return it as (1,) of CHUNK, without job, lease and times. models: of each arm by its side."""
        chunk = np.zeros(1, CHUNK)
        chunk["xi"], chunk["pose"][..., 3] = np.nan, 1.0
        rows = [SIDES.index(side) for side in models]
        values = np.asarray(self.poses if self.poses is not None else self.joints, float)
        chunk["count"], chunk["step_ns"] = len(values), round(self.step_s * 1e9)
        if self.joints is None:
            chunk["pose"][0, : len(values), rows] = values.swapaxes(0, 1)
            return chunk
        for arm, (row, model) in enumerate(zip(rows, models.values(), strict=True)):
            for k, q in enumerate(values[:, arm]):
                chunk["pose"][0, k, row] = pad_pose(model, q)
            chunk["xi"][0, : len(values), row] = values[:, arm, posture_joint]
        return chunk


class Policy(Protocol):
    """An open policy. `act` is called once an observation, outside the real-time loop, in one thread."""

    def act(self, observation: Observation) -> Chunk | None:
        """Return what the arms are to do, None for no answer. 0.3 s without an answer stop the arms."""

    def close(self) -> None:
        """Release what it holds. Never raises."""


# each a callable (argument: str) -> Policy; argument: what stands behind NAME: on the command line, "" for nothing
POLICIES = ExtensionPoint[Callable[[str], Policy]]("rtstack.policies", "policy", cast(Any, Callable), ours=False)


def answer_of(policy: Policy, observation: Observation, arms: int) -> tuple[Chunk | None, str]:
    """Return what a policy answers, None for nothing, and in one line why it cannot be followed, "" where it can. arms:
    how many the cell has. Raises what the policy raises.
    """
    chunk = policy.act(observation)
    if chunk is not None and not isinstance(chunk, Chunk):
        raise TypeError(f"act returned a {type(chunk).__name__}, not a Chunk")
    problem = None if chunk is None or chunk.finished else chunk.problem(arms)
    return chunk, "" if problem is None else " ".join((problem, blame(defined_at(policy.act))))


def pad_pose(model: ArmModel, q: Array) -> Array:
    """Return the pose (7,) of the middle of the pad's face in the world at q (7,), m and wxyz."""
    model.update(np.ascontiguousarray(q, float), np.zeros(7))
    pose = np.zeros(7)
    pose[:3] = model.p7 + model.R7 @ model.face
    quaternion_from_rotation(np.ascontiguousarray(model.R7 @ model.R_joint_ee), pose[3:])
    return pose
