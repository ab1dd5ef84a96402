"""Reference extension: (16)-(20) of the reference-spreading paper.

The recording is cut around the nominal impact T_r. Ante-impact references go on after T_a = T_r - Delta T_r,
post-impact ones exist before T_p = T_r + Delta T_r, so that both overlap around the impact.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rtstack.model.rotation import exp_so3
from rtstack.monitor.expected import ExpectedImpact
from rtstack.references.motion import Motion
from rtstack.references.recording import Recording, ReferenceError


@dataclass(frozen=True, slots=True)
class ExtendedReference:
    """ante and post: (arms, n) of POINT, one point a tick from the start; nominal impact and release in s.

    impact: what the monitor expects, None where the joints are not known, or of a push. planned: made by a planner.
    """

    ante: NDArray[np.void]
    post: NDArray[np.void]
    period_s: float
    nominal_impact_s: float
    release_s: float
    object: str
    motion: Motion = Motion.GRAB
    impact: ExpectedImpact | None = None
    planned: bool = False

    @property
    def ticks(self) -> int:
        """Number of ticks of the reference."""
        return self.ante.shape[1]


def extend(recording: Recording, exclusion_s: float) -> ExtendedReference:
    """Make the extended references. Raises ReferenceError where the impact is too close to an end of the recording."""
    n, excluded = recording.points.shape[1], round(exclusion_s / recording.period_s)
    a, p = recording.impact - excluded, recording.impact + excluded
    if a < 1 or p >= n - 1:
        near = f"less than {exclusion_s} s from an end of the recording"
        raise ReferenceError(f"the impact at {recording.impact_s:.3f} s is {near}: record a longer one")
    return spread(recording, a, p)


def spread(recording: Recording, a: int, p: int) -> ExtendedReference:
    """Return the references of which the ante-impact one is extended from tick a on, the post-impact one before p.

    A load that is known is in both from the nominal impact on: the interim mode need not blend it in, as in (23) of the
    impact-map paper. Before it only what is pushed is a load, from the moment at which its one pad meets it. What is
    grabbed rises when the second pad meets it, and where it is out of its place that one is as late as the first is
    early: carried from the first on, a box of 2.2 kg 1 mm out of its place had left the impact 2 % faster than in it.
    """
    n = recording.points.shape[1]
    ante, post = recording.points.copy(), recording.points.copy()
    for arm in range(len(ante)):
        _hold_velocity(ante[arm], a, np.arange(a + 1, n), recording.period_s)
        _hold_velocity(post[arm], p, np.arange(p), recording.period_s)
        if recording.load is not None:
            ante[arm]["wrench_ff"][p:] += recording.load[arm]
            if recording.motion is Motion.GRAB:
                post[arm]["wrench_ff"][:p] -= recording.load[arm]
    release_s, expected = recording.release * recording.period_s, recording.expected_impact(p - recording.impact)
    return ExtendedReference(
        ante, post, recording.period_s, recording.impact_s, release_s, recording.object, recording.motion, expected,
        planned=recording.load is not None,
    )  # fmt: skip


def _hold_velocity(points: NDArray, pivot: int, indices: NDArray, period_s: float) -> None:
    """Replace points[indices]: feedforward and velocities held at the pivot (16), poses integrated from it (17)-(20).
    (20) is used with (t - T_p): the printed sign turns the wrong way. The angular velocity is along the inertial axes,
    so its rotation multiplies from the left."""
    held = points[pivot].copy()
    points[indices] = held
    elapsed = (indices - pivot) * period_s
    points["position"][indices] = held["position"] + elapsed[:, None] * held["twist"][:3]
    points["xi"][indices] = held["xi"] + elapsed * held["dxi"]
    turn = np.empty((3, 3))
    for index, t in zip(indices, elapsed, strict=True):
        exp_so3(held["twist"][3:], t, turn)
        points["rotation"][index] = turn @ held["rotation"]
