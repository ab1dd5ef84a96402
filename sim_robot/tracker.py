"""Motion capture of the object, as far as it is simulated: a rate and noise."""

import numpy as np

from hal.tracker import ObjectPose
from sim_robot.plant import Plant
from sim_robot.plant_parameters import TrackerParameters


class SimulatedTracker:
    """An ObjectTracker of the plant's object: position (3,) m in the world, quaternion wxyz (4,), noisy."""

    def __init__(self, plant: Plant, parameters: TrackerParameters, seed: int) -> None:
        self._plant = plant
        self._every_ms = round(1000.0 / parameters.rate_hz)
        self._position_noise = 1e-3 * parameters.position_noise_mm
        self._half_angle_noise = np.deg2rad(parameters.orientation_noise_deg) / 2.0
        self._generator = np.random.default_rng(np.random.SeedSequence([seed, 2]))
        self._seen, self._given = ObjectPose.empty(), ObjectPose.empty()
        self._is_new = False

    def update(self) -> None:
        """Look at the object when a frame is due. The cell calls it once a millisecond."""
        if self._plant.ticks % self._every_ms:
            return
        draws = self._generator.standard_normal(6)
        position, (w, x, y, z) = self._plant.object_pose()
        # a small rotation (1, e) along the world's axes, from the left, then normalised
        a, b, c = self._half_angle_noise * draws[3:]
        turned = np.array(
            (
                w - a * x - b * y - c * z,
                x + a * w + b * z - c * y,
                y + b * w + c * x - a * z,
                z + c * w + a * y - b * x,
            )
        )
        record = self._seen.record
        record["t_ns"] = self._plant.ticks * 1_000_000
        record["position"][0] = position + self._position_noise * draws[:3]
        record["orientation_wxyz"][0] = turned / np.linalg.norm(turned)
        record["seen"] = 1
        self._is_new = True

    def latest(self) -> ObjectPose:
        """Return the newest frame. It belongs to the tracker and is overwritten by the next call."""
        if self._is_new:
            self._given.record[:] = self._seen.record
            self._is_new = False
        return self._given
