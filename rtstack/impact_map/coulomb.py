"""Coulomb's law of a plastic impact at point contacts, and how far impulses are from it.

Impulses and velocities are (n, 3) in the contacts' frames: two tangents, then the normal, which points from the second
body to the first. Of contact i, with friction mu_i, the law asks for

    v_N >= 0,  lambda_N >= 0,  lambda_N v_N = 0            no penetration, no pull, no rebound
    |lambda_T| <= mu lambda_N                              friction cone
    v_T = 0  or  lambda_T = -mu lambda_N v_T / |v_T|       sticking, or sliding against the velocity

It is the complementarity problem itself, not its convex relaxation, in which a contact that slides opens, too.
"""

from dataclasses import asdict, dataclass
from enum import StrEnum

import numpy as np

from hal.base.arrays import Array


class ContactState(StrEnum):
    """What a contact does in the impact. Open: it carries no impulse."""

    OPEN = "open"
    STICKING = "sticking"
    SLIDING = "sliding"


@dataclass(frozen=True, slots=True)
class LawResiduals:
    """The largest violation of each line of the law, 0 where it holds.

    penetration: -v_N, m/s. cone: -lambda_N or |lambda_T| - mu lambda_N, N s. complementarity: lambda_N v_N, J. sliding:
    |lambda_T |v_T| + mu lambda_N v_T|, J.
    """

    penetration_m_s: float
    cone_ns: float
    complementarity_j: float
    sliding_j: float

    @property
    def worst(self) -> float:
        """Return the largest of them, whatever its unit."""
        return max(asdict(self).values())


def law_residuals(impulses: Array, velocities: Array, friction: Array) -> LawResiduals:
    """Return how far impulses (n, 3) N s and velocities (n, 3) m/s are from Coulomb's law with friction (n,)."""
    if len(friction) == 0:
        return LawResiduals(0.0, 0.0, 0.0, 0.0)
    normal, v_normal = impulses[:, 2], velocities[:, 2]
    tangential, v_tangential = impulses[:, :2], velocities[:, :2]
    size, speed = _lengths(tangential), _lengths(v_tangential)
    bound = friction * normal
    sliding = speed[:, None] * tangential + bound[:, None] * v_tangential
    return LawResiduals(
        penetration_m_s=max(0.0, float(-v_normal.min())),
        cone_ns=max(0.0, float(-normal.min()), float((size - bound).max())),
        complementarity_j=float(np.abs(normal * v_normal).max()),
        sliding_j=float(_lengths(sliding).max()),
    )


def contact_states(impulses: Array, velocities: Array, tolerance: float) -> list[ContactState]:
    """Return the state of each contact. Tolerance: of an impulse that is none, N s, of a slip that is none, m/s."""
    carries = impulses[:, 2] > tolerance
    slips = _lengths(velocities[:, :2]) > tolerance
    return [
        ContactState.OPEN if not loaded else ContactState.SLIDING if slip else ContactState.STICKING
        for loaded, slip in zip(carries, slips, strict=True)
    ]


def _lengths(pairs: Array) -> Array:
    return np.hypot(pairs[:, 0], pairs[:, 1])
