"""Tasks and limits of the QP as objects: the paper's, and those of a package of another author."""

import numpy as np
import pinocchio as pin
import pytest
from joint_tracking.arms_apart import JOINTS, LEAST_M, ArmsApart
from joint_tracking.elbow import ElbowHeight
from joint_tracking.qp_limits import AboveTable, PadForce, VelocityDamper

from rtstack.control.active_set import optimality_error
from rtstack.control.limits import JointLimit, Limit, paper_limits
from rtstack.control.link_point import LinkPoint, distance_row
from rtstack.control.program import ActiveSetProgram, DaqpProgram, ProxqpProgram, program
from rtstack.control.qp_law import QpLaw
from rtstack.control.tasks import ImpedanceTask, PostureTask, Task, paper_tasks
from rtstack.control.tick import ArmController
from rtstack.model.arm_model import ArmModel
from rtstack.model.cell_description import CellDescription
from rtstack.samples import Mode, QpSolver, QpStatus
from tests.support.arm_controller import make_arm_controller


def arm_at(cell: CellDescription, seed: int, side: int = 0) -> ArmController:
    """An arm near its home pose, in motion, whose setpoint is near."""
    rng = np.random.default_rng(seed)
    arm = make_arm_controller(ArmModel(cell.arms[side], cell.pad))
    arm.pursue(arm.parameters.stiffness, arm.parameters.posture_gain)
    arm.sample["q"][0] = np.array(cell.arms[side].home) + 0.1 * rng.normal(size=7)
    arm.sample["dq"][0] = 0.2 * rng.normal(size=7)
    arm.observe()
    work = arm.workspace
    arm.setpoint["position"][0] = work["position"][0] + 0.01 * rng.normal(size=3)
    arm.setpoint["rotation"][0] = pin.exp3(0.05 * rng.normal(size=3)) @ work["rotation"][0]
    arm.setpoint["xi"][0] = arm.sample["q"][0, 0]
    arm.setpoint["velocity_weight"] = 1.0
    arm.workspace["tau_previous"][0] = work["gravity"][0] * 0.0
    return arm


def solution(arm: ArmController, law: QpLaw) -> np.ndarray:
    """Let the law find its torque; return ddq (7,)."""
    assert law.command(Mode.ANTE_IMPACT) in (QpStatus.UNCONSTRAINED, QpStatus.SOLVED)
    return arm.workspace["ddq"][0].copy()


class PlainTask(Task):
    """A task that writes in numpy what another one has written."""

    def __init__(self, like: Task) -> None:
        super().__init__(len(like.target))
        self._like = like

    def update(self) -> None:
        self.jacobian[:], self.target[:] = self._like.jacobian, self._like.target


@pytest.mark.parametrize("seed", range(5))
def test_the_cost_is_the_sum_of_its_tasks(cell, seed):
    """Hessian and gradient are those of the definition, whatever the number of tasks and rows."""
    arm = arm_at(cell, seed)
    rng = np.random.default_rng(seed)
    own = Task(3, weight=0.7)
    own.jacobian[:], own.target[:] = rng.normal(size=(3, 7)), rng.normal(size=3)
    law = QpLaw(arm, [*paper_tasks(arm), own])
    solution(arm, law)
    H, gradient = 1e-8 * np.eye(7), np.zeros(7)
    for task in law.tasks:
        H += task.weight[0] * task.jacobian.T @ task.jacobian
        gradient -= task.weight[0] * task.jacobian.T @ task.target
    np.testing.assert_allclose(arm.workspace["H"][0], H, rtol=0, atol=1e-12)
    np.testing.assert_allclose(arm.workspace["gradient"][0], gradient, rtol=0, atol=1e-10)


def test_plain_python_and_compiled_tasks_give_the_same_torque(cell):
    """In any order, beside compiled ones."""
    arm = arm_at(cell, 1)
    default = QpLaw(arm)
    default.command(Mode.ANTE_IMPACT)
    wanted = arm.sample["tau_desired"][0].copy()
    impedance, posture = ImpedanceTask(arm), PostureTask(arm)
    impedance.weight[:] = posture.weight[:] = 0.0
    law = QpLaw(arm, [impedance, PlainTask(impedance), posture, PlainTask(posture)])
    law.command(Mode.ANTE_IMPACT)
    np.testing.assert_allclose(arm.sample["tau_desired"][0], wanted, rtol=0, atol=1e-10)
    assert list(law.costs()) == ["PlainTask"]
    assert law.costs()["PlainTask"] > 0.0
    assert default.costs() == {}


