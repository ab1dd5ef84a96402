"""The planar plant against what is known in closed form: energy, order of the integrator, contact, impact map."""

import dataclasses

import numpy as np
import pytest
from scipy.optimize import root_scalar

from rtstack.papers.aim_aware.planar.dynamics import advance, coriolis, derivative, inertia, tip, weight
from rtstack.papers.aim_aware.planar.parameters import Contact, PlanarArm
from rtstack.papers.aim_aware.planar.plan import InfeasibleImpact, joints_at, model_at, plan_impact, simultaneous_impact

ARM = PlanarArm(
    length_m=(0.35, 0.35, 0.15), mass_kg=(3.5, 2.5, 1.0), half_width_m=0.1, B_kg_m2=(0.6, 0.45, 0.2),
    B_theta_kg_m2=(0.2, 0.15, 0.067), K_nm_rad=(14000.0, 11000.0, 9000.0), D_nms_rad=(10.0, 8.0, 5.0),
    gravity_m_s2=9.81,
)  # fmt: skip
CONTACT = Contact(stiffness=5e5, exponent=1.5, damping_s_m=20.0)
FAR = CONTACT.surface(0.0, -10.0, 0.0)
Q, DQ = np.array([1.2, -1.9, -0.6]), np.array([0.8, -1.1, 1.7])


def _without(arm: PlanarArm, **changes) -> PlanarArm:
    return dataclasses.replace(arm, **changes)


def _energy(arm: PlanarArm, state: np.ndarray) -> float:
    """Kinetic and potential energy of links, joints and motors (as heavy as the low-level loop makes them look), J.

    Written from the links' middles, not from the plant's coefficients.
    """
    q, theta, dq, dtheta = state.reshape(4, 3)
    psi, dpsi = np.cumsum(q), np.cumsum(dq)
    length, mass = np.array(arm.length_m), np.array(arm.mass_kg)
    turn = np.array([np.cos(psi), np.sin(psi)])
    across = np.array([-np.sin(psi), np.cos(psi)])
    energy = 0.0
    for i in range(3):
        lever = np.append(length[:i], length[i] / 2.0)
        height = turn[1, : i + 1] @ lever
        velocity = across[:, : i + 1] @ (lever * dpsi[: i + 1])
        width = 2.0 * arm.half_width_m if i == 2 else 0.0
        turning = mass[i] * (length[i] ** 2 + width**2) / 12.0
        energy += 0.5 * mass[i] * velocity @ velocity + 0.5 * turning * dpsi[i] ** 2
        energy += mass[i] * arm.gravity_m_s2 * height
    energy += 0.5 * np.array(arm.B_theta_kg_m2) @ dtheta**2 + 0.5 * np.array(arm.K_nm_rad) @ (theta - q) ** 2
    return float(energy)


def _run(arm, surface, state, duration_s, step_s, tau=(0.0, 0.0, 0.0)):
    state = state.copy()
    steps = round(duration_s / step_s)
    advance(arm.record()[0], surface[0], state, np.array(tau), step_s, steps, np.zeros((5, 12)), np.zeros(2))
    return state


def _swinging() -> np.ndarray:
    return np.concatenate([Q, Q + [0.002, -0.001, 0.0015], DQ, DQ])


def test_energy_is_kept_without_damping_and_only_lost_to_the_joints_with_it():
    undamped = _without(ARM, D_nms_rad=(0.0, 0.0, 0.0))
    before = _energy(undamped, _swinging())
    after = _energy(undamped, _run(undamped, FAR, _swinging(), 0.5, 2.5e-5))
    assert after == pytest.approx(before, rel=1e-6)
    # with damping: E-dot = -sum D (dtheta - dq)^2 + tau_d dtheta
    state, lost, tau, step = _swinging(), 0.0, np.array([3.0, -2.0, 1.0]), 2e-5
    before = _energy(ARM, state)
    power = lambda s: tau @ s[9:] - np.array(ARM.D_nms_rad) @ (s[9:] - s[6:9]) ** 2  # noqa: E731
    for _ in range(1000):
        start = power(state)
        state = _run(ARM, FAR, state, step, step, tau)
        lost += 0.5 * step * (start + power(state))
    assert _energy(ARM, state) - before == pytest.approx(lost, rel=1e-4)


