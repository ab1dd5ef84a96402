"""The momentum observer finds a constant external torque, blind to motor friction and to the joints' elasticity."""

import numpy as np
import pinocchio as pin

from rtstack.model.arm_model import ArmModel
from tests.support.arm_controller import make_arm_controller


def test_an_arm_at_rest_that_reads_something_begins_with_it_and_without_a_rate(cell):
    """A gravity model that is off, sensors that leave gravity out: no impact, nothing has changed."""
    arm = make_arm_controller(ArmModel(cell.left, cell.pad))
    model, data = arm.model.pin_model, arm.model.pin_model.createData()
    q = np.array(cell.left.home)
    gravity = pin.computeGeneralizedGravity(model, data, q)
    for tau_J in (gravity + np.array([0.0, 1.0, 0.0, -0.5, 0.1, 0.0, 0.0]), np.zeros(7)):
        arm = make_arm_controller(ArmModel(cell.left, cell.pad))
        for _ in range(50):
            arm.sample["q"][0], arm.sample["dq"][0], arm.sample["tau_J"][0] = q, 0.0, tau_J
            arm.observe()
            np.testing.assert_allclose(arm.control["momentum_residual"][0], tau_J - gravity, atol=1e-9)
            np.testing.assert_allclose(arm.control["residual_rate"][0], 0.0, atol=1e-6)


def test_residual_converges_to_the_external_torque_with_the_gain_as_its_pole(cell):
    arm = make_arm_controller(ArmModel(cell.left, cell.pad))
    model, data = arm.model.pin_model, arm.model.pin_model.createData()
    q, dq = np.array(cell.left.home), np.zeros(7)
    external = np.array([3.0, -2.0, 1.0, 4.0, -0.5, 0.3, 0.2])  # what the environment does to the joints, Nm
    errors = []
    arm.sample["q"][0], arm.sample["dq"][0] = q, dq
    arm.sample["tau_J"][0] = pin.computeGeneralizedGravity(model, data, q)
    arm.observe()  # at rest, before the push
    for k in range(100):
        # hold the arm with a joint torque that carries gravity and half of the push: it moves, exactly integrated
        tau_J = pin.computeGeneralizedGravity(model, data, q) - 0.5 * external
        arm.sample["q"][0], arm.sample["dq"][0], arm.sample["tau_J"][0] = q, dq, tau_J
        arm.observe()
        errors.append(np.abs(-arm.control["momentum_residual"][0] - external * (k > 0)).max())
        for _ in range(20):  # the plant, at a fine step
            ddq = pin.aba(model, data, q, dq, tau_J + external)
            dq = dq + ddq * 5e-5
            q = q + dq * 5e-5
    # a first-order filter with the pole 1 - K_O dt = 0.8 a tick
    assert errors[1] > 2.0
    assert errors[10] < 4.0 * 0.8**8
    assert errors[60] < 0.1
