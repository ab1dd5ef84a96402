"""Pinocchio's solvers of the frictional contact problem, as two opinions on the same numbers.

Rigid bodies leave loads open: four corners on a face carry three resultants. Where such corners slide in different
directions, another distribution of loads is another friction, and the velocity itself is not unique. Of all solutions
the even one is then chosen, the limit of contacts with the same, vanishing compliance: it depends on no solver.
"""

from dataclasses import dataclass
from enum import StrEnum
from functools import lru_cache
from typing import Any

import numpy as np
import pinocchio as pin

from hal.base.arrays import Array
from rtstack.impact_map.newton import refined

ACCEPTED = 1e-9  # error of the law's equations, SI: what counts as solved
COMPLIANCE = 1e-6  # of the mean of G's diagonal: small enough to be rigid, large enough for Newton's method to see
# tolerance and iterations, tried in this order until Newton's method can make the answer exact: it needs the right
# contact states, not digits, and the first attempt mostly shows them
ADMM_ATTEMPTS = ((1e-4, 400), (1e-7, 4000), (1e-11, 20000))
PGS_ATTEMPTS = ((1e-4, 1000), (1e-7, 20000))


class Solver(StrEnum):
    """ADMM: Pinocchio's alternating direction method. PGS: its projected Gauss-Seidel."""

    ADMM = "ADMM"
    PGS = "PGS"


@dataclass(frozen=True, slots=True)
class Solution:
    """What one solver says: impulses (n, 3) N s, evenly loaded where loads are open; the solver's own, before that
    choice; whether they obey the law to `ACCEPTED`; its iterations."""

    impulses: Array
    first: Array
    solved: bool
    iterations: int


def solve(solver: Solver, G: Array, b: Array, friction: Array) -> Solution:
    """Solve Coulomb's law (rtstack.impact_map.coulomb) for lambda, where v = G lambda + b. Never raises for numbers.

    G (3n, 3n) 1/kg, symmetric, positive semidefinite; b (3n,) m/s; friction (n,). `solve_ncp` is on: the law itself.
    The solver's answer is made exact by Newton's method; an answer that stays inexact is returned as not solved.
    """
    if len(friction) == 0 or np.all(b[2::3] >= 0.0):  # nothing approaches
        none = np.zeros((len(friction), 3))
        return Solution(none, none, True, 0)
    best, error, iterations = _exact(solver, G, b, friction)
    solved = error <= ACCEPTED
    return Solution(_even(solver, G, b, friction, best) if solved else best, best, solved, iterations)


def _exact(solver: Solver, G: Array, b: Array, friction: Array) -> tuple[Array, float, int]:
    """Return the best impulses of all attempts, made exact, their error, and all iterations."""
    models, datas = _constraints(tuple(friction))
    best, smallest, iterations = np.zeros((len(friction), 3)), np.inf, 0
    for tolerance, limit in ADMM_ATTEMPTS if solver is Solver.ADMM else PGS_ATTEMPTS:
        engine, settings, answer = _engine(solver, len(b))
        settings.solve_ncp = True
        settings.max_iterations = limit
        settings.absolute_feasibility_tol = settings.absolute_complementarity_tol = tolerance
        settings.relative_feasibility_tol = settings.relative_complementarity_tol = 0.0
        engine.solve(pin.DelassusOperatorDense(G), b, models, datas, settings, answer)
        iterations += answer.iterations
        impulses, error = refined(G, b, friction, np.array(answer.retrieveConstraintImpulses()))
        if error < smallest:
            best, smallest = impulses, error
        if error <= ACCEPTED:
            break
    return best, smallest, iterations


def _even(solver: Solver, G: Array, b: Array, friction: Array, impulses: Array) -> Array:
    """Return the evenly loaded solution next to `impulses`; `impulses` where there is none to be found."""
    compliant = G.copy()
    compliant.ravel()[:: len(b) + 1] += COMPLIANCE * G.diagonal().mean()
    loads, error = refined(compliant, b, friction, impulses)
    if error > ACCEPTED:
        loads, error, _ = _exact(solver, compliant, b, friction)
        if error > ACCEPTED:
            return impulses
    even, error = refined(G, b, friction, loads)
    return even if error <= ACCEPTED else impulses


def _engine(solver: Solver, size: int) -> tuple[Any, Any, Any]:
    if solver is Solver.ADMM:
        settings = pin.ADMMSolverSettings()
        settings.tau = 1.0  # a third fewer iterations on grabs than Pinocchio's 0.5
        return pin.ADMMConstraintSolver(size), settings, pin.ADMMSolverResult()
    return pin.PGSConstraintSolver(size), pin.PGSSolverSettings(), pin.PGSSolverResult()


@lru_cache(maxsize=256)
def _constraints(friction: tuple[float, ...]) -> tuple[Any, Any]:
    """Return the friction cones as Pinocchio's solvers want them, which read nothing else of a contact model. Set by
    setFriction: assigning to `set` would silently do nothing."""
    model = pin.Model()
    inertia = pin.JointModelFreeFlyer()
    joint = model.addJoint(0, inertia, pin.SE3.Identity(), "body")
    models, datas = pin.StdVec_ConstraintModel(), pin.StdVec_ConstraintData()
    for coefficient in friction:
        contact = pin.PointContactConstraintModel(model, joint)
        contact.setFriction(coefficient)
        models.append(pin.ConstraintModel(contact))
        datas.append(models[len(models) - 1].createData())
    return models, datas
