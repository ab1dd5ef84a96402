"""Limits of the QP that bind in whole runs: which ones, that each answer in the log is the optimum, and a clean end.

No grab of the table comes near the hardware's limits, so the controller's are drawn inside them, as a lab would for a
delicate cell; robot and judge keep theirs.
"""

from dataclasses import dataclass, replace

import numpy as np
import pytest

import rtstack.control.tick
from hal.limits import FR3
from rtstack.cells import default_cell_file, open_cell
from rtstack.control.impedance import quadratic_cost, task_inertia
from rtstack.control.limits import acceleration_bounds, torque_bounds
from rtstack.control.program import DaqpProgram
from rtstack.log.reader import read_log
from rtstack.samples import QpStatus
from rtstack.trials.assembly import arm_controllers, cell_parameters
from rtstack.trials.company import Company
from rtstack.trials.demonstration import run_demonstration
from rtstack.trials.record import open_log
from rtstack.trials.specification import DemonstrationSpecification

Q_UPPER, DQ_MAX = 1, 2  # rows of the limits' table
TOUCHES = 1e-5  # rad/s^2 and Nm: as near as the solvers come


@dataclass(frozen=True, slots=True)
class Tightened:
    """One limit of one joint (from 0), rad, rad/s or Nm; without it the joint goes beyond."""

    kind: str
    joint: int
    bound: float


# a grab without them turns joint 4 to -2.08 rad, joint 2 at up to 0.78 rad/s, and takes 22 Nm of joint 1
POSITION, VELOCITY, TORQUE = Tightened("position", 3, -2.1), Tightened("velocity", 1, 0.6), Tightened("torque", 0, 18.0)


@pytest.fixture
def tighten(monkeypatch):
    """Give controllers that are made from now on a limit inside the hardware's."""

    def do(limit: Tightened) -> None:
        if limit.kind == "torque":
            tau_max = np.array(FR3.tau_max)
            tau_max[limit.joint] = limit.bound
            monkeypatch.setattr(rtstack.control.tick, "FR3", replace(FR3, tau_max=tuple(tau_max)))
        else:
            table = rtstack.control.tick.LIMITS_TABLE.copy()
            table[Q_UPPER if limit.kind == "position" else DQ_MAX, limit.joint] = limit.bound
            monkeypatch.setattr(rtstack.control.tick, "LIMITS_TABLE", table)

    return do


def _active(arm, x, q, dq) -> set[tuple[str, int]]:
    """Which limits the solution x (7,) touches, as (kind, joint)."""
    work, table = arm.workspace[0], arm.limits_table
    tau = work["M"] @ x
    torque = (tau > work["tau_upper"] - TOUCHES) | (tau < work["tau_lower"] + TOUCHES)
    above, below = x > work["upper"] - TOUCHES, x < work["lower"] + TOUCHES
    room = np.where(above, table[1] - q, q - table[0])
    fastest = np.sqrt(2.0 * table[4] * np.maximum(room, 0.0)) - table[3]
    found = {("torque", int(j)) for j in np.flatnonzero(torque)}
    for j in np.flatnonzero(above | below):
        found.add(("position" if fastest[j] < table[2, j] else "velocity", int(j)))
    return found


def _active_sets(cell, log) -> list[set[tuple[str, int]]]:
    """What binds in each tick with a solver's answer, both arms', once that answer is shown to be the optimum.

    Each QP is made anew from the log and solved exactly: DaqpProgram calls solved what meets the KKT conditions.
    """
    parameters, found = cell_parameters(cell), []
    p = parameters.control
    for side, arm in zip(("left", "right"), arm_controllers(cell, parameters), strict=True):
        samples, controls = log.topic(f"/{side}/arm"), log.topic(f"/{side}/control")
        assert set(controls["qp_status"].tolist()) <= {QpStatus.NOT_USED, QpStatus.UNCONSTRAINED, QpStatus.SOLVED}
        assert not samples["current_errors"].any()
        work, x = arm.workspace[0], np.zeros(7)
        for k in np.flatnonzero(controls["qp_status"] == QpStatus.SOLVED):
            for name in ("q", "dq", "tau_J", "O_F_ext_hat_K"):
                arm.sample[name][0] = samples[name][k]
            arm.observe()
            arm.control["wrench_desired"][0], arm.control["beta"] = controls["wrench_desired"][k], controls["beta"][k]
            task_inertia(work)
            quadratic_cost(
                work, arm.control[0], p.posture_joint, p.weight_impedance, p.weight_posture, p.regularisation
            )
            state = samples["q"][k], samples["dq"][k]
            acceleration_bounds(*state, arm.limits_table, p.period_s, work["lower"], work["upper"])
            torque_bounds(work, arm.tau_max)
            problem = [work[n] for n in ("H", "gradient", "lower", "upper", "M", "tau_lower", "tau_upper")]
            assert DaqpProgram().solve(*problem, x)[0] is QpStatus.SOLVED
            work["ddq"], work["tau_previous"] = x, samples["tau_applied"][k - 1]
            arm._torque()
            np.testing.assert_allclose(arm.sample["tau_desired"][0], samples["tau_desired"][k], rtol=0, atol=2e-3)
            found.append(_active(arm, x, *state))
    return found


@pytest.mark.parametrize("limit", [POSITION, VELOCITY, TORQUE], ids=lambda limit: limit.kind)
def test_a_trial_at_a_limit_of_the_controller_is_optimal_clean_and_a_success(cell, runner, tighten, tmp_path, limit):
    tighten(limit)
    result = runner.run(log=tmp_path / "trial.mcap")
    assert (result.success, result.failure_reason, result.safety_interventions) == (True, None, 0)
    log = read_log(tmp_path / "trial.mcap")
    active = _active_sets(cell, log)
    assert sum((limit.kind, limit.joint) in found for found in active) > 100
    assert all(found for found in active)  # a solver is asked only where something binds
    if limit.kind == "position":
        assert max(log.topic(f"/{side}/arm")["q"][:, limit.joint].max() for side in ("left", "right")) < limit.bound


def test_a_demonstration_at_a_limit_of_velocity_is_optimal_and_clean(cell, tighten, tmp_path):
    tighten(VELOCITY)
    specification = DemonstrationSpecification()
    opened = open_cell("direct", specification.object, 0.0, specification.seed)
    try:
        log = open_log(tmp_path / "ref.mcap", specification, cell, "direct", default_cell_file())
        result = run_demonstration(specification, cell, opened, Company(log))
    finally:
        opened.close()
    assert (result.success, result.safety_interventions) == (True, 0)
    active = _active_sets(cell, read_log(tmp_path / "ref.mcap"))
    assert sum((VELOCITY.kind, VELOCITY.joint) in found for found in active) > 100
