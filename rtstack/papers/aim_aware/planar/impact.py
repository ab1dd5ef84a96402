"""The simultaneous inelastic impact map (2)-(4) of the planar arm, frictionless."""

import numpy as np

from hal.arrays import Array


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