class Row(Limit):
    """Rows that are given."""

    def __init__(self, jacobian: np.ndarray, lower: float) -> None:
        super().__init__(len(jacobian))
        self.jacobian[:], self.lower[:] = jacobian, lower


class Slow(JointLimit):
    """No joint accelerates by more than that."""

    def __init__(self, most: float) -> None:
        super().__init__()
        self.lower[:], self.upper[:] = -most, most


@pytest.mark.parametrize("seed", range(8))
def test_rows_and_bounds_of_all_limits_are_kept_at_the_optimum(cell, seed):
    """By the compiled active set, whose answer is another solver's."""
    arm = arm_at(cell, seed)
    free = solution(arm, QpLaw(arm))
    row = np.random.default_rng(seed).normal(size=(2, 7))
    limits = [*paper_limits(arm), Row(row, float((row @ free).max()) + 0.5), Slow(1.1 * float(np.abs(free).max()))]
    law = QpLaw(arm, limits=limits)
    assert law.command(Mode.ANTE_IMPACT) is QpStatus.SOLVED
    x = arm.workspace["ddq"][0].copy()
    assert np.all(row @ x >= limits[2].lower - 1e-6)
    assert np.all(np.abs(x) <= limits[3].upper + 1e-6)
    H, gradient, *bounds, _ = law._problem
    exact = np.zeros(7)
    assert DaqpProgram(9).solve(H, gradient, *bounds, exact)[0] is QpStatus.SOLVED
    np.testing.assert_allclose(x, exact, rtol=0, atol=1e-4)


@pytest.mark.parametrize("rows", [0, 1, 9, 40])
@pytest.mark.parametrize("solver", [ActiveSetProgram, ProxqpProgram, DaqpProgram, lambda n: program(QpSolver.DAQP, n)])
def test_programs_of_any_number_of_rows_agree(rows, solver):
    rng = np.random.default_rng(rows)
    for _ in range(20):
        root, A = rng.normal(size=(7, 7)), rng.normal(size=(rows, 7))
        H, gradient = root @ root.T + np.eye(7), 10.0 * rng.normal(size=7)
        inside = rng.normal(size=7)  # feasible
        lower, upper = inside - rng.uniform(0.1, 1.0, 7), inside + rng.uniform(0.1, 1.0, 7)
        middle = A @ inside
        row_lower, row_upper = middle - rng.uniform(0.1, 1.0, rows), middle + rng.uniform(0.1, 1.0, rows)
        x, exact = np.zeros(7), np.zeros(7)
        assert solver(rows).solve(H, gradient, lower, upper, A, row_lower, row_upper, x)[0] is QpStatus.SOLVED
        program(QpSolver.DAQP, rows).solve(H, gradient, lower, upper, A, row_lower, row_upper, exact)
        np.testing.assert_allclose(x, exact, rtol=0, atol=1e-3)


def test_a_violated_row_is_an_error_of_the_answer():
    H, wide, x = np.eye(7), np.full(7, 10.0), np.zeros(7)
    row, gradient = np.ones((1, 7)), np.zeros(7)
    error = optimality_error(H, gradient, -wide, wide, row, np.array([1.0]), np.array([9.0]), x, np.zeros(8))
    assert error == pytest.approx(1.0)


@pytest.mark.parametrize("joint", range(1, 8))
def test_a_point_of_a_link_is_where_pinocchio_says(cell, joint):
    arm, rng = arm_at(cell, joint), np.random.default_rng(joint)
    offset = 0.2 * rng.normal(size=3)
    point = LinkPoint(arm, joint, tuple(offset))
    point.update()
    model = arm.model.pin_model.copy()
    frame = model.addFrame(pin.Frame("point", joint, 0, pin.SE3(np.eye(3), offset), pin.FrameType.OP_FRAME))
    data = model.createData()
    dq = arm.sample["dq"][0]
    pin.forwardKinematics(model, data, arm.sample["q"][0], dq, np.zeros(7))
    pin.updateFramePlacements(model, data)
    axes = pin.LOCAL_WORLD_ALIGNED
    np.testing.assert_allclose(point.position, data.oMf[frame].translation, atol=1e-12)
    np.testing.assert_allclose(point.velocity, pin.getFrameVelocity(model, data, frame, axes).linear, atol=1e-12)
    drift = pin.getFrameClassicalAcceleration(model, data, frame, axes).linear
    np.testing.assert_allclose(point.drift, drift, atol=1e-10)
    np.testing.assert_allclose(point.jacobian @ dq, point.velocity, atol=1e-12)
    assert not point.jacobian[:, joint:].any()


