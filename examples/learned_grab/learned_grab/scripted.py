"""Policies that know their way from the beginning: a replay, and the scripted operator who sees the object."""

from dataclasses import replace

import numpy as np

from hal.base.arrays import Array
from hal.displacement import Displacement
from rtstack.cells import load_description
from rtstack.model.arm_model import ArmModel
from rtstack.model.rotation import exp_so3, quaternion_from_rotation
from rtstack.references.demonstration import Grab, grab, scripted_targets
from rtstack.teleoperation.policy import Chunk, Observation

OBJECT = "rice_box"
STEP_S = 0.05
POSES = 10  # of a chunk
_AFTER_S = 0.3  # until the filter has brought the arms to the last pose
_PERIOD_S = 1e-3


class Way:
    """A policy that goes along poses (n, 2, 7), one a ms since it began to lead, whatever it sees."""

    def __init__(self, poses: Array) -> None:
        self._poses = poses

    def act(self, observation: Observation) -> Chunk | None:
        """See Policy."""
        if observation.t_s > len(self._poses) * _PERIOD_S + _AFTER_S:
            return Chunk(finished=True)
        t_s = observation.t_s + STEP_S * np.arange(1, POSES + 1)
        return Chunk(STEP_S, self._poses[np.minimum((t_s / _PERIOD_S).astype(int), len(self._poses) - 1)])

    def close(self) -> None:
        """See Policy."""


def script(variation: int) -> Grab:
    """Return a demonstration's numbers: those of a variation, but for its times, which a policy is to learn."""
    plain, varied = Grab(), grab(variation)
    return replace(plain, speed_y=varied.speed_y, speed_z=varied.speed_z, squeeze=varied.squeeze, lift=varied.lift,
                   height=varied.height)  # fmt: skip


def release_s() -> float:
    """Return when the scripted hands begin to open, s."""
    plain = Grab()
    return plain.rest_s + plain.approach_s + plain.lift_s + plain.carry_s + plain.lower_s


def scripted_way(variation: int, displacement: Displacement) -> Way:
    """Return the scripted operator, who sees where the object stands: the way turns and shifts with it from the first
    motion on."""
    description, _ = load_description(None)
    models = ArmModel(description.left, description.pad), ArmModel(description.right, description.pad)
    homes = description.home
    targets = scripted_targets(
        script(variation), models, homes, description.objects[OBJECT], description.table, _PERIOD_S
    )
    plain = Grab()
    t_s = np.arange(targets.shape[1]) * _PERIOD_S
    share = np.clip((t_s - plain.rest_s) / (plain.approach_s - plain.steady_s), 0.0, 1.0)
    share = share**3 * (10.0 - 15.0 * share + 6.0 * share**2)  # at rest at both ends
    poses, turn = np.zeros((len(t_s), 2, 7)), np.zeros((3, 3))
    for k, part in enumerate(share):
        exp_so3(np.array([0.0, 0.0, part * displacement.yaw_rad]), 1.0, turn)
        for side in (0, 1):
            place = turn @ targets["position"][side, k]
            poses[k, side, :3] = place + part * np.array([displacement.x_m, displacement.y_m, 0.0])
            quaternion_from_rotation(turn @ targets["rotation"][side, k], poses[k, side, 3:])
    return Way(poses)


def scripted_grab(argument: str) -> Way:
    """Offer the scripted operator as a policy. argument: the object's shift along y, mm, "" for none."""
    return scripted_way(0, Displacement.given(float(argument or 0.0)))
