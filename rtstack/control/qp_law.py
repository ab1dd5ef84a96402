"""The law of an arm that is a QP: its tasks and limits become a torque. The paper's controller is one of these.

    min  sum over tasks  weight |jacobian ddq - target|^2 + regularisation |ddq|^2
    with lower <= jacobian ddq <= upper of each limit,

and tau = M ddq + C dq + friction (4), gravity excluded. What is compiled, of this package or another one, becomes one
compiled function; what is plain Python is called in its place in the order, see `costs`.
"""

import math
import time
from collections.abc import Callable, Sequence
from statistics import median
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hal.base.arrays import Array
from hal.compilation import Step, bound, bound_in_turn, compiled
from rtstack.control.controller import ArmLaw, ObservedArm
from rtstack.control.dense import cholesky, solve_lower, solve_lower_transposed
from rtstack.control.impedance import factor_mass
from rtstack.control.limits import JointLimit, Limit, paper_limits
from rtstack.control.program import program
from rtstack.control.tasks import Task, paper_tasks
from rtstack.samples import Mode, QpSolver, QpStatus

UNCONSTRAINED = int(QpStatus.UNCONSTRAINED)
_UNCONSTRAINED = QpStatus.UNCONSTRAINED
Part = Step | Callable[[], None]  # compiled, or plain Python
_CALLS = 50  # to time a part that is plain Python


@compiled
def begin_problem(workspaces, regularisation):
    """Factor M, and begin a problem without tasks and limits."""
    work = workspaces[0]
    factor_mass(work)
    for i in range(7):
        work.gradient[i] = 0.0
        for j in range(7):
            work.H[i, j] = 0.0
        work.H[i, i] = regularisation


@compiled
def add_task(workspaces, jacobian, target, weight):
    """Add a task (rows, 7), (rows,), (1,) to Hessian and gradient."""
    work, w = workspaces[0], weight[0]
    for i in range(7):
        # seven sums that the processor adds up side by side, while the number of rows is any
        s0 = s1 = s2 = s3 = s4 = s5 = s6 = product = 0.0
        for k in range(target.shape[0]):
            a = jacobian[k, i]
            s0 += a * jacobian[k, 0]
            s1 += a * jacobian[k, 1]
            s2 += a * jacobian[k, 2]
            s3 += a * jacobian[k, 3]
            s4 += a * jacobian[k, 4]
            s5 += a * jacobian[k, 5]
            s6 += a * jacobian[k, 6]
            product += a * target[k]
        row = work.H[i]
        row[0] += w * s0
        row[1] += w * s1
        row[2] += w * s2
        row[3] += w * s3
        row[4] += w * s4
        row[5] += w * s5
        row[6] += w * s6
        work.gradient[i] -= w * product


@compiled
def add_bounds(lower, upper, all_lower, all_upper, first):
    """Bound ddq (7,) by a limit too. first: whether it is the first one that does."""
    for i in range(7):
        all_lower[i] = lower[i] if first else max(all_lower[i], lower[i])
        all_upper[i] = upper[i] if first else min(all_upper[i], upper[i])


@compiled
def add_rows(jacobian, lower, upper, all_jacobian, all_lower, all_upper, first):
    """Write a limit's rows to those of the problem, from the row `first` on."""
    for k in range(lower.shape[0]):
        all_lower[first + k], all_upper[first + k] = lower[k], upper[k]
        for j in range(7):
            all_jacobian[first + k, j] = jacobian[k, j]


@compiled
def torque(workspaces, samples, limits):
    """tau = M ddq + C dq + friction (4), gravity excluded, at most tau_step Nm away from the last applied torque."""
    work = workspaces[0]
    out = samples[0].tau_desired
    tau_step = limits[0].tau_step
    for i in range(7):
        tau = work.coriolis[i] + work.friction[i]
        for j in range(7):
            tau += work.M[i, j] * work.ddq[j]
        last = work.tau_previous[i]
        out[i] = min(max(tau, last - tau_step), last + tau_step)


@compiled
def solve_free(samples, workspaces, controls, limits, lower, upper, jacobian, row_lower, row_upper):
    """Find the minimiser without limits. Where none is active it is the solution: True, tau_desired is out.

    lower, upper (7,): bounds of ddq; jacobian (rows, 7), row_lower, row_upper (rows,): the rows of all limits.
    """
    work, control = workspaces[0], controls[0]
    if not cholesky(work.H, 7, work.factor):
        return False
    for i in range(7):
        work.ddq[i] = -work.gradient[i]
    solve_lower(work.factor, 7, work.ddq)
    solve_lower_transposed(work.factor, 7, work.ddq)
    for i in range(7):
        if not (lower[i] <= work.ddq[i] <= upper[i]):
            return False
    for k in range(row_lower.shape[0]):
        row = 0.0
        for j in range(7):
            row += jacobian[k, j] * work.ddq[j]
        if not (row_lower[k] <= row <= row_upper[k]):
            return False
    torque(workspaces, samples, limits)
    control.qp_status = UNCONSTRAINED
    control.qp_iterations = 0
    return True


class _Joined(NamedTuple):
    """The limits of a problem: lower <= ddq <= upper (7,), row_lower <= jacobian ddq <= row_upper (rows,)."""

    lower: Array
    upper: Array
    jacobian: Array
    row_lower: Array
    row_upper: Array


