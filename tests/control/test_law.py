"""The compiled tick against the plain one, which is written from the equations."""

from types import SimpleNamespace

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from rtstack.control.modes import ModeMachine, Strategy
from rtstack.control.parameters import ControlParameters, FrictionParameters, InertiaParameters
from rtstack.control.records import POINT
from rtstack.control.tick import ArmController, CellController
from rtstack.model.arm_model import ArmModel
from rtstack.model.cell_description import CellDescription
from rtstack.safety.limits import HARDWARE, control_limits
from rtstack.samples import LawInertia, Mode, QpStatus
from tests.support.arm_controller import make_arm_controller
from tests.support.plain_tick import PlainArm, PlainLimits


def _arm(cell: CellDescription) -> ArmController:
    return make_arm_controller(ArmModel(cell.left, cell.pad))


def _random_setpoint(rng: np.random.Generator, arm: ArmController, weight: float) -> SimpleNamespace:
    rotation = pin.exp3(0.2 * rng.normal(size=3)) @ arm.model.R7 @ arm.model.R_joint_ee
    return SimpleNamespace(
        position=arm.model.p7 + arm.model.R7 @ arm.model.face + 0.01 * rng.normal(size=3),
        rotation=rotation,
        twist=0.2 * rng.normal(size=6),
        wrench_ff=5.0 * rng.normal(size=6),
        xi=arm.sample["q"][0, 0] + 0.01 * rng.normal(),
        dxi=0.1 * rng.normal(),
        beta=rng.normal(),
        velocity_weight=weight,
        stiffness=np.array(ControlParameters().stiffness),
        posture_gain=500.0,
    )


def _put(arm: ArmController, setpoint: SimpleNamespace) -> None:
    for name, value in vars(setpoint).items():
        arm.setpoint[name][0] = value


def _table(rng: np.random.Generator) -> dict[str, object]:
    """A table [safety] that draws in what the QP's limits are made of."""
    lower, upper = np.array(HARDWARE.q_lower), np.array(HARDWARE.q_upper)
    return {
        "q_lower": (lower + rng.uniform(0.0, 0.3, 7) * (upper - lower)).tolist(),
        "q_upper": (upper - rng.uniform(0.0, 0.3, 7) * (upper - lower)).tolist(),
        "dq_max": (HARDWARE.dq_max * rng.uniform(0.02, 1.0, 7)).tolist(),
        "tau_max": (HARDWARE.tau_max * rng.uniform(0.5, 1.0, 7)).tolist(),
        "tau_J_max": (HARDWARE.tau_J_max * rng.uniform(0.5, 1.0, 7)).tolist(),
        "tau_rate_max": float(rng.uniform(100.0, 1000.0)),
    }


def test_both_ticks_have_the_same_limits_from_two_sources():
    for seed in range(20):
        table = _table(np.random.default_rng(seed)) if seed else {}
        arm = control_limits(HARDWARE.tightened(table))[0]
        plain = PlainLimits(table)
        for name in ("q_lower", "q_upper", "dq_max", "deceleration", "braking", "tau_max", "tau_J_max"):
            np.testing.assert_allclose(getattr(plain, name), arm[name], rtol=1e-12, err_msg=name)
        np.testing.assert_allclose(plain.offset, arm["velocity_offset"], rtol=1e-12)
        assert plain.tau_rate_max * 1e-3 * (1.0 - 2e-4) == pytest.approx(arm["tau_step"], rel=1e-12)


