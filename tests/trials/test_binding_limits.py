"""Limits that bind in whole runs: which ones, that each answer in the log is the optimum, and an end that the judge has
no part in.

No grab of the table comes near the hardware's limits, so a cell draws its own inside them, as a lab would for delicate
things: judge and controller both take them from its table `[safety]`.
"""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest

from rtstack.cells import default_cell_file, open_cell
from rtstack.control.impedance import factor_mass, task_inertia
from rtstack.control.limits import acceleration_bounds, external_acceleration, torque_bounds
from rtstack.control.parameters import ControlParameters
from rtstack.control.program import DaqpProgram
from rtstack.control.records import POINT
from rtstack.log.reader import read_log
from rtstack.loop.plan import SessionPlan
from rtstack.model.cell_description import CellDescription
from rtstack.model.rotation import exp_so3
from rtstack.references.demonstration import end_effector_pose
from rtstack.samples import Mode, QpStatus
from rtstack.trials.assembly import arm_controllers, cell_parameters
from rtstack.trials.move import run_motion
from rtstack.trials.record import open_log
from rtstack.trials.run_context import RunContext
from rtstack.trials.specification import DemonstrationSpecification
from rtstack.trials.tightening import limits_of_arms
from tests.support.runs import demonstrate
from tests.support.sampling import sampled

TOUCHES = 1e-5  # rad/s^2 and Nm: as near as the solvers come
SECOND = 1000  # ticks


@dataclass(frozen=True, slots=True)
class Tightened:
    """One limit of one joint (from 0) in the table `[safety]`: rad, rad/s or Nm; without it the joint goes beyond."""

    kind: str
    name: str
    joint: int
    bound: float

    def cell(self, cell: CellDescription) -> CellDescription:
        """Return the cell with it."""
        values = list(getattr(limits_of_arms(cell)[0], self.name))
        values[self.joint] = self.bound
        return replace(cell, safety={**cell.safety, self.name: values})


# a grab without them turns joint 2 to -0.28 rad at up to 0.78 rad/s, and takes 22 Nm of joint 1
POSITION = Tightened("position", "q_lower", 1, -0.16)
VELOCITY = Tightened("velocity", "dq_max", 1, 0.32)
TORQUE = Tightened("torque", "tau_J_max", 0, 20.0)


def active(arm, x, q, dq) -> set[tuple[str, int]]:
    """Which limits the solution x (7,) touches, as (kind, joint)."""
    work, limits = arm.workspace[0], arm.limits[0]
    tau = work["M"] @ x
    torque = (tau > work["tau_upper"] - TOUCHES) | (tau < work["tau_lower"] + TOUCHES)
    above, below = x > work["upper"] - TOUCHES, x < work["lower"] + TOUCHES
    room = np.where(above, limits["q_upper"] - q, q - limits["q_lower"])
    braked = np.sqrt(2.0 * limits["deceleration"] * np.maximum(room, 0.0)) - limits["velocity_offset"]
    found = {("torque", int(j)) for j in np.flatnonzero(torque)}
    for j in np.flatnonzero(above | below):
        found.add(("position" if braked[j] < limits["dq_max"][j] else "velocity", int(j)))
    return found


def active_sets(cell, log) -> list[list[set[tuple[str, int]]]]:
    """What binds in each tick of both arms, once each solver's answer is shown to be the optimum.

    Each QP is made anew from the log and solved exactly: DaqpProgram calls solved what meets the KKT conditions.
    """
    parameters, both = cell_parameters(cell), []
    p = parameters.control
    for side, arm in zip(("left", "right"), arm_controllers(cell, parameters), strict=True):
        samples, controls = log.topic(f"/{side}/arm"), log.topic(f"/{side}/control")
        assert set(controls["qp_status"].tolist()) <= {QpStatus.NOT_USED, QpStatus.UNCONSTRAINED, QpStatus.SOLVED}
        assert not samples["current_errors"].any()
        work, x = arm.workspace[0], np.zeros(7)
        found: list[set[tuple[str, int]]] = [set() for _ in samples]
        for k in np.flatnonzero(controls["qp_status"] == QpStatus.SOLVED):
            for name in ("q", "dq", "tau_J", "O_F_ext_hat_K"):
                arm.sample[name][0] = samples[name][k]
            arm.observe()
            for name in ("wrench_desired", "beta", "momentum_residual"):
                arm.control[name][0] = controls[name][k]
            factor_mass(work)
            task_inertia(work)
            cost = costs(work, arm.control[0], p)
            state, limits = (samples["q"][k], samples["dq"][k]), arm.limits[0]
            external_acceleration(work, arm.control[0])
            acceleration_bounds(*state, work["seven"], limits, work["lower"], work["upper"])
            torque_bounds(work, limits)
            problem = [work[n] for n in ("lower", "upper", "M", "tau_lower", "tau_upper")]
            assert DaqpProgram().solve(*cost, *problem, x)[0] is QpStatus.SOLVED
            work["ddq"], work["tau_previous"] = x, samples["tau_applied"][k - 1]
            arm.law._torque()
            np.testing.assert_allclose(arm.sample["tau_desired"][0], samples["tau_desired"][k], rtol=0, atol=2e-3)
            found[k] = active(arm, x, *state)
            assert found[k]  # a solver is asked only where something binds
        both.append(found)
    return both


