"""What an impact is meant to be: ante- and post-impact references that the impact map joins (Section III-A)."""

from dataclasses import dataclass
from typing import Generic, TypeVar

import numpy as np
from numpy.typing import NDArray

from hal.base.arrays import Array
from rtstack.papers.aim_aware.planar.dynamics import absolute, inertia, tip
from rtstack.papers.aim_aware.planar.parameters import Gains, PlanarArm, Task
from rtstack.references.quintic import ViaPoint, quintic_path


class InfeasibleImpact(ValueError):
    """A plan in which a contact would have to pull: its corners do not hit, and stay, together."""


def simultaneous_impact(M_r: Array, J_N: Array, dq: Array) -> tuple[Array, Array]:
    """Return the velocity (n,) after the impact and the impulses (m,), Ns, of its m contacts: (4).

    M_r (n, n) has the motors' inertia, J_N (m, n) the contacts' normals. Raises InfeasibleImpact for a negative
    impulse: the contacts are unilateral, and (4) is not.
    """
    n, m = len(dq), len(J_N)
    system = np.block([[M_r, -J_N.T], [J_N, np.zeros((m, m))]])
    solution = np.linalg.solve(system, np.concatenate([M_r @ dq, np.zeros(m)]))
    impulses = solution[n:]
    if (impulses < 0.0).any():
        raise InfeasibleImpact(f"the impact map gives a negative impulse, {impulses.min():.3g} Ns")
    return solution[:n], impulses


Reference = tuple[Array, Array, Array]  # position, velocity, acceleration, (ticks, 3) each


def model_at(arm: NDArray[np.void], q: Array) -> tuple[Array, Array, Array]:
    """Return x (3,) m, m, rad, J (3, 3) and M (3, 3) of `arm`, (1,) of ARM, at q (3,)."""
    psi, x, still = np.zeros((3, 3))
    J, M = np.zeros((2, 3, 3))
    absolute(q, psi)
    tip(arm[0], psi, still, x, J, np.zeros(3))
    inertia(arm[0], psi, M)
    return x, J, M


def joints_at(arm: NDArray[np.void], x: Array) -> Array:
    """Return the joints (..., 3), elbow up, that put the plate's middle at x (..., 3). nan where it is out of reach."""
    l1, l2, l3 = arm["length"][0]
    psi3 = x[..., 2] - 0.5 * np.pi
    wx, wy = x[..., 0] - l3 * np.cos(psi3), x[..., 1] - l3 * np.sin(psi3)
    with np.errstate(invalid="ignore"):
        q2 = -np.arccos((wx**2 + wy**2 - l1**2 - l2**2) / (2.0 * l1 * l2))
    q1 = np.arctan2(wy, wx) - np.arctan2(l2 * np.sin(q2), l1 + l2 * np.cos(q2))
    return np.stack([q1, q2, psi3 - q1 - q2], axis=-1)


R = TypeVar("R", covariant=True)


@dataclass(frozen=True, slots=True)
class Meant(Generic[R]):
    """References before and after the impact at t_d_s, each extended beyond it.

    q_start, q_d (n,): joints at the start and at the impact; dq_post (ticks, n): expected velocities (14) after it.
    """

    t_d_s: float
    q_start: Array
    q_d: Array
    ante: R
    post: R
    dq_post: Array


@dataclass(frozen=True, slots=True)
class Plan(Meant[Reference]):
    """Of the planar arm: references (ticks, 3) in x, y, phi. impulses: of the two corners, Ns."""

    impulses: Array


def plan_impact(planar: PlanarArm, task: Task, gains: Gains, approach_rad: float, x_m: float) -> Plan:
    """Plan to hit the horizontal surface at x_m down a line of this angle, 90 degrees from above.

    Raises InfeasibleImpact, and ValueError for a place out of reach.
    """
    arm = planar.record()
    hit = np.array([x_m, task.surface_height_m, 0.0])
    before = approach_velocity(task, approach_rad)
    q_d = joints_at(arm, hit)
    _, J, M = model_at(arm, q_d)
    corners = np.array([J[1] - planar.half_width_m * J[2], J[1] + planar.half_width_m * J[2]])
    dq = np.linalg.solve(J, before)
    dq_after, impulses = simultaneous_impact(M + np.diag(planar.B_theta_kg_m2), corners, dq)
    after = J @ dq_after
    t_d = task.approach_s
    t_s = gains.period_s * np.arange(round(task.duration_s / gains.period_s))
    ante, post = impact_references(task, t_s, hit, before, after)
    q_ref = joints_at(arm, np.concatenate([ante[0], post[0]]))
    if not np.isfinite(q_ref[: len(t_s)][t_s <= t_d]).all() or not np.isfinite(q_ref[len(t_s) :]).all():
        raise ValueError(f"the way to x = {x_m:g} m is out of the arm's reach")
    dq_post = [np.linalg.solve(model_at(arm, q)[1], v) for q, v in zip(q_ref[len(t_s) :], post[1], strict=True)]
    return Plan(t_d, q_ref[0], q_d, ante, post, np.array(dq_post), impulses)


def impact_references(task: Task, t_s: Array, hit: Array, before: Array, after: Array) -> tuple[Reference, Reference]:
    """Return references at t_s (n,) that hit at task.approach_s, and that go to rest from there, extended beyond it.

    hit (3,): x, y, phi; before, after (3,): their rates.
    """
    t_d, end, still = task.approach_s, t_s[-1] + t_s[1] - t_s[0], np.zeros(3)
    beyond = (end, hit + before * (end - t_d), before)
    ante = _path(t_s, [(0.0, hit - before * t_d / 2.0, still), (t_d, hit, before), beyond])
    rest = (t_d + task.settle_s, hit + after * task.settle_s / 2.0, still)
    post = _path(t_s, [(0.0, hit - after * t_d, after), (t_d, hit, after), rest])
    return ante, post


def approach_velocity(task: Task, approach_rad: float) -> Array:
    """Return the rates (3,) of x, y, phi down a line of this angle to the surface, from above at 90 degrees."""
    return -task.speed_m_s * np.array([np.cos(approach_rad), np.sin(approach_rad), 0.0])


def _path(t_s: Array, points: list[tuple[float, Array, Array]]) -> Reference:
    """Return quintics through (time, position, velocity) for each coordinate; equal velocities make a straight line."""
    columns = [quintic_path([ViaPoint(t, x[i], v[i]) for t, x, v in points], t_s) for i in range(3)]
    position, velocity = (np.stack([column[k] for column in columns], axis=1) for k in range(2))
    return position, velocity, np.gradient(velocity, t_s, axis=0)