def test_the_integrator_is_of_the_fourth_order():
    exact = _run(ARM, FAR, _swinging(), 0.02, 1e-5)
    errors = [np.abs(_run(ARM, FAR, _swinging(), 0.02, step) - exact).max() for step in (4e-4, 2e-4, 1e-4)]
    orders = np.log2(np.array(errors[:-1]) / errors[1:])
    assert np.all((orders > 3.7) & (orders < 4.3)), (errors, orders)


def test_the_studys_step_is_fine_enough_for_the_impact():
    surface = CONTACT.surface(0.3, 0.0, np.radians(3.0))
    q = joints_at(ARM.record(), np.array([0.3, 0.006, 0.0]))
    dq = np.linalg.solve(model_at(ARM.record(), q)[1], np.array([0.0, -0.25, 0.0]))
    state = np.concatenate([q, q, dq, dq])
    coarse, fine = (_run(ARM, surface, state, 0.1, step) for step in (1.25e-4, 1.25e-5))
    assert np.abs(coarse - fine)[6:].max() < 2e-3  # rad/s, where the tunings' bounds are some 0.05


def test_a_contact_stops_where_the_closed_form_says_and_rebounds_as_it_says():
    # a stiff contact, no elasticity, no weight: within the time of the impact the plate is a mass (J M^-1 J^T)^-1
    free = _without(ARM, gravity_m_s2=0.0, half_width_m=0.0, K_nm_rad=(1e-9,) * 3, D_nms_rad=(0.0,) * 3)
    stiff = Contact(stiffness=5e8, exponent=1.5, damping_s_m=4.0)
    arm, v = free.record(), 0.25
    q = joints_at(arm, np.array([0.3, 0.0, 0.0]))
    _, J, M = model_at(arm, q)
    # hit along the acceleration that the force gives: then no other coordinate takes part
    direction = np.linalg.solve(M, J[1])
    mass = 1.0 / (J[1] @ direction)
    dq = -v * direction * mass
    state, surface = np.concatenate([q, q, dq, dq]), stiff.surface(0.3, 0.0, 0.0)
    deepest, step = 0.0, 2e-7
    for _ in range(20000):
        state = _run(free, surface, state, step, step)
        x, _, _ = model_at(arm, state[:3])
        deepest = max(deepest, -x[1])
        if x[1] > 0.0:
            break
    lam, k, n = stiff.damping_s_m, 2.0 * stiff.stiffness, stiff.exponent  # both corners are at one point
    work = mass * (1.0 - np.exp(-lam * v) * (1.0 + lam * v)) / lam**2
    assert deepest == pytest.approx((work * (n + 1.0) / k) ** (1.0 / (n + 1.0)), rel=5e-3)
    surplus = lambda u: mass * (1.0 + np.exp(lam * u) * (lam * u - 1.0)) / lam**2 - work  # noqa: E731
    rebound = root_scalar(surplus, bracket=(1e-6, v)).root
    assert (J @ state[6:9])[1] == pytest.approx(rebound, rel=5e-3)
    assert 0.1 * v < rebound < 0.7 * v


def test_the_coriolis_matrix_is_the_one_of_christoffels_symbols():
    record = ARM.record()[0]
    psi, dpsi = np.cumsum(Q), np.cumsum(DQ)
    M_before, M_after, C = np.zeros((3, 3, 3))
    inertia(record, psi - 1e-6 * dpsi, M_before)
    inertia(record, psi + 1e-6 * dpsi, M_after)
    coriolis(record, psi, dpsi, C)
    np.testing.assert_allclose(C + C.T, (M_after - M_before) / 2e-6, atol=1e-8)


