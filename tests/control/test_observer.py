"""The momentum observer finds a constant external torque, blind to motor friction and to the joints' elasticity."""

import numpy as np
import pinocchio as pin
import pytest

from rtstack.control.observer import MomentumObserver
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


def test_the_observer_of_arrays_is_that_of_the_tick(cell):
    arm = make_arm_controller(ArmModel(cell.left, cell.pad))
    rng = np.random.default_rng(0)
    observer = MomentumObserver(7)
    for _ in range(20):
        q, dq = np.array(cell.left.home) + rng.normal(0.0, 0.1, 7), rng.normal(0.0, 0.5, 7)
        arm.sample["q"][0], arm.sample["dq"][0], arm.sample["tau_J"][0] = q, dq, rng.normal(0.0, 20.0, 7)
        arm.observe()
        model = arm.model
        found = observer.update(model.M, model.C, arm.workspace["gravity"][0], arm.sample["tau_J"][0], dq)
        np.testing.assert_array_equal(found, arm.control["momentum_residual"][0])
        np.testing.assert_array_equal(observer.rate, arm.control["residual_rate"][0])


def test_two_joints_that_are_pushed_show_the_push():
    # planar 2R arm of point masses at its ends, without gravity, held still: the residual becomes what is pushed
    M, still, push = np.array([[3.0, 1.0], [1.0, 1.0]]), np.zeros(2), np.array([2.0, -1.0])
    observer = MomentumObserver(2, gain_hz=100.0)
    observer.update(M, np.zeros((2, 2)), still, still, still)
    for _ in range(200):
        found = observer.update(M, np.zeros((2, 2)), still, -push, still)
    np.testing.assert_allclose(found, -push, atol=1e-8)  # positive where the robot pushes


@pytest.mark.parametrize(
    ("name", "value", "message"),
    [
        ("M", np.eye(3), r"M: expected shape \(2, 2\), found \(3, 3\)"),
        ("C", np.zeros(2), r"C: expected shape \(2, 2\), found \(2,\)"),
        ("gravity", np.zeros(7), r"gravity: expected shape \(2,\), found \(7,\)"),
        ("tau_J", [np.nan, 0.0], "tau_J: expected finite numbers, found nan"),
        ("dq", "12", "dq: expected numbers, found <U2"),
    ],
)
def test_a_tick_that_does_not_fit_is_refused_and_not_taken(name, value, message):
    good = {"M": np.eye(2), "C": np.zeros((2, 2)), **dict.fromkeys(("gravity", "tau_J", "dq"), np.ones(2))}
    observer, other = MomentumObserver(2), MomentumObserver(2)
    for one in (observer, other):
        one.update(**good)
    with pytest.raises(ValueError, match=message):
        observer.update(**(good | {name: value}))
    changed = good | {"dq": np.array([2.0, 0.5])}
    np.testing.assert_array_equal(observer.update(**changed), other.update(**changed))


@pytest.mark.parametrize("arguments", [(0,), (-1,), (10**7,), (2, 0.0), (2, 2000.0, 1e-3), (2, 200.0, -1e-3), (2.5,)])
def test_an_observer_that_makes_no_sense_is_refused(arguments):
    with pytest.raises(ValueError, match="expected"):
        MomentumObserver(*arguments)