@given(
    seed=st.integers(0, 2**31), weight=st.sampled_from([0.0, 0.3, 1.0]), ticks=st.integers(1, 4), tasks=st.booleans(),
    tight=st.booleans(), law=st.sampled_from(list(LawInertia)),
)  # fmt: skip
# at full speed, before the position's line
@example(seed=2177387, weight=0.0, ticks=1, tasks=True, tight=True, law=LawInertia.LINKS_AND_MOTORS)
@settings(max_examples=100, deadline=None)
def test_compiled_and_plain_tick_agree(cell, seed, weight, ticks, tasks, tight, law):
    """With both task laws, both inertias, an error of the robot's gravity compensation, and a cell's limits."""
    rng = np.random.default_rng(seed)
    table = _table(rng) if tight else {}
    control = ControlParameters(acceleration_tasks=tasks)
    friction = FrictionParameters(gravity_share=0.01 * rng.normal(size=7))
    model, limits = ArmModel(cell.left, cell.pad), HARDWARE.tightened(table)
    inertia = InertiaParameters(law_inertia=law)
    arm = make_arm_controller(model, control, inertia=inertia, friction=friction, limits=limits)
    plain = PlainArm(ArmModel(cell.left, cell.pad), control, inertia=inertia, friction=friction, safety=table)
    arm.pursue(control.stiffness, control.posture_gain)
    tolerance = {QpStatus.UNCONSTRAINED: 1e-9, QpStatus.SOLVED: 1e-3}
    for _ in range(ticks):
        q = np.array(cell.left.home) + 0.3 * rng.normal(size=7)
        q = np.clip(q, limits.q_lower, limits.q_upper)
        state = SimpleNamespace(
            q=q, dq=0.3 * rng.normal(size=7), tau_J=20.0 * rng.normal(size=7), O_F_ext_hat_K=10.0 * rng.normal(size=6)
        )
        arm.model.update(state.q, state.dq)
        for name, value in vars(state).items():
            arm.sample[name][0] = value
        setpoint = _random_setpoint(rng, arm, weight)
        _put(arm, setpoint)
        arm.observe()
        status = arm.command(Mode.ANTE_IMPACT)
        out = plain.tick(state, setpoint)
        assert status == out.status
        np.testing.assert_allclose(arm.control["wrench_desired"][0], out.wrench_desired, rtol=0, atol=1e-9)
        np.testing.assert_allclose(arm.control["beta"][0], out.beta, rtol=0, atol=1e-9)
        residual = arm.control["momentum_residual"][0]
        np.testing.assert_allclose(residual, out.momentum_residual, rtol=1e-12, atol=1e-9)
        assert arm.impact == out.impact
        np.testing.assert_allclose(
            arm.sample["tau_desired"][0], out.tau_desired, rtol=0, atol=tolerance.get(status, 1e-9)
        )
        arm.sample["tau_applied"][0] = arm.sample["tau_desired"][0]
        arm.applied()
        plain.tau_previous = arm.sample["tau_applied"][0].copy()


def test_end_effector_is_where_pinocchio_says(cell):
    arm = _arm(cell)
    rng = np.random.default_rng(3)
    model = arm.model.pin_model.copy()
    flange = model.frames[model.getFrameId("link8")]
    face = model.addFrame(
        pin.Frame("face", flange.parentJoint, 0, flange.placement * pin.SE3(np.eye(3), np.array([0, 0, 0.03])),
                  pin.FrameType.OP_FRAME)
    )  # fmt: skip
    data = model.createData()
    for _ in range(20):
        q, dq = np.array(cell.left.home) + 0.2 * rng.normal(size=7), rng.normal(size=7)
        arm.sample["q"][0], arm.sample["dq"][0] = q, dq
        arm.observe()
        pin.forwardKinematics(model, data, q, dq, np.zeros(7))
        pin.updateFramePlacements(model, data)
        work = arm.workspace[0]
        np.testing.assert_allclose(work["position"], data.oMf[face].translation, atol=1e-12)
        np.testing.assert_allclose(work["rotation"], data.oMf[face].rotation, atol=1e-12)
        velocity = pin.getFrameVelocity(model, data, face, pin.LOCAL_WORLD_ALIGNED)
        np.testing.assert_allclose(work["twist"], velocity.vector, atol=1e-12)
        drift = pin.getFrameClassicalAcceleration(model, data, face, pin.LOCAL_WORLD_ALIGNED)
        np.testing.assert_allclose(work["dJdq"], drift.vector, atol=1e-10)


