"""Dynamics made of one call of Pinocchio's against its own calls for each; rotations."""

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rtstack.control.dense import cholesky, solve_lower, solve_lower_transposed, symmetric_eigen
from rtstack.log.viewers.frames import quaternions_of
from rtstack.model.arm_model import ArmModel
from rtstack.model.rotation import exp_so3, log_so3, quaternion_from_rotation, rotation_from_quaternion


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


ANGLES = [0.0, 1e-12, 1e-8, 1e-7, 2e-7, 1e-4, 1e-3, 1.0, 3.0, np.pi - 1e-3]


@pytest.mark.parametrize("angle", ANGLES)
def test_exp_and_log(angle):
    rng = np.random.default_rng(0)
    for _ in range(20):
        axis = rng.normal(size=3)
        w = angle * axis / np.linalg.norm(axis)
        R, back = np.empty((3, 3)), np.empty(3)
        exp_so3(w, 1.0, R)
        np.testing.assert_allclose(R, pin.exp3(w), atol=1e-13)
        log_so3(R, back)
        np.testing.assert_allclose(back, w, atol=1e-9)


@pytest.mark.parametrize("axis", [np.eye(3)[0], np.eye(3)[1], np.eye(3)[2], np.array([1.0, -2.0, 2.0]) / 3.0])
def test_log_of_half_a_turn(axis):
    R, w = 2.0 * np.outer(axis, axis) - np.eye(3), np.empty(3)
    log_so3(R, w)
    assert np.linalg.norm(w) == pytest.approx(np.pi)
    np.testing.assert_allclose(np.abs(w), np.pi * np.abs(axis), atol=1e-6)


@given(st.integers(0, 2**31))
def test_quaternion_and_back(seed):
    R = pin.exp3(3.0 * np.random.default_rng(seed).normal(size=3))
    q = np.zeros(4)
    quaternion_from_rotation(R, q)
    assert np.linalg.norm(q) == pytest.approx(1.0)
    assert q[0] >= 0.0 or abs(q[0]) < 0.6
    np.testing.assert_allclose(rotation_from_quaternion(q), R, atol=1e-12)


@pytest.mark.long
@given(st.integers(0, 2**31))
def test_a_moving_frame_has_no_jump_in_its_quaternion(seed):
    """Whole turns about a random axis, that all pass w = 0, from a random rotation."""
    rng = np.random.default_rng(seed)
    start, axis = pin.exp3(3.0 * rng.normal(size=3)), rng.normal(size=3)
    turns = np.stack([pin.exp3(angle * axis / np.linalg.norm(axis)) @ start for angle in np.linspace(0.0, 13.0, 400)])
    q, path = np.zeros(4), []
    for R in turns:
        quaternion_from_rotation(R, q)
        path.append(q.copy())
        np.testing.assert_allclose(rotation_from_quaternion(q), R, atol=1e-12)
    whole = quaternions_of(turns)
    whole *= np.sign(whole[0] @ path[0])
    np.testing.assert_allclose(whole, path, atol=1e-12)
    assert np.linalg.norm(np.diff(path, axis=0), axis=1).max() < 0.02  # half of a step's angle
    assert np.min(np.array(path)[:, 0]) < 0.0 < np.max(np.array(path)[:, 0])


@pytest.mark.parametrize(
    "wxyz", [(0, 0, 1, 0), (0, 0, 1, 1), (0, 0, 1, -1), (0, 1, 0, -1), (0, 1, 1, 1), (1, 1, -1, 1)]
)
def test_noise_does_not_choose_the_sign_of_a_first_quaternion(wxyz):
    exact = np.array(wxyz) / np.linalg.norm(wxyz)
    rng, signs = np.random.default_rng(0), set()
    for _ in range(100):
        q = np.zeros(4)
        quaternion_from_rotation(rotation_from_quaternion(exact) @ pin.exp3(rng.normal(0.0, 0.01, 3)), q)
        signs.add(np.sign(q @ exact))
    assert len(signs) == 1


@given(st.integers(0, 2**31))
def test_dense_algebra_against_numpy(seed):
    rng = np.random.default_rng(seed)
    A = rng.normal(size=(7, 7))
    A = A @ A.T + 0.1 * np.eye(7)
    L, b = np.zeros((7, 7)), rng.normal(size=7)
    assert cholesky(A, 7, L)
    x = b.copy()
    solve_lower(L, 7, x)
    solve_lower_transposed(L, 7, x)
    np.testing.assert_allclose(A @ x, b, atol=1e-8)
    B, V = A[:6, :6].copy(), np.empty((6, 6))
    symmetric_eigen(B, V, np.empty((3, 2)))
    np.testing.assert_allclose(V.T @ np.diag(np.diag(B)) @ V, A[:6, :6], rtol=0.0, atol=1e-13 * np.trace(A))
    np.testing.assert_allclose(np.sort(np.diag(B)), np.linalg.eigvalsh(A[:6, :6]), rtol=0.0, atol=1e-13 * np.trace(A))
    np.testing.assert_allclose(V @ V.T, np.eye(6), rtol=0.0, atol=1e-13)


@pytest.mark.parametrize("values", [np.zeros(6), np.ones(6), np.array([1e-9, 1e-9, 0.1, 0.1, 10.0, 10.0])])
def test_eigenvectors_of_values_that_are_equal_or_far_apart(values):
    for seed in range(20):
        Q, _ = np.linalg.qr(np.random.default_rng(seed).normal(size=(6, 6)))
        A = Q @ np.diag(values) @ Q.T
        B, V = 0.5 * (A + A.T), np.empty((6, 6))
        symmetric_eigen(B, V, np.empty((3, 2)))
        np.testing.assert_allclose(V.T @ np.diag(np.diag(B)) @ V, A, rtol=0.0, atol=1e-13)
        np.testing.assert_allclose(V @ V.T, np.eye(6), rtol=0.0, atol=1e-13)


def test_eigenvectors_of_no_numbers_are_not_looked_for():
    V = np.empty((6, 6))
    symmetric_eigen(np.full((6, 6), np.nan), V, np.empty((3, 2)))
    np.testing.assert_array_equal(V, np.eye(6))


def test_cholesky_refuses_what_is_not_positive_definite():
    assert not cholesky(-np.eye(7), 7, np.zeros((7, 7)))
    assert not cholesky(np.full((7, 7), np.nan), 7, np.zeros((7, 7)))
