"""Mass matrix and gravity torque, made of what one call of Pinocchio's leaves, against its own calls for each."""

import numpy as np
import pinocchio as pin
import pytest

from rtstack.model.arm_model import ArmModel


@pytest.mark.parametrize("side", ["left", "right"])
def test_dynamics_are_pinocchio_s(cell, side):
    model = ArmModel(getattr(cell, side), cell.pad)
    theirs, data = model.pin_model, model.pin_model.createData()
    rng = np.random.default_rng(0)
    for _ in range(200):
        q, dq = rng.uniform(-np.pi, np.pi, 7), rng.normal(size=7)
        model.update(q, dq)
        M = np.triu(pin.crba(theirs, data, q, pin.Convention.WORLD))
        np.testing.assert_allclose(model.M, M + np.triu(M, 1).T, rtol=0.0, atol=1e-12)
        np.testing.assert_allclose(model.g, pin.computeGeneralizedGravity(theirs, data, q), rtol=0.0, atol=1e-12)
        np.testing.assert_allclose(model.C, pin.computeCoriolisMatrix(theirs, data, q, dq), rtol=0.0, atol=1e-12)
