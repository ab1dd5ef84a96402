"""Motion capture of the object: rate and noise; and, by the profile, a clock of its own, latency and lost frames."""

from collections import deque
from math import sqrt

import numpy as np

from hal.compilation import bound, compiled
from hal.tracker import ObjectPose
from sim_robot.plant import Plant
from sim_robot.plant_parameters import TrackerParameters
from sim_robot.profile import TRACKER_DRAW, Spread, TrackerClock

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
        self._pose = plant.data.qpos[plant.first_of_object :]
        self._every_ms = round(1000.0 / parameters.rate_hz)
        self._generator = np.random.default_rng(np.random.SeedSequence([seed, 2]))
        self._draws = np.zeros((BLOCK, 6))
        self._next = BLOCK
        self._seen, self._given = ObjectPose.empty(), ObjectPose.empty()
        # copied as bytes, written through views of single fields: a record is looked up and copied field by field
        self._seen_bytes, self._given_bytes = (pose.record.view(np.uint8) for pose in (self._seen, self._given))
        self._is_new = False
        # compile, or load from the cache, before a clock runs
        noise_m, half_angle = 1e-3 * parameters.position_noise_mm, np.deg2rad(parameters.orientation_noise_deg) / 2.0
        self._see = bound(_see, self._pose, self._draws, noise_m, float(half_angle), self._seen.record, later=(0, 0))

    def update(self) -> None:
        if self._plant.ticks % self._every_ms or self._plant.away:
            return
        if self._next == BLOCK:
            self._generator.standard_normal(out=self._draws)
            self._next = 0
        self._see(self._next, self._plant.ticks * 1_000_000)
        self._next += 1
        self._is_new = True

    def latest(self) -> ObjectPose:
        if self._is_new:
            self._given_bytes[:] = self._seen_bytes
            self._is_new = False
        return self._given


class OwnClockTracker(SimulatedTracker):
    """A tracker that is late, stamps with a clock of its own, and loses frames."""

    def __init__(self, plant: Plant, parameters: TrackerParameters, seed: int, clock: TrackerClock) -> None:
        super().__init__(plant, parameters, seed)
        self._own = np.random.default_rng(np.random.SeedSequence([seed, TRACKER_DRAW]))
        offset_ms, drift_ppm = self._own.uniform(-1.0, 1.0, 2) * (clock.offset_ms, clock.drift_ppm)
        self._offset_ns, self._rate = round(1e6 * offset_ms), 1.0 + 1e-6 * drift_ppm
        self._latency, self._clock = Spread(*clock.latency_ms), clock
        # a gap begins so often that the share of the lost frames is the profile's
        mean_gap = (1 + clock.lost_frames) / 2.0
        self._gap_share = clock.lost_share / (mean_gap * (1.0 - clock.lost_share) + clock.lost_share)
        self._gap = 0  # frames that are still to be lost
        self._on_the_way: deque[tuple[float, np.ndarray]] = deque()  # when it arrives, ms, and the frame
        self._arrived = ObjectPose.empty()
        self._given = self._arrived

    def update(self) -> None:
        """Look at the object when a frame is due, and take what arrives. The cell calls it once a millisecond."""
        super().update()
        now_ms = self._plant.ticks
        if self._is_new:
            self._is_new = False
            self._expose(now_ms)
        while self._on_the_way and self._on_the_way[0][0] <= now_ms:
            self._arrived.record[:] = self._on_the_way.popleft()[1]

    def _expose(self, now_ms: int) -> None:
        if not self._gap and self._own.random() < self._gap_share:
            self._gap = int(self._own.integers(1, self._clock.lost_frames + 1))
        if self._gap:
            self._gap -= 1
            return
        frame = self._seen.record.copy()
        frame["t_ns"] = round(self._rate * int(frame["t_ns"][0])) + self._offset_ns
        last_ms = self._on_the_way[-1][0] if self._on_the_way else 0.0
        # one after the other, as on a stream
        self._on_the_way.append((max(now_ms + self._latency.draw(self._own), last_ms), frame))


def tracker_of(plant: Plant, parameters: TrackerParameters, seed: int) -> SimulatedTracker:
    clock = plant.profile.tracker
    if not any((clock.offset_ms, clock.drift_ppm, *clock.latency_ms, clock.lost_share)):
        return SimulatedTracker(plant, parameters, seed)
    return OwnClockTracker(plant, parameters, seed, clock)
