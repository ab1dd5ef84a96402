"""Motion capture of the object, as far as it is simulated: a rate and noise."""

from math import sqrt

import numpy as np

from hal.compilation import bound, compiled
from hal.tracker import ObjectPose
from sim_robot.arm_description import JOINTS
from sim_robot.plant import Plant
from sim_robot.plant_parameters import TrackerParameters

BLOCK = 64  # frames of noise drawn at a time


@compiled
def _see(pose, all_draws, position_noise, half_angle_noise, records, k, t_ns):
    """Write the pose (7,), position and wxyz, with noise into records[0]. all_draws[k] (6,) are standard normal."""
    draws, record = all_draws[k], records[0]
    record.t_ns = t_ns
    record.seen = 1
    w, x, y, z = pose[3], pose[4], pose[5], pose[6]
    a, b, c = half_angle_noise * draws[3], half_angle_noise * draws[4], half_angle_noise * draws[5]
    # a small rotation (1, e) along the world's axes, from the left, then normalised
    turned = (
        w - a * x - b * y - c * z,
        x + a * w + b * z - c * y,
        y + b * w + c * x - a * z,
        z + c * w + a * y - b * x,
    )
    norm = sqrt(turned[0] ** 2 + turned[1] ** 2 + turned[2] ** 2 + turned[3] ** 2)
    for i in range(3):
        record.position[i] = pose[i] + position_noise * draws[i]
    for i in range(4):
        record.orientation_wxyz[i] = turned[i] / norm


class SimulatedTracker:
    """An ObjectTracker of the plant's object: position (3,) m in the world, quaternion wxyz (4,), noisy."""

    def __init__(self, plant: Plant, parameters: TrackerParameters, seed: int) -> None:
        self._plant = plant
        self._pose = plant.data.qpos[2 * JOINTS :]
        self._every_ms = round(1000.0 / parameters.rate_hz)
        self._position_noise = 1e-3 * parameters.position_noise_mm
        self._half_angle_noise = float(np.deg2rad(parameters.orientation_noise_deg) / 2.0)
        self._generator = np.random.default_rng(np.random.SeedSequence([seed, 2]))
        self._draws = np.zeros((BLOCK, 6))
        self._next = BLOCK
        self._seen, self._given = ObjectPose.empty(), ObjectPose.empty()
        # copied as bytes, written through views of single fields: a record is looked up and copied field by field
        self._seen_bytes, self._given_bytes = (pose.record.view(np.uint8) for pose in (self._seen, self._given))
        self._is_new = False
        # compile, or load from the cache, before a clock runs
        self._see = bound(
            _see, self._pose, self._draws, self._position_noise, self._half_angle_noise, self._seen.record, later=(0, 0)
        )

    def update(self) -> None:
        """Look at the object when a frame is due. The cell calls it once a millisecond."""
        if self._plant.ticks % self._every_ms:
            return
        if self._next == BLOCK:
            self._generator.standard_normal(out=self._draws)
            self._next = 0
        self._see(self._next, self._plant.ticks * 1_000_000)
        self._next += 1
        self._is_new = True

    def latest(self) -> ObjectPose:
        """Return the newest frame. It belongs to the tracker and is overwritten by the next call."""
        if self._is_new:
            self._given_bytes[:] = self._seen_bytes
            self._is_new = False
        return self._given