def test_damping_is_critical_design(cell):
    """(7): D = sqrt(Lambda) sqrt(K) + sqrt(K) sqrt(Lambda), with sqrt(Lambda)^2 the inverse of J M^-1 J^T."""
    arm = _arm(cell)
    arm.sample["q"][0] = cell.left.home
    arm.observe()
    _put(arm, _random_setpoint(np.random.default_rng(0), arm, 1.0))
    arm.command(Mode.ANTE_IMPACT)
    work = arm.workspace[0]
    Lambda = work["sqrt_Lambda"] @ work["sqrt_Lambda"]
    np.testing.assert_allclose(Lambda @ work["Lambda_inverse"], np.eye(6), atol=1e-9)
    root_K = np.diag(np.sqrt(ControlParameters().stiffness))
    np.testing.assert_allclose(work["D"], work["sqrt_Lambda"] @ root_K + root_K @ work["sqrt_Lambda"], atol=1e-9)


def test_torque_reaches_the_task_acceleration(cell):
    """(38): the ddq of the QP gives the end effector the acceleration Lambda^-1 f, and joint 1 its posture's."""
    arm = _arm(cell)
    arm.sample["q"][0] = cell.left.home
    arm.sample["dq"][0] = 0.1
    arm.observe()
    _put(arm, _random_setpoint(np.random.default_rng(1), arm, 1.0))
    assert arm.command(Mode.ANTE_IMPACT) is QpStatus.UNCONSTRAINED
    work, control = arm.workspace[0], arm.control[0]
    acceleration = work["J"] @ work["ddq"] + work["dJdq"]
    np.testing.assert_allclose(acceleration, work["Lambda_inverse"] @ control["wrench_desired"], atol=1e-4)
    assert work["ddq"][0] == pytest.approx(control["beta"], abs=1e-4)


def test_an_acceleration_task_moves_each_axis_by_itself(cell):
    """(15) of the impact-map paper: an error along z accelerates along z, k_p times it, and turns nothing."""
    parameters = ControlParameters(acceleration_tasks=True)
    arm = make_arm_controller(ArmModel(cell.left, cell.pad), parameters)
    arm.sample["q"][0] = cell.left.home
    arm.observe()
    work = arm.workspace[0]
    arm.setpoint["position"][0] = work["position"] + (0.0, 0.0, 0.01)
    arm.setpoint["rotation"][0] = work["rotation"]
    arm.setpoint["xi"] = cell.left.home[0]
    arm.pursue(np.full(6, 100.0), 100.0)
    assert arm.command(Mode.ANTE_IMPACT) is QpStatus.UNCONSTRAINED
    acceleration = work["J"] @ work["ddq"] + work["dJdq"]
    np.testing.assert_allclose(acceleration, [0.0, 0.0, 1.0, 0.0, 0.0, 0.0], atol=1e-4)


@pytest.mark.parametrize("limit", ["position", "velocity", "torque", "commanded torque"])
def test_each_limit_becomes_active(cell, limit):
    """(12)-(14): pushed against a limit, the QP's answer is on it, and nothing is beyond it."""
    arm = _arm(cell)
    q, dq = np.array(cell.left.home), np.zeros(7)
    table = arm.limits[0]
    if limit == "velocity":
        dq[3] = 1.0
    arm.model.update(q, dq)
    if limit == "position":  # at rest where a joint that is pushed against its limit comes to rest
        table["q_upper"][3] = q[3] + table["velocity_offset"][3] ** 2 / (2.0 * table["deceleration"][3])
    elif limit == "velocity":
        table["dq_max"][3] = 1.01  # the velocity limit is 0.5 rad/s^2 away
    elif limit == "torque":
        table["tau_J_max"][3] = abs(arm.model.g[3]) + 0.5
    else:
        table["tau_max"][3] = 0.5
    arm.sample["tau_J"][0] = arm.model.g  # nothing pushes from outside
    arm.sample["q"][0], arm.sample["dq"][0] = q, dq
    arm.observe()
    work = arm.workspace[0]
    setpoint = SimpleNamespace(
        position=work["position"] + _push_joint_4_up(arm, 0.03),
        rotation=work["rotation"].copy(), twist=np.zeros(6), wrench_ff=np.zeros(6), xi=q[0], dxi=0.0, beta=0.0,
        velocity_weight=0.0, stiffness=np.array(ControlParameters().stiffness), posture_gain=500.0,
    )  # fmt: skip
    _put(arm, setpoint)
    status = arm.command(Mode.ANTE_IMPACT)
    free = np.linalg.solve(work["H"], -work["gradient"])
    tau = work["M"] @ work["ddq"]
    if "torque" in limit:
        assert (work["M"] @ free)[3] > work["tau_upper"][3] + 0.1
        gap = work["tau_upper"][3] - tau[3]
    else:
        assert free[3] > work["upper"][3] + 0.1
        gap = work["upper"][3] - work["ddq"][3]
    assert status is QpStatus.SOLVED
    assert abs(gap) < 1e-3
    assert np.all(work["ddq"] < work["upper"] + 1e-3)
    assert np.all(work["ddq"] > work["lower"] - 1e-3)
    assert np.all(tau < work["tau_upper"] + 1e-3)
    assert np.all(tau > work["tau_lower"] - 1e-3)