def costs(work: np.void, control: np.void, p: ControlParameters) -> tuple[np.ndarray, np.ndarray]:
    """Hessian (7, 7) and gradient (7,) of (15) and (26), from the equations."""
    J, posture = work["J"], np.eye(7)[p.posture_joint]
    b = work["Lambda_inverse"] @ control["wrench_desired"] - work["dJdq"]
    H = p.weight_impedance * J.T @ J + p.weight_posture * np.outer(posture, posture) + p.regularisation * np.eye(7)
    return H, -p.weight_impedance * J.T @ b - p.weight_posture * control["beta"] * posture


def longest(found: list[set[tuple[str, int]]], limit: Tightened) -> int:
    """For how many ticks in a row the limit binds."""
    run = most = 0
    for here in found:
        run = run + 1 if (limit.kind, limit.joint) in here else 0
        most = max(most, run)
    return most


def rides(cell: CellDescription, path: Path, limit: Tightened, least: int) -> None:
    """Assert that the limit binds for so many ticks in a row in one of the arms, and that nothing is beyond."""
    log, limits = read_log(path), limits_of_arms(cell)[0]
    assert max(longest(found, limit) for found in active_sets(cell, log)) >= least
    for side in ("left", "right"):
        sample = log.topic(f"/{side}/arm")
        assert np.all((sample["q"] > limits.q_lower) & (sample["q"] < limits.q_upper))
        assert np.all(np.abs(sample["dq"]) < limits.dq_max)


@pytest.mark.parametrize(
    "limit", sampled((POSITION, VELOCITY, TORQUE), lambda limit: limit is not TORQUE), ids=lambda limit: limit.kind
)
def test_a_trial_along_a_limit_is_optimal_and_ends_without_an_intervention(runner, tmp_path, limit):
    tightened = replace(runner, cell=limit.cell(runner.cell))
    result = tightened.run(log=tmp_path / "trial.mcap")
    assert (result.success, result.failure_reason, result.safety_interventions) == (True, None, 0)
    rides(tightened.cell, tmp_path / "trial.mcap", limit, 100 if limit is TORQUE else SECOND)


@pytest.mark.parametrize(
    "limit",
    sampled((replace(POSITION, bound=-0.12), replace(VELOCITY, bound=0.26)), lambda limit: limit.kind == POSITION.kind),
    ids=lambda limit: limit.kind,
)
def test_a_demonstration_along_a_limit_is_optimal_and_ends_without_an_intervention(cell, tmp_path, limit):
    cell = limit.cell(cell)
    result = demonstrate(tmp_path / "ref.mcap", cell)
    assert (result.success, result.failure_reason, result.safety_interventions) == (True, None, 0)
    rides(cell, tmp_path / "ref.mcap", limit, SECOND)


def test_a_motion_into_the_vendor_s_own_limit_stays_before_it(cell, tmp_path):
    """A pad that is asked to turn about its normal, on and on, comes to rest where joint 7 may go no further."""
    parameters = cell_parameters(cell)
    n, ticks = 4500, np.arange(4500) * 1e-3
    points = np.zeros((2, n), POINT)
    for side, (arm, mounting) in enumerate(
        zip(arm_controllers(cell, parameters), (cell.left, cell.right), strict=True)
    ):
        position, rotation = end_effector_pose(arm.model, np.array(mounting.home))
        points[side]["position"], points[side]["xi"] = position, mounting.home[0]
        for k, angle in enumerate(np.minimum(0.8 * np.maximum(ticks - 0.3, 0.0), 2.4)):
            turn = np.zeros((3, 3))
            exp_so3(np.array([0.0, 0.0, angle if side == 0 else -angle]), 1.0, turn)
            points[side]["rotation"][k] = rotation @ turn
    plan = SessionPlan(points, points, Mode.TELEOPERATION, parameters.control.stiffness_teleoperation, 1e-3)
    specification = DemonstrationSpecification()
    opened = open_cell("direct", "", 0.0, 0)
    try:
        log = open_log(tmp_path / "turn.mcap", specification, cell, "direct", default_cell_file())
        reason, _ = run_motion(plan, cell, parameters, opened, RunContext(log))
    finally:
        opened.close()
    assert reason is None
    rides(cell, tmp_path / "turn.mcap", Tightened("position", "q_upper", 6, 0.0), SECOND)
