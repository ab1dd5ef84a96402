"""The rigid impact map: which velocity follows an impact of rigid bodies, configuration and time standing still.

Plastic impacts (restitution 0) with Coulomb friction at points; M (v+ - v-) = J^T lambda, with M of (10) of the
impact-map paper, and the law of rtstack.impact_map.coulomb.

**Single step**: the law once, at all contacts together. Where a pad hits a face, the arm's inertia is not the same at
all corners, and the single step mostly leaves some of them opening: the pad tilts away.

**Converged**: the end of the sequence of impacts that follows in the next milliseconds, because a controller goes on
pressing: corners that have opened close again, with further impacts, until the pad lies on the face. The end is told
without the sequence. Let Lambda >= 0 be the sums of all impulses at the corners, and P the sum of the pressing, even
over the corners of a patch (e). Taken as a pair of forces between the two bodies it leaves their momentum alone, and

    M (v+ - v-) = J^T (Lambda - P e),     v_N = 0 and v_T = 0 at the corners of a maintained patch:

what the law bounds is Lambda, so lambda = Lambda - P e is free in sign, at the maintained patches only. The map solves
this for lambda, with the law itself at all other contacts (no support ever pulls), and tells as `pressing_ns` a
P that suffices for Lambda to be within the friction cone: the least one for the lambda of least norm; where lambda is
not unique, less may do. P = 0: a single step ends there by itself. The assumptions, then:
  - the bodies are pressed together at least that much while the sequence lasts: P over the clamping force is the time
    that it takes, and the map is valid only where that is short (some 10 ms);
  - what the pressing does to the motion of both bodies together is not part of the impact. Two pads that clamp a box
    cancel. A pad that pushes a box along adds its force times the time: that belongs to the motion after the impact;
  - it is even over the patch, and goes on until slip has ended, too. Where it is known to end earlier, `pressed` gives
    the single step under a given P, in which a patch may slip on. Without friction only v_N = 0 is asked;
  - each patch pushes in the sum. Where one would have to pull, the bodies part, and the status is infeasible.

Neither map need be unique. Impulses mostly are not (Impact.impulses_unique). Velocities are not where contacts whose
loads are open slide (rtstack.impact_map.solvers: the even solution is told), or where Coulomb's law has separate
solutions; both are seen by the two solvers' answers, and told by the status. That they agree proves nothing, of course.
"""

from collections.abc import Sequence

import daqp
import numpy as np
from numpy.typing import NDArray

from hal.base.arrays import Array, numbers
from rtstack.impact_map.coulomb import ContactState, contact_states, law_residuals
from rtstack.impact_map.problem import Problem, problem_of
from rtstack.impact_map.result import Impact, ImpactMap, Status
from rtstack.impact_map.scene import Scene
from rtstack.impact_map.solvers import Solution, Solver, solve

Mask = NDArray[np.bool_]
# largest differences of velocity between the solvers, m/s and rad/s: of what is told, and of their first answers,
# before loads were made even; None where PGS was not asked, or has no solution
Difference = tuple[float | None, float | None]

SAME = 1e-6  # m/s, rad/s: solvers that agree; they agree to 1e-8 or differ by far
NOTHING = 1e-8  # N s, m/s: an impulse or a slip that is none
RANK = 1e-9  # of the largest singular value: what counts as zero


def impact_map(scene: Scene, second_opinion: bool = True) -> ImpactMap:
    """Return both maps of a scene. second_opinion: whether PGS is asked, too. Raises SceneError, for a bad scene."""
    problem = problem_of(scene)
    return ImpactMap(problem, single_step(problem, second_opinion), converged(problem, second_opinion))


def single_step(problem: Problem, second_opinion: bool = True) -> Impact:
    """Return the single step: the law at all contacts, once."""
    return pressed(problem, np.zeros(len(problem.contacts)), second_opinion)