def _push_joint_4_up(arm: ArmController, distance_m: float) -> np.ndarray:
    """A displacement of the target along which joint 4 is pushed up."""
    direction = arm.workspace["J"][0, :3, 3].copy()
    return distance_m * direction / np.linalg.norm(direction)


@pytest.mark.parametrize("strategy", list(Strategy))
def test_desired_wrench_at_the_switches(cell, strategy):
    """The wrench is continuous at both switches, for any references, where there is an interim mode; the baselines'
    are not. Contact is complete from 0.16 s after the impact on: there gamma goes on."""
    left, right = _arm(cell), _arm(cell)
    parameters = ControlParameters()
    machine = ModeMachine(strategy, parameters, 0.5)
    controller = CellController((left, right), machine)
    machine.begin(Mode.ANTE_IMPACT)
    rng = np.random.default_rng(5)
    left.sample["q"][0] = cell.left.home
    left.sample["dq"][0] = 0.1 * rng.normal(size=7)
    left.observe()
    n = 900
    ante, post = np.zeros(n, POINT), np.zeros(n, POINT)
    for points in (ante, post):
        points["position"] = left.workspace["position"][0] + 0.005 * rng.normal(size=3)
        points["rotation"] = pin.exp3(0.02 * rng.normal(size=3)) @ left.workspace["rotation"][0]
        points["twist"] = 0.1 * rng.normal(size=6)
        points["wrench_ff"] = 5.0 * rng.normal(size=6)
        points["xi"], points["beta"] = cell.left.home[0], rng.normal()
    # the wrench for a state that does not change: only the controller's own switching can move it. The state has the
    # ante-impact velocity, so that the interim mode's missing velocity feedback is no step
    ante["twist"] = left.workspace["twist"][0]
    left.pursue(np.array(parameters.stiffness), 500.0)
    left.follow(ante, post)
    wrench = np.zeros((n, 6))
    modes = np.zeros(n, int)
    for k in range(n):
        left.impact = k == 450
        if k == 600:  # both pads press, at rest against each other
            right.velocity[:] = left.velocity
            right.workspace["rotation"][0] = left.workspace["rotation"][0]
            for arm in (left, right):
                arm.workspace["force_world"][0] = -10.0 * arm.workspace["rotation"][0, :, 2]
        controller.decide(k * 1e-3)
        left.choose(k, machine)
        left.command(machine.mode)
        wrench[k] = left.control["wrench_desired"][0]
        modes[k] = machine.mode
    steps = np.abs(np.diff(wrench, axis=0)).max(axis=1)
    switches = np.flatnonzero(np.diff(modes))
    if strategy in (Strategy.PROPOSED, Strategy.CONTACT_COMPLETION):
        assert [modes[k + 1] for k in switches] == [Mode.INTERIM, Mode.POST_IMPACT]
        assert switches.tolist() == [449, 549 if strategy is Strategy.PROPOSED else 639]
        ramp = steps[451:518].max()
        assert steps[449:].max() <= 2.0 * ramp  # at the switches, and where gamma stops and goes on
    else:
        assert [modes[k + 1] for k in switches] == [Mode.POST_IMPACT]
        assert switches[0] == (449 if strategy is Strategy.NO_INTERIM else 499)
        assert steps[switches[0]] > 2.0