def test_the_controllers_model_is_the_plants():
    stiff = _without(ARM, D_nms_rad=(0.0,) * 3)
    place, _, M = model_at(ARM.record(), Q)
    C, gravity, tau = np.zeros((3, 3)), np.zeros(3), np.array([5.0, -3.0, 2.0])
    coriolis(ARM.record()[0], np.cumsum(Q), np.cumsum(DQ), C)
    weight(ARM.record()[0], np.cumsum(Q), gravity)
    state, rate = np.concatenate([Q, Q + tau / np.array(ARM.K_nm_rad), DQ, DQ]), np.zeros(12)
    derivative(stiff.record()[0], FAR[0], state, tau, rate, np.zeros(2))
    np.testing.assert_allclose(M @ rate[6:9] + C @ DQ + gravity, tau, atol=1e-8)
    before, after, x, J, dJdq = *np.zeros((2, 3)), np.zeros(3), np.zeros((3, 3)), np.zeros(3)
    for sign, target in ((-1.0, before), (1.0, after)):
        tip(ARM.record()[0], np.cumsum(Q + sign * 1e-6 * DQ), np.cumsum(DQ), x, J, dJdq)
        target[:] = J @ DQ
    tip(ARM.record()[0], np.cumsum(Q), np.cumsum(DQ), x, J, dJdq)
    np.testing.assert_allclose(dJdq, (after - before) / 2e-6, atol=1e-7)
    np.testing.assert_allclose(joints_at(ARM.record(), place), Q, atol=1e-12)


def test_the_motors_torque_makes_their_inertia_look_like_b_theta():
    rate = np.zeros(12)
    derivative(ARM.record()[0], FAR[0], np.concatenate([Q, Q, DQ, DQ]), np.array([1.0, 2.0, 3.0]), rate, np.zeros(2))
    np.testing.assert_allclose(rate[9:], np.array([1.0, 2.0, 3.0]) / ARM.B_theta_kg_m2)


def test_the_impact_map_is_inelastic_least_in_the_inertias_metric_and_never_pulls(study):
    plan = plan_impact(ARM, study.task, study.gains, np.radians(80.0), 0.3)
    assert (plan.impulses > 0.0).all()
    _, J, M = model_at(ARM.record(), plan.q_d)
    M_r, J_N = M + np.diag(ARM.B_theta_kg_m2), J[1:]
    dq = np.linalg.solve(J, [0.1, -0.25, 0.0])
    after, _ = simultaneous_impact(M_r, np.array([J_N[0] - 0.1 * J_N[1], J_N[0] + 0.1 * J_N[1]]), dq)
    np.testing.assert_allclose(J_N @ after, 0.0, atol=1e-12)
    # Gauss: the jump is orthogonal, in M_r, to every motion that the contacts allow
    sliding = np.linalg.solve(J, [1.0, 0.0, 0.0])
    assert sliding @ M_r @ (after - dq) == pytest.approx(0.0, abs=1e-12)
    with pytest.raises(InfeasibleImpact, match="negative impulse"):
        plan_impact(_without(ARM, half_width_m=0.03), study.task, study.gains, np.radians(80.0), 0.3)


def test_references_fit_together_by_the_map_and_go_on_beyond_the_impact(study):
    plan = plan_impact(ARM, study.task, study.gains, np.radians(70.0), 0.3)
    k = round(plan.t_d_s / study.gains.period_s)
    x, dx, ddx = plan.ante
    np.testing.assert_allclose(x[k], [0.3, 0.0, 0.0], atol=1e-12)
    direction = np.array([np.cos(np.radians(70.0)), np.sin(np.radians(70.0)), 0.0])
    np.testing.assert_allclose(dx[k], -0.25 * direction, atol=1e-12)
    np.testing.assert_allclose(dx[k:], dx[k] * np.ones((len(dx) - k, 1)), atol=1e-9)  # extended
    np.testing.assert_allclose(ddx[k + 1 :], 0.0, atol=1e-6)
    np.testing.assert_allclose(dx[0], 0.0, atol=1e-12)
    x, dx, _ = plan.post
    np.testing.assert_allclose(x[k], [0.3, 0.0, 0.0], atol=1e-12)
    np.testing.assert_allclose(dx[:, 1:], 0.0, atol=1e-12)  # neither up nor turning
    np.testing.assert_allclose(dx[: k + 1, 0], dx[k, 0], atol=1e-9)  # extended
    for tick in (0, k, k + 100):  # (14): the joints' velocities of the post-impact reference
        q = joints_at(ARM.record(), x[tick])
        np.testing.assert_allclose(model_at(ARM.record(), q)[1] @ plan.dq_post[tick], dx[tick], atol=1e-9)
