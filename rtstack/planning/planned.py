"""A planned motion: the recording that no demonstration has made, and what was computed on the way."""

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from hal.base.arrays import Array
from rtstack.impact_map import Impact, ImpactMap
from rtstack.model.arm_model import ArmModel
from rtstack.model.cell_description import CellDescription
from rtstack.planning.joints import JointMotion, feedforward, held_back, joint_motion, repaid
from rtstack.planning.path import ArmPath, points_along
from rtstack.planning.request import GrabPlan, PushPlan
from rtstack.references.motion import Motion
from rtstack.references.planned import planned_reference
from rtstack.references.recording import MEASURED, Recording
from rtstack.references.spreading import ExtendedReference
from rtstack.samples import SIDES
from rtstack.trials.assembly import cell_parameters

# times (n,) s and accelerations of the arms (arms, n, 3) -> forces of the pads on the object, N (arms, n, 3)
Forces = Callable[[Array, Array], Array]


@dataclass(frozen=True, slots=True)
class Timing:
    """Of a plan, s: the nominal impact, the release, the end."""

    touch_s: float
    release_s: float
    end_s: float


@dataclass(frozen=True, slots=True)
class PlannedMotion:
    """A plan that may be run. recording: ante-impact points before the nominal impact, post-impact ones from it on;
    joints: of each arm at the same ticks; acceleration (arms, n, 7): of the pads along x, y and z m/s^2, about them and
    of the posture's joint rad/s^2; force (arms, n, 3) N: what the pads are to exert; map: of the impact; velocities
    (arms, 3) m/s of the pads after it, scaled; object_position (n, 3) m: where the object's centre is meant to be;
    sides: of the arms."""

    request: GrabPlan | PushPlan
    recording: Recording
    joints: tuple[JointMotion, ...]
    acceleration: Array
    force: Array
    map: ImpactMap
    velocities: Array
    object_position: Array
    sides: tuple[str, ...] = SIDES

    @property
    def reference(self) -> ExtendedReference:
        """The references of a trial: each goes on at constant velocity beyond the nominal impact."""
        return planned_reference(self.recording)

    def torque(self, arm: int, ticks: slice = slice(None)) -> Array:
        """Return what the joints of an arm, by its number, are to exert at these ticks, (n, 7) Nm, object included."""
        motion = self.joints[arm]
        moving = np.einsum("nij,nj->ni", motion.M[ticks], motion.ddq[ticks]) + motion.bias[ticks]
        return moving + np.einsum("nij,ni->nj", motion.J[ticks, :3], self.force[arm][ticks])

    def as_dict(self) -> dict[str, Any]:
        """Return parameters and predictions as JSON-ready values."""
        arms = [name for name in self.map.problem.names if name in self.sides]
        recording, result = self.recording, self.map
        return {
            "motion": str(recording.motion),
            "object": recording.object,
            "parameters": {key: getattr(value, "value", value) for key, value in asdict(self.request).items()},
            "nominal_impact_s": recording.impact_s,
            "release_s": recording.release * recording.period_s,
            "duration_s": recording.points.shape[1] * recording.period_s,
            "velocity_before": {side: result.twist_before(side)[:3].tolist() for side in arms},
            "velocity_after": {side: result.twist(side)[:3].tolist() for side in arms},
            "velocity_after_single_step": {side: result.twist(side, result.single_step)[:3].tolist() for side in arms},
            "velocity_planned": {side: self.velocities[self.sides.index(side)].tolist() for side in arms},
            "converged": _impact_dict(result, result.converged),
            "single_step": _impact_dict(result, result.single_step),
        }


def assemble(
    description: CellDescription, request: GrabPlan | PushPlan, object_name: str, impact: ImpactMap, *,
    ante: Sequence[ArmPath], post: Sequence[ArmPath], timing: Timing, forces: Forces, rotations: Array,
    object_start: Array,
) -> PlannedMotion:  # fmt: skip
    """Put a plan together: points, joints, feedforward. Raises PlanError where an arm cannot follow. rotations (arms,
    3, 3): of the pads that the paths turn from; object_start (3,): where the object stands, m."""
    control = cell_parameters(description).control
    period_s, posture_joint = control.period_s, control.posture_joint
    motion = Motion.GRAB if isinstance(request, GrabPlan) else Motion.HIT_AND_PUSH
    k = round(timing.touch_s / period_s)
    t_s = np.arange(round(timing.end_s / period_s)) * period_s
    pieces, accelerations = [], []
    for arm in range(len(description.arms)):
        before, a = points_along(ante[arm], rotations[arm], t_s[:k], period_s)
        after, b = points_along(post[arm], rotations[arm], t_s[k:], period_s)
        pieces.append((before, after))
        accelerations.append(np.concatenate([a, b]))
    acceleration = np.array(accelerations)
    force = np.zeros((len(pieces), len(t_s), 3))
    force[:, k:] = forces(t_s[k:], acceleration[:, k:, :3])
    load = np.zeros((len(pieces), 6))
    points, joints = [], []
    for arm, (side, mounting) in enumerate(description.mountings.items()):
        model = ArmModel(mounting, description.pad)
        moved = joint_motion(model, np.array(mounting.home), pieces[arm], period_s, posture_joint, side)
        joints.append(moved)
        whole = np.concatenate(pieces[arm])
        torque = np.einsum("nij,ni->nj", moved.J[:, :3], force[arm])
        wrench, _ = feedforward(moved, acceleration[arm], torque, posture_joint)
        load[arm] = wrench[k] - wrench[k - 1]
        # it steps at the impact: what the torque rate holds back of it (5 ms of a 2.2 kg box's weight, 1 % of its
        # momentum) comes right after it
        lacking = held_back(load[arm] @ moved.J[k], mounting.robot.limits.tau_rate_max, period_s)
        torque[k:] += repaid(lacking, len(t_s) - k, period_s)
        whole["wrench_ff"], whole["beta"] = feedforward(moved, acceleration[arm], torque, posture_joint)
        points.append(whole)
    whole = np.array(points)
    felt = np.zeros(whole.shape, MEASURED)
    felt["q"], felt["dq"], felt["force"] = [j.q for j in joints], [j.dq for j in joints], -force
    release = round(timing.release_s / period_s)
    recording = Recording(whole, period_s, k, release, object_name, motion, load, measured=felt)
    carriers = [arm for arm, side in enumerate(description.sides) if side in impact.problem.names]
    held = whole["position"][carriers].mean(axis=0)
    where = object_start + held - held[k]
    where[:k] = object_start
    where[recording.release :] = where[recording.release]
    velocities = whole["twist"][:, k, :3]
    return PlannedMotion(
        request, recording, tuple(joints), acceleration, force, impact, velocities, where, description.sides
    )


def _impact_dict(result: ImpactMap, impact: Impact) -> dict[str, Any]:
    contacts = {}
    for k, (contact, rows) in enumerate(zip(result.problem.contacts, result.problem.points, strict=True)):
        contacts[" on ".join(contact.between)] = {
            "normal_impulse_ns": float(impact.impulses[rows, 2].sum()),
            "pressing_ns": float(impact.pressing_ns[k]),
        }
    return {"status": str(impact.status), "detail": impact.detail, "contacts": contacts}