def pressed(problem: Problem, pressing_ns: Array | Sequence[float], second_opinion: bool = True) -> Impact:
    """Return the single step while each contact's bodies are pressed together with an impulse, (contacts,) N s.

    The impulses that are told include the reaction to it; it does not move the bodies' common momentum.
    """
    pressing = numbers(pressing_ns, "pressing_ns", (len(problem.contacts),))
    load = np.zeros((len(problem.friction), 3))
    for rows, impulse in zip(problem.points, pressing, strict=True):
        load[rows, 2] = impulse / (rows.stop - rows.start)
    w = problem.w - problem.A @ load.ravel()
    none = np.zeros(len(problem.friction), dtype=bool)
    solution, other = _solutions(problem, problem.A, w, none, second_opinion)
    after = w + problem.A @ solution.impulses.ravel()
    return _impact(problem, solution, other, after, solution.impulses, load, pressing, none)


def converged(problem: Problem, second_opinion: bool = True) -> Impact:
    """Return the end of the impact sequence: maintained patches closed, the law at all other contacts."""
    held = np.zeros(len(problem.friction), dtype=bool)
    for k in problem.maintained():
        held[problem.points[k]] = True
    if not held.any():
        return single_step(problem, second_opinion)
    tied = np.repeat(held, 3)
    tied[:-2:3] &= problem.friction > 0.0
    tied[1:-1:3] &= problem.friction > 0.0
    U, S, Vt = np.linalg.svd(problem.A[:, tied], full_matrices=False)
    rank = int(np.sum(RANK * S[0] < S))
    U, S, Vt = U[:, :rank], S[:rank], Vt[:rank]
    w = problem.w + U @ ((Vt @ problem.s[tied]) / S - U.T @ problem.w)
    A = problem.A[:, np.repeat(~held, 3)]
    A = A - U @ (U.T @ A)
    solution, other = _solutions(problem, A, w, held, second_opinion)
    after = w + A @ solution.impulses.ravel()
    impulses = np.zeros((len(held), 3))
    impulses[~held] = solution.impulses
    rest = after - problem.w - problem.A @ impulses.ravel()
    impulses.ravel()[tied] = Vt.T @ ((U.T @ rest) / S)
    pressing = np.zeros(len(problem.contacts))
    for k in problem.maintained():
        points = problem.points[k]
        pressing[k] = (points.stop - points.start) * _lacking(impulses[points], problem.friction[points])
    return _impact(problem, solution, other, after, impulses, np.zeros_like(impulses), pressing, held)


def _lacking(impulses: Array, friction: Array) -> float:
    """Return the least normal impulse, N s, that put on top of each of these makes all of them obey the law's cone."""
    sideways = np.hypot(impulses[:, 0], impulses[:, 1]) / np.where(friction > 0.0, friction, np.inf)
    return max(0.0, float((sideways - impulses[:, 2]).max()))


def _solutions(problem: Problem, A: Array, w: Array, held: Mask, second_opinion: bool) -> tuple[Solution, Difference]:
    """Return ADMM's solution at the contacts not held, and how far PGS's velocities are from it."""
    G, b, friction = A.T @ A, A.T @ w - problem.s[np.repeat(~held, 3)], problem.friction[~held]
    solution = solve(Solver.ADMM, G, b, friction)
    other = solve(Solver.PGS, G, b, friction) if second_opinion and solution.solved else None
    if other is None or not other.solved:
        return solution, (None, None)
    told, first = (
        float(np.abs(problem.coloured(A @ apart.ravel())).max())
        for apart in (other.impulses - solution.impulses, other.first - solution.first)
    )
    return solution, (told, first)


