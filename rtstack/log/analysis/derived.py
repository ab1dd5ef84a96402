"""What a log's samples say besides what is recorded: forces, speeds and errors of the pads, one record an arm sample.

pad_position and pad_velocity are in the world, so that they lie over `pose_ref` and `twist_ref`, which the arm is to
follow; O_T_EE is in the arm's base. A velocity is taken over VELOCITY_TICKS samples on each side.
"""

import tomllib
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from hal.base.arrays import Array
from hal.base.record import POSITION, TWIST, Field, record_of
from hal.topic import Message, Topic
from rtstack.log.reader import Log
from rtstack.log.viewers.frames import rotation_of
from rtstack.samples import SIDES
from rtstack.topics import ARM_TOPICS, CONTROL_TOPICS

VELOCITY_TICKS = 2  # on each side: 2 mm/s of the encoders' noise are left
LEAST_SPEED_M_S = 0.02  # of a reference: below it a lag in time says nothing
_FIELDS = (
    Field("pad_force", "Norm of the force between pad and environment, {unit}.", "N", plain="pad force"),
    Field("pad_position", "Where the pad's face is, {unit}.", "m", POSITION, "world", plain="pad position",
          reference="pose_ref"),
    Field("pad_velocity", "Velocity of the pad's face, {unit}.", "m/s", TWIST[:3], "world", plain="pad velocity",
          reference="twist_ref"),
    Field("tracking_error", "Distance of the pad's face from its reference, {unit}.", "mm", plain="tracking error"),
    Field("lag", "How far the pad is behind its reference along its way, {unit}.", "ms", plain="lag"),
)  # fmt: skip
DERIVED = Message("rtstack.DerivedSample", "What the samples of one arm say besides.", _FIELDS)
DERIVED_TOPICS = {f"/{side}/derived": Topic(f"/{side}/derived", DERIVED, 1000) for side in SIDES}
_SOURCES = {
    name: (side, arm, control)
    for name, side, arm, control in zip(DERIVED_TOPICS, SIDES, ARM_TOPICS, CONTROL_TOPICS, strict=True)
}


def derived(log: Log, topic: str) -> NDArray:
    """Return all records of a derived topic of a log, (n,), one for each sample of the arm. Raises LogError."""
    side, arm, control = _SOURCES[topic]
    making = DerivedSamples(base_pose(log, side))
    return np.concatenate([making.add(log.topic(arm), log.topic(control)), making.rest()])


class DerivedBatches:
    """Makes both derived topics while a log is read batch by batch."""

    def __init__(self, log: Log) -> None:
        self._of = {topic: DerivedSamples(base_pose(log, side)) for topic, (side, *_) in _SOURCES.items()}

    def add(self, records: dict[str, NDArray]) -> Iterator[tuple[str, NDArray]]:
        """Yield what the next batch of records gives, by topic."""
        for topic, (_, arm, control) in _SOURCES.items():
            yield topic, self._of[topic].add(records.get(arm), records.get(control))

    def rest(self) -> Iterator[tuple[str, NDArray]]:
        """Yield what waited for later samples, by topic."""
        for topic, making in self._of.items():
            yield topic, making.rest()


class DerivedSamples:
    """Makes the derived samples of one arm. base: T_world_base (4, 4), None where the log does not say it."""

    def __init__(self, base: Array | None) -> None:
        self._base = base
        self._t_ns = np.zeros(0, np.int64)
        self._place = np.zeros((0, 3))
        self._force = np.zeros(0)
        self._made = 0  # of what is held: the samples before it are there for the velocity only
        self._control_t_ns = np.zeros(0, np.int64)
        self._reference = np.zeros((0, 6))  # position m, velocity m/s

    def add(self, arm: NDArray | None, control: NDArray | None) -> NDArray:
        """Return the samples that can be made once these records have come too."""
        if arm is not None and len(arm):
            self._t_ns = np.concatenate([self._t_ns, arm["t_ns"]])
            place, base = arm["O_T_EE"][:, :3, 3], self._base
            in_world = np.full(place.shape, np.nan) if base is None else place @ base[:3, :3].T + base[:3, 3]
            self._place = np.concatenate([self._place, in_world])
            self._force = np.concatenate([self._force, np.linalg.norm(arm["O_F_ext_hat_K"][:, :3], axis=1)])
        if control is not None and len(control):
            told = np.hstack([control["pose_ref"][:, :3], control["twist_ref"][:, :3]])
            told[~control["pose_ref"][:, 3:].any(axis=1)] = np.nan  # no orientation: there is no reference
            self._control_t_ns = np.concatenate([self._control_t_ns, control["t_ns"]])
            self._reference = np.concatenate([self._reference, told])
        newest = int(np.searchsorted(self._t_ns, self._control_t_ns[-1:].max(initial=-1), side="right"))
        return self._make(min(newest, len(self._t_ns) - VELOCITY_TICKS))

    def rest(self) -> NDArray:
        return self._make(len(self._t_ns))

    def _make(self, end: int) -> NDArray:
        n = max(0, end - self._made)
        found = np.zeros(n, record_of(_FIELDS))
        if n == 0:
            return found
        rows = np.arange(self._made, end)
        found["t_ns"], found["pad_force"] = self._t_ns[rows], self._force[rows]
        found["pad_position"] = self._place[rows]
        late = np.minimum(rows + VELOCITY_TICKS, len(self._t_ns) - 1)
        early = np.maximum(rows - VELOCITY_TICKS, 0)
        step_s = np.maximum(1e-9 * (self._t_ns[late] - self._t_ns[early]), 1e-9)[:, None]
        found["pad_velocity"] = (self._place[late] - self._place[early]) / step_s
        reference = self._reference_at(found["t_ns"])
        ahead, velocity = reference[:, :3] - found["pad_position"], reference[:, 3:]
        found["tracking_error"] = 1e3 * np.linalg.norm(ahead, axis=1)
        square, along = (np.einsum("ni,ni->n", each, velocity) for each in (velocity, ahead))
        moving = square > LEAST_SPEED_M_S**2
        found["lag"] = np.where(moving, 1e3 * along / np.where(moving, square, 1), np.nan)
        self._forget(max(0, end - VELOCITY_TICKS), end)
        return found

    def _reference_at(self, t_ns: NDArray[np.int64]) -> Array:
        """Return the reference at times, (n, 6), not a number where the log has no sample of it."""
        if not len(self._control_t_ns):
            return np.full((len(t_ns), 6), np.nan)
        places = np.minimum(np.searchsorted(self._control_t_ns, t_ns), len(self._control_t_ns) - 1)
        return np.where((self._control_t_ns[places] == t_ns)[:, None], self._reference[places], np.nan)

    def _forget(self, first: int, made: int) -> None:
        known = int(np.searchsorted(self._control_t_ns, self._t_ns[made - 1], side="right"))
        self._t_ns, self._place, self._force = self._t_ns[first:], self._place[first:], self._force[first:]
        self._control_t_ns, self._reference = self._control_t_ns[known:], self._reference[known:]
        self._made = made - first


def base_pose(log: Log, side: str) -> Array | None:
    """Return T_world_base (4, 4) of an arm as the cell's file in the log has it, None where there is none."""
    try:
        arm = tomllib.loads((log.attachment("cell.toml") or b"").decode())[side]
        T = np.eye(4)
        wxyz = np.array(arm["base_orientation_wxyz"], np.float64)
        T[:3, :3] = rotation_of(wxyz / np.linalg.norm(wxyz))
        T[:3, 3] = arm["base_position"]
    except (ValueError, KeyError, TypeError):
        return None
    return T