def test_a_distance_has_the_derivatives_that_differences_show(cell):
    left, right = (arm_at(cell, 3, side) for side in (0, 1))
    points = [LinkPoint(arm, 4) for arm in (left, right)]
    row, h = np.zeros(7), 1e-5

    def distance(t: float) -> float:
        for arm, point in zip((left, right), points, strict=True):
            arm.observed_at(q0[arm] + t * dq[arm])
            point.update()
        return distance_row(points[0].arrays, points[1].arrays, row)[0]

    q0 = {arm: arm.sample["q"][0].copy() for arm in (left, right)}
    dq = {arm: arm.sample["dq"][0].copy() for arm in (left, right)}
    before, here, after = (distance(t) for t in (-h, 0.0, h))
    distance(0.0)
    _, rate, drift = distance_row(points[0].arrays, points[1].arrays, row)
    assert rate == pytest.approx((after - before) / (2 * h), abs=1e-8)
    assert drift == pytest.approx((after - 2 * here + before) / h**2, abs=1e-4)


def test_the_elbow_task_of_the_example_is_a_least_squares_problem_beside_the_impedance(cell):
    """Its answer is numpy's, and the elbow comes nearer to its target than without the task."""
    arm = arm_at(cell, 4)
    elbow, impedance = ElbowHeight(arm, 0.4), ImpedanceTask(arm)
    without = solution(arm, QpLaw(arm, limits=[JointLimit()]))
    ddq = solution(arm, QpLaw(arm, [impedance, elbow], [JointLimit()]))
    root = np.sqrt(elbow.weight[0])
    rows = np.vstack([impedance.jacobian, root * elbow.jacobian, 1e-4 * np.eye(7)])
    values = np.concatenate([impedance.target, root * elbow.target, np.zeros(7)])
    np.testing.assert_allclose(ddq, np.linalg.lstsq(rows, values, rcond=None)[0], rtol=1e-6)
    assert abs(elbow.jacobian @ ddq - elbow.target) < abs(elbow.jacobian @ without - elbow.target)


def test_limits_of_the_example_hold_the_acceleration_that_is_found(cell):
    left, right = (arm_at(cell, 5, side) for side in (0, 1))
    lines = np.array(cell.left.home) + 0.02
    for limit in (
        ArmsApart(left, right), AboveTable(left, cell.table.top_z), VelocityDamper(left, lines - 0.04, lines),
        PadForce(left, np.array([0.0, 1.0, 0.0]), 5.0),
    ):  # fmt: skip
        law = QpLaw(left, limits=[*paper_limits(left), limit])
        assert law.command(Mode.ANTE_IMPACT) <= QpStatus.SOLVED, limit
        row = limit.jacobian @ left.workspace["ddq"][0]
        assert np.all(row >= limit.lower - 1e-6), limit
        assert np.all(row <= limit.upper + 1e-6), limit
        assert np.isfinite(limit.jacobian).all()
        assert limit.jacobian.any(axis=1).all()
    assert len(ArmsApart(left, right).lower) == len(JOINTS) ** 2
    assert LEAST_M > 0.0


@pytest.mark.parametrize(
    ("spoil", "message"),
    [
        (lambda task: setattr(task, "target", [0.0]), "target: expected an array of float64 (1,), found list"),
        (lambda task: setattr(task, "jacobian", np.zeros((1, 6))), "jacobian: expected an array of float64 (1, 7)"),
        (lambda task: setattr(task, "weight", 1.0), "weight: expected an array of float64 (1,), found float"),
    ],
)
def test_arrays_of_another_shape_are_refused(cell, spoil, message):
    arm, task = arm_at(cell, 0), Task(1)
    spoil(task)
    with pytest.raises(ValueError, match=r"^Task") as refused:
        QpLaw(arm, [task])
    assert message in str(refused.value)


@pytest.mark.parametrize("wrong", [lambda: Task(0), lambda: Task(1, -1.0), lambda: Limit(0), lambda: Task(2, np.nan)])
def test_no_rows_and_no_weight_are_refused(wrong):
    with pytest.raises(ValueError, match="not"):
        wrong()


def test_a_bound_that_is_no_number_is_no_solution(cell):
    """The judge then stops the arms: no bound would be less than what was asked for."""
    arm = arm_at(cell, 2)
    law = QpLaw(arm, limits=[*paper_limits(arm), Row(np.ones((1, 7)), np.nan)])
    assert law.command(Mode.ANTE_IMPACT) > QpStatus.SOLVED


def test_a_joint_that_is_not_there_is_refused(cell):
    with pytest.raises(ValueError, match="joint 8: expected 1 to 7"):
        LinkPoint(arm_at(cell, 0), 8)