@np.errstate(over="ignore", invalid="ignore")  # of numbers that are no body's
def _impact(
    problem: Problem, solution: Solution, apart: Difference, after: Array, impulses: Array, load: Array,
    pressing: Array, held: Mask,
) -> Impact:  # fmt: skip
    """Return the result. load (n, 3): the pressing, within `impulses`; held (n,): where the law bounds no impulse."""
    velocity = problem.coloured(after)
    velocities = (problem.A.T @ after - problem.s).reshape(-1, 3)
    law = law_residuals(impulses[~held], velocities[~held], problem.friction[~held])
    states = contact_states(impulses, velocities, NOTHING)
    for i in np.flatnonzero(held):
        states[i] = ContactState.STICKING if problem.friction[i] > 0.0 else ContactState.SLIDING
    momentum = problem.M @ (velocity - problem.velocity) - problem.J.T @ (impulses - load).ravel()
    status, detail = _status(problem, solution, apart, impulses, velocities, held)
    return Impact(
        status, detail, velocity, impulses, velocities, tuple(states),
        impulses_unique=_unique(problem, impulses, velocities, states, held),
        kinetic_energy_before_j=float(problem.w @ problem.w) / 2, kinetic_energy_after_j=float(after @ after) / 2,
        law=law, momentum_ns=float(np.abs(momentum).max()), pressing_ns=pressing, iterations=solution.iterations,
        second_opinion_m_s=apart[0], spread_m_s=apart[1],
    )  # fmt: skip


def _status(
    problem: Problem, solution: Solution, apart: Difference, impulses: Array, velocities: Array, held: Mask
) -> tuple[Status, str]:
    if np.abs(velocities[held, 2]).max(initial=0.0) > NOTHING:
        return Status.INFEASIBLE, "the maintained patches cannot all be closed: a moving support forces them apart"
    if not solution.solved:
        if _penetrates(problem, held):
            return Status.INFEASIBLE, "no velocity keeps all contacts from penetrating: a moving support leaves no room"
        return Status.UNSOLVED, "no solver came to 1e-9; the figures are the best attempt"
    for k in problem.maintained() if held.any() else ():
        total = float(impulses[problem.points[k], 2].sum())
        if total < -NOTHING:
            first, second = problem.contacts[k].between
            return (Status.INFEASIBLE, f"{first} and {second} part: together they would pull with {-total:.3g} Ns")
    told, first = apart
    if told is None or first is None:
        return Status.SOLVED, "unconfirmed: PGS not asked, or not precise"
    if told > SAME:
        return Status.NOT_UNIQUE, f"another solution of the law, by PGS, differs by up to {told:.3g} m/s or rad/s"
    if first > SAME:
        return Status.NOT_UNIQUE, (
            f"redundant contacts slide, their loads decide over {first:.3g} m/s or rad/s: the even ones are told"
        )
    return Status.SOLVED, "confirmed by PGS"


def _penetrates(problem: Problem, held: Mask) -> bool:
    """Whether no velocity is without penetration: the nearest one (a QP in whitened velocities) does not exist."""
    normals = problem.A[:, 2::3].T
    lower = np.ascontiguousarray(problem.s[2::3])
    upper = np.full(len(lower), 1e30)
    upper[held] = lower[held]
    *_, flag, _ = daqp.solve(np.eye(len(problem.w)), -problem.w, np.ascontiguousarray(normals), upper, lower)
    return flag == -1


def _unique(problem: Problem, impulses: Array, velocities: Array, states: list[ContactState], held: Mask) -> bool:
    """Whether no other impulses of the same contact states give the same velocity: no direction is left in them."""
    columns = []
    for i, state in enumerate(states):
        block = problem.A[:, 3 * i : 3 * i + 3]
        if held[i] or state is ContactState.STICKING:
            columns.append(block if problem.friction[i] > 0.0 else block[:, 2:])
        elif state is ContactState.SLIDING:
            slip = velocities[i, :2] / np.hypot(*velocities[i, :2])
            columns.append((block[:, 2] - problem.friction[i] * block[:, :2] @ slip)[:, None])
    if not columns:
        return True
    together = np.hstack(columns)
    rows, count = together.shape
    return count <= rows and int(np.linalg.matrix_rank(together, rtol=RANK)) == count
