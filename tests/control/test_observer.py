"""The momentum observer finds a constant external torque, blind to motor friction and to the joints' elasticity."""

import numpy as np
import pinocchio as pin

from rtstack.control.tick import make_arm_controller
from rtstack.model.arm_model import ArmModel


def test_residual_converges_to_the_external_torque_with_the_gain_as_its_pole(cell):
    arm = make_arm_controller(ArmModel(cell.left, cell.pad))
    model, data = arm.model.pin_model, arm.model.pin_model.createData()
    q, dq = np.array(cell.left.home), np.zeros(7)
    external = np.array([3.0, -2.0, 1.0, 4.0, -0.5, 0.3, 0.2])  # what the environment does to the joints, Nm
    errors = []
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