class QpLaw(ArmLaw):
    """The ArmLaw of an arm whose torque is the solution of a QP.

    Attributes:
        tasks, limits: in the order in which they are updated.
        program: what solves a problem with active limits; see rtstack.control.program.
    """

    def __init__(
        self,
        arm: ObservedArm,
        tasks: Sequence[Task] | None = None,
        limits: Sequence[Limit] | None = None,
        solver: QpSolver = QpSolver.PROXQP,
    ) -> None:
        """Compile it, before a clock runs. Raises ValueError where a task or limit has arrays of another shape.

        Args:
            arm: whose torque it finds.
            tasks: by default the paper's, `paper_tasks(arm)`.
            limits: by default the paper's, `paper_limits(arm)`. A list without them leaves the joints' limits to the
                judge, which stops the arms there.
            solver: the library that is used where the compiled active set has no answer.
        """
        self.tasks = tuple(paper_tasks(arm) if tasks is None else tasks)
        self.limits = tuple(paper_limits(arm) if limits is None else limits)
        for part in (*self.tasks, *self.limits):
            _check(part)
        work = arm.workspace[0]
        joined, steps = _joined(self.limits)
        self.program = program(solver, len(joined.row_lower))
        bounds, rows = (joined.lower, joined.upper), (joined.jacobian, joined.row_lower, joined.row_upper)
        self._problem = work["H"], work["gradient"], *bounds, *rows, work["ddq"]
        self._tau_desired, self._tau_previous = arm.sample[0]["tau_desired"], work["tau_previous"]
        self._qp_status, self._qp_iterations = arm.control["qp_status"], arm.control["qp_iterations"]
        self._torque = bound(torque, arm.workspace, arm.sample, arm.limits)
        pose: list[Part] = [(begin_problem, (arm.workspace, arm.parameters.regularisation))]
        for task in self.tasks:
            pose += task.steps or [task.update]
            pose.append((add_task, (arm.workspace, task.jacobian, task.target, task.weight)))
        solve: Part = (solve_free, (arm.sample, arm.workspace, arm.control, arm.limits, *joined))
        self._find = _fused([*pose, *steps, solve])

    def follow(self, ante: NDArray[np.void], post: NDArray[np.void]) -> None:
        """See ArmLaw: the setpoint is enough."""

    def observe(self) -> None:
        """See ArmLaw: a task or limit is updated in `command`."""

    def command(self, mode: Mode) -> QpStatus:
        """Find tau_desired for the setpoint. Where the QP has no answer the last torque stays."""
        if self._find():
            return _UNCONSTRAINED
        status, iterations = self.program.solve(*self._problem)
        if status <= QpStatus.SOLVED:
            self._torque()
        else:
            self._tau_desired[:] = self._tau_previous
        self._qp_status[0] = status
        self._qp_iterations[0] = iterations
        return status

    def costs(self) -> dict[str, float]:
        """Return what each task and limit that is plain Python takes of a tick, by the name of its class, median us.

        Never in a tick.
        """
        found: dict[str, float] = {}
        for part in (*self.tasks, *self.limits):
            if not part.steps:
                found[type(part).__name__] = 1e-3 * median(_took_ns(part.update) for _ in range(_CALLS))
        return found


def _took_ns(call: Callable[[], None]) -> int:
    began = time.perf_counter_ns()
    call()
    return time.perf_counter_ns() - began


def _check(part: Task | Limit) -> None:
    """Raise ValueError where a part's arrays have another shape or type than the QP reads."""
    rows = len(part.jacobian)
    expected: dict[str, tuple[int, ...]] = {"jacobian": (rows, 7)}
    expected |= {"target": (rows,), "weight": (1,)} if isinstance(part, Task) else {"lower": (rows,), "upper": (rows,)}
    for name, shape in expected.items():
        array = getattr(part, name)
        if not isinstance(array, np.ndarray) or array.shape != shape or array.dtype != np.float64:
            found = f"{array.dtype} {array.shape}" if isinstance(array, np.ndarray) else type(array).__name__
            raise ValueError(f"{type(part).__name__}.{name}: expected an array of float64 {shape}, found {found}")


def _joined(limits: Sequence[Limit]) -> tuple[_Joined, list[Part]]:
    """Return the bounds and rows of all limits, and what writes them in each tick.

    Of a kind with one limit alone, they are its own arrays.
    """
    steps: list[Part] = [step for limit in limits for step in limit.steps or [limit.update]]
    alone = [limit for limit in limits if isinstance(limit, JointLimit)]
    lower, upper = np.full(7, -math.inf), np.full(7, math.inf)
    if len(alone) == 1:
        lower, upper = alone[0].lower, alone[0].upper
    else:
        for each in alone:
            steps.append((add_bounds, (each.lower, each.upper, lower, upper, each is alone[0])))
    found = [(limit.jacobian, limit.lower, limit.upper) for limit in limits if not isinstance(limit, JointLimit)]
    if len(found) == 1:
        return _Joined(lower, upper, *found[0]), steps
    count, first = sum(len(own_lower) for _, own_lower, _ in found), 0
    joined = _Joined(lower, upper, np.zeros((count, 7)), np.zeros(count), np.zeros(count))
    for jacobian, own_lower, own_upper in found:
        steps.append((add_rows, (jacobian, own_lower, own_upper, *joined[2:], first)))
        first += len(own_lower)
    return joined, steps


def _fused(steps: Sequence[Part]) -> Callable[[], bool]:
    """Return one call for these steps, of which compiled ones that follow each other are one; the last is compiled."""
    calls: list[Callable[[], None]] = []
    run: list[Step] = []
    for step in steps:
        if isinstance(step, tuple):
            run.append(step)
            continue
        if run:
            calls.append(bound_in_turn(run))
        calls.append(step)
        run = []
    last = bound_in_turn(run)

    def in_turn() -> bool:
        for call in calls:
            call()
        return last()

    return in_turn if calls else last
