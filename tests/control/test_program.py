"""The QP: the solvers against each other, against the optimality conditions, and where there is no answer."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rtstack.control.active_set import ActiveSetProgram, optimality_error
from rtstack.control.program import DaqpProgram, ProxqpProgram, SecondOpinion, program
from rtstack.samples import QpSolver, QpStatus


def _problem(rng: np.random.Generator, tightness: float) -> tuple[np.ndarray, ...]:
    A = rng.normal(size=(7, 7)) + 2.0 * np.eye(7)
    M = 0.2 * rng.normal(size=(7, 7))
    M = M @ M.T + np.eye(7)
    gradient = 20.0 * rng.normal(size=7)
    box, rows = tightness * rng.uniform(1.0, 10.0, (2, 7)), tightness * rng.uniform(1.0, 10.0, (2, 7))
    return A.T @ A, gradient, -box[0], box[1], M, -rows[0], rows[1]


@given(seed=st.integers(0, 2**31), tightness=st.sampled_from([0.05, 0.3, 1.0, 10.0]))
@settings(max_examples=80, deadline=None)
def test_solvers_agree_and_the_unconstrained_minimiser_is_the_answer_where_it_fits(seed, tightness):
    rng = np.random.default_rng(seed)
    problem = _problem(rng, tightness)
    H, gradient, lower, upper, M, tau_lower, tau_upper = problem
    x, y = np.zeros(7), np.zeros(7)
    assert SecondOpinion(ProxqpProgram(), DaqpProgram()).solve(*problem, x)[0] is QpStatus.SOLVED
    assert DaqpProgram().solve(*problem, y)[0] is QpStatus.SOLVED
    np.testing.assert_allclose(x, y, atol=1e-3)
    assert ActiveSetProgram().solve(*problem, x)[0] is QpStatus.SOLVED
    np.testing.assert_allclose(x, y, atol=1e-6)
    free = np.linalg.solve(H, -gradient)
    tau = M @ free
    if np.all((lower <= free) & (free <= upper) & (tau_lower <= tau) & (tau <= tau_upper)):
        np.testing.assert_allclose(y, free, atol=1e-6)


@pytest.mark.parametrize("solver", list(QpSolver))
def test_warm_started_walk_stays_right(solver):
    """The trap of the default backend: wrong answers on a slowly changing problem. Checked without multipliers."""
    rng = np.random.default_rng(2)
    H, _, lower, upper, M, tau_lower, tau_upper = _problem(rng, 0.3)
    qp, exact = program(solver), DaqpProgram()
    x, y = np.zeros(7), np.zeros(7)
    for k in range(500):
        gradient = 15.0 * np.sin(0.02 * k + np.arange(7))
        assert qp.solve(H, gradient, lower, upper, M, tau_lower, tau_upper, x)[0] is QpStatus.SOLVED
        fresh = DaqpProgram()
        assert fresh.solve(H, gradient, lower, upper, M, tau_lower, tau_upper, y)[0] is QpStatus.SOLVED
        np.testing.assert_allclose(x, y, atol=1e-3)
    assert exact is not qp


def test_the_active_set_is_the_first_to_be_asked_and_a_library_where_it_has_no_answer():
    problem, x = _problem(np.random.default_rng(1), 0.05), np.zeros(7)
    own = ActiveSetProgram().solve(*problem, np.zeros(7))
    assert own[1] > 2  # limits
    assert program(QpSolver.PROXQP).solve(*problem, x) == own

    class NoAnswer:
        def solve(self, *problem):
            return QpStatus.ITERATIONS_EXHAUSTED, 100

    for library in (ProxqpProgram(), DaqpProgram()):
        assert SecondOpinion(NoAnswer(), library).solve(*problem, x)[0] is QpStatus.SOLVED


def test_limits_that_depend_on_each_other_and_those_that_leave_one_point_are_kept():
    """As many rows as the torque has, again as bounds; and both limits of a joint in one place."""
    problem = list(_problem(np.random.default_rng(3), 0.3))
    problem[4] = np.eye(7)
    problem[5], problem[6] = problem[2].copy(), problem[3].copy()  # each limit twice
    x, y = np.zeros(7), np.zeros(7)
    assert ActiveSetProgram().solve(*problem, x)[0] is QpStatus.SOLVED
    assert DaqpProgram().solve(*problem, y)[0] is QpStatus.SOLVED
    np.testing.assert_allclose(x, y, atol=1e-6)
    middle = 0.5 * (problem[2] + problem[3])
    problem[2] = problem[3] = middle
    problem[5], problem[6] = middle - 1.0, middle + 1.0
    assert ActiveSetProgram().solve(*problem, x)[0] is QpStatus.SOLVED
    np.testing.assert_allclose(x, middle, atol=1e-9)


@pytest.mark.parametrize("solver", list(QpSolver))
def test_infeasible_problem_is_a_status_and_the_next_one_is_solved(solver):
    problem = _problem(np.random.default_rng(0), 1.0)
    H, gradient, lower, upper, M, _, tau_upper = problem
    qp = program(solver)
    x = np.zeros(7)
    status, iterations = qp.solve(H, gradient, lower, upper, M, tau_upper + 1e4, tau_upper + 1e4 + 1.0, x)
    assert status in (QpStatus.INFEASIBLE, QpStatus.ITERATIONS_EXHAUSTED)
    assert iterations < 1000
    assert qp.solve(*problem, x)[0] is QpStatus.SOLVED


@pytest.mark.parametrize("make", [ActiveSetProgram, ProxqpProgram, DaqpProgram])
def test_numbers_that_are_not_finite_are_a_status(make):
    problem = list(_problem(np.random.default_rng(0), 1.0))
    problem[1] = np.full(7, np.nan)
    assert make().solve(*problem, np.zeros(7))[0] > QpStatus.SOLVED


def test_optimality_error_sees_each_condition():
    """A check that cannot fail is none: each KKT condition, broken alone, shows."""
    H, M = np.eye(7), np.eye(7)
    wide = np.full(7, 100.0)
    gradient = np.full(7, -1.0)
    right = (np.ones(7), np.zeros(14))
    assert optimality_error(H, gradient, -wide, wide, M, -wide, wide, *right) < 1e-12
    assert optimality_error(H, gradient, -wide, wide, M, -wide, wide, 2 * right[0], right[1]) > 0.5  # stationarity
    half = np.full(7, 0.5)
    assert optimality_error(H, gradient, -wide, half, M, -wide, wide, *right) >= 0.5  # bounds
    assert optimality_error(H, gradient, -wide, wide, M, -wide, half, *right) >= 0.5  # torque rows
    push = np.zeros(14)
    push[:7] = 0.5  # a multiplier at a bound that is far away
    assert optimality_error(H, gradient, -wide, wide, M, -wide, wide, half, push) > 0.4  # complementarity
    assert optimality_error(H, gradient, -wide, half, M, -wide, wide, half, push) < 1e-12
    assert optimality_error(H, gradient, half, wide, M, -wide, wide, half, push) > 0.4  # sign
