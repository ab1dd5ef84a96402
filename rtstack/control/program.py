"""The quadratic program of a tick where a limit is active: min 1/2 x^T H x + g^T x, bounds on x and on A x.

A compiled active set, and two libraries as further opinions. proxsuite's PrimalLDLT backend is the default: its
automatic one, warm-started, returns wrong answers that it calls solved. So every answer is checked against the
optimality conditions, and where one is not acceptable the next solver is asked, in the same tick.
"""

from typing import Protocol

import daqp
import numpy as np
import proxsuite

from hal.base.arrays import Array
from rtstack.control.active_set import OPTIMALITY_TOLERANCE, ActiveSetProgram, optimality_error
from rtstack.samples import QpSolver, QpStatus

# Together they cap the time of a problem that ProxQP cannot solve at about half a millisecond; a warm one takes 10 to
# 20
OUTER_ITERATIONS = 12
INNER_ITERATIONS = 10
DAQP_ITERATIONS = 200  # it ends by itself, after a handful


class Program(Protocol):
    """A QP of seven variables, solved again and again with other numbers. A (rows, 7); row_lower, row_upper (rows,)."""

    def solve(self, H: Array, gradient: Array, lower: Array, upper: Array, A: Array, row_lower: Array, row_upper: Array,
              x: Array) -> tuple[QpStatus, int]:  # fmt: skip
        """Write the solution to `x` (7,). Return the status and the iterations. Never raises."""
        ...


class ProxqpProgram(Program):
    """proxsuite dense, PrimalLDLT, the bounds as a box, warm-started with the last answer."""

    def __init__(self, rows: int = 7) -> None:
        proxqp = proxsuite.proxqp
        self._rows = rows
        self._qp = proxqp.dense.QP(7, 0, rows, True, dense_backend=proxqp.dense.DenseBackend.PrimalLDLT)
        settings = self._qp.settings
        settings.eps_abs = 1e-6
        settings.eps_rel = 0.0
        settings.max_iter = OUTER_ITERATIONS
        settings.max_iter_in = INNER_ITERATIONS
        settings.initial_guess = proxqp.InitialGuess.WARM_START_WITH_PREVIOUS_RESULT
        self._solved = proxqp.QPSolverOutput.PROXQP_SOLVED
        self._infeasible = (
            proxqp.QPSolverOutput.PROXQP_PRIMAL_INFEASIBLE,
            proxqp.QPSolverOutput.PROXQP_DUAL_INFEASIBLE,
        )
        self._multipliers = np.zeros(7 + rows)
        self._started = False

    def solve(self, H: Array, gradient: Array, lower: Array, upper: Array, A: Array, row_lower: Array, row_upper: Array,
              x: Array) -> tuple[QpStatus, int]:  # fmt: skip
        arguments = {"H": H, "g": gradient, "C": A, "l": row_lower, "u": row_upper, "l_box": lower, "u_box": upper}
        if self._started:
            self._qp.update(**arguments)
        else:
            self._qp.init(**arguments)
            self._started = True
        self._qp.solve()
        results = self._qp.results
        x[:] = results.x
        iterations = int(results.info.iter)
        if results.info.status == self._solved:
            self._multipliers[:7] = results.z[self._rows :]
            self._multipliers[7:] = results.z[: self._rows]
            error = optimality_error(H, gradient, lower, upper, A, row_lower, row_upper, x, self._multipliers)
            if error <= OPTIMALITY_TOLERANCE:
                return QpStatus.SOLVED, iterations
            self._qp.cleanup()
            self._started = False
            return QpStatus.WRONG_ANSWER, iterations
        # a failed problem must not be the next one's first guess
        self._qp.cleanup()
        self._started = False
        if results.info.status in self._infeasible:
            return QpStatus.INFEASIBLE, iterations
        return QpStatus.ITERATIONS_EXHAUSTED, iterations


class DaqpProgram(Program):
    """daqp: a dual active-set method, exact in a finite number of steps."""

    def __init__(self, rows: int = 7) -> None:
        self._model = daqp.Model()
        self._upper = np.zeros(7 + rows)
        self._lower = np.zeros(7 + rows)
        self._started = False

    def solve(self, H: Array, gradient: Array, lower: Array, upper: Array, A: Array, row_lower: Array, row_upper: Array,
              x: Array) -> tuple[QpStatus, int]:  # fmt: skip
        self._upper[:7] = upper
        self._upper[7:] = row_upper
        self._lower[:7] = lower
        self._lower[7:] = row_lower
        if self._started:
            flag = self._model.update(H=H, f=gradient, A=A, bupper=self._upper, blower=self._lower)
        else:
            flag = self._model.setup(H, gradient, A, self._upper, self._lower)[0]
            self._model.settings = {"iter_limit": DAQP_ITERATIONS, "primal_tol": 1e-9}
            self._started = True
        if flag < 0:
            self._started = False
            return QpStatus.INFEASIBLE, 0
        solution, _, flag, info = self._model.solve()
        iterations = int(info["iterations"])
        x[:] = solution
        if flag > 0:
            error = optimality_error(H, gradient, lower, upper, A, row_lower, row_upper, x, info["lam"])
            if error <= OPTIMALITY_TOLERANCE:
                return QpStatus.SOLVED, iterations
            self._started = False
            return QpStatus.WRONG_ANSWER, iterations
        self._started = False
        return (QpStatus.INFEASIBLE if flag == -1 else QpStatus.ITERATIONS_EXHAUSTED), iterations


class SecondOpinion:
    """Asks the second program where the first one has no acceptable answer. Iterations are counted together."""

    def __init__(self, first: Program, second: Program) -> None:
        self._first = first
        self._second = second

    def solve(self, H: Array, gradient: Array, lower: Array, upper: Array, A: Array, row_lower: Array, row_upper: Array,
              x: Array) -> tuple[QpStatus, int]:  # fmt: skip
        """See Program. The status is the second program's where it was asked."""
        status, iterations = self._first.solve(H, gradient, lower, upper, A, row_lower, row_upper, x)
        if status is QpStatus.SOLVED:
            return status, iterations
        status, more = self._second.solve(H, gradient, lower, upper, A, row_lower, row_upper, x)
        return status, iterations + more


def program(solver: QpSolver, rows: int = 7) -> Program:
    """Return a fresh program for so many rows: our active set first, then the chosen library, and the other one as the
    last opinion."""
    libraries: tuple[Program, Program] = (ProxqpProgram(rows), DaqpProgram(rows))
    if solver is QpSolver.DAQP:
        libraries = libraries[1], libraries[0]
    return SecondOpinion(ActiveSetProgram(rows), SecondOpinion(*libraries))
