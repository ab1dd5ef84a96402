"""Reference extension, (16)-(20), and the quintics that the scripted operator moves along."""

import numpy as np
import pinocchio as pin
import pytest

from rtstack.control.records import POINT
from rtstack.references.quintic import ViaPoint, quintic_path
from rtstack.references.recording import Recording, ReferenceError
from rtstack.references.spreading import extend

DT = 1e-3


def _recording(n: int = 1000, impact: int = 400) -> Recording:
    """Both arms on a helix: position and rotation are the integrals of a constant twist before and after the impact."""
    points = np.zeros((2, n), POINT)
    t = np.arange(n) * DT
    for arm in range(2):
        before, after = np.array([0.0, -0.3, 0.2, 0.5, 0.1, -0.4]), np.array([0.01, 0.02, 0.25, -0.2, 0.3, 0.1])
        t_impact = impact * DT
        start = pin.exp3(np.array([0.3, -1.0, 0.2 * arm]))
        at_impact = pin.exp3(before[3:] * t_impact) @ start
        for k in range(n):
            point = points[arm, k]
            early = k < impact
            twist = before if early else after
            since = t[k] if early else t[k] - t_impact
            base = 0.0 if early else before[:3] * t_impact
            point["twist"] = twist
            point["position"] = base + twist[:3] * since
            point["rotation"] = pin.exp3(twist[3:] * since) @ (start if early else at_impact)
            point["wrench_ff"] = k
            point["beta"] = -k
            point["dxi"] = twist[0] + 0.1
            point["xi"] = (0.1 + before[0]) * min(t[k], t_impact) + (0.1 + after[0]) * max(0.0, t[k] - t_impact)
    return Recording(points, DT, impact, 900, "rice_box")


def test_inside_its_own_part_a_reference_is_the_recording():
    recording = _recording()
    reference = extend(recording, 0.1)
    np.testing.assert_array_equal(reference.ante[:, :301], recording.points[:, :301])
    np.testing.assert_array_equal(reference.post[:, 500:], recording.points[:, 500:])
    assert reference.nominal_impact_s == pytest.approx(0.4)


def test_extensions_go_on_with_the_velocity_and_hold_the_feedforward():
    """On a motion of constant twist the extension is the motion itself, up to the impact and beyond."""
    recording = _recording()
    reference = extend(recording, 0.1)
    for arm in range(2):
        ante, post, true = reference.ante[arm], reference.post[arm], recording.points[arm]
        for name in ("position", "rotation", "xi", "twist", "dxi"):
            np.testing.assert_allclose(ante[name][301:400], true[name][301:400], atol=1e-12)
            np.testing.assert_allclose(post[name][400:500], true[name][400:500], atol=1e-12)
        assert np.all(ante["wrench_ff"][300:] == 300)
        assert np.all(post["wrench_ff"][:500] == 500)
        assert np.all(ante["beta"][300:] == -300)
        np.testing.assert_allclose(ante["position"][999], true["position"][300] + 0.699 * true["twist"][300, :3])
        turned = pin.exp3(-0.5 * true["twist"][500, 3:]) @ true["rotation"][500]
        np.testing.assert_allclose(post["rotation"][0], turned, atol=1e-12)


def test_how_far_off_the_printed_rotations_would_be():
    """(19) and (20) as printed multiply from the right, and (20) turns the other way: what docs/departures.md says."""
    recording = _recording()
    reference = extend(recording, 0.1)
    true = recording.points[0]["rotation"]
    ante, post = reference.ante[0], reference.post[0]
    printed_ante = true[300] @ pin.exp3(0.1 * ante["twist"][400, 3:])
    printed_post = true[500] @ pin.exp3(0.1 * post["twist"][400, 3:])
    off = [float(np.linalg.norm(pin.log3(true[400].T @ printed))) for printed in (printed_ante, printed_post)]
    speeds = [float(np.linalg.norm(points["twist"][400, 3:])) for points in (ante, post)]
    assert speeds == pytest.approx([0.648, 0.374], abs=1e-3)
    assert off == pytest.approx([0.064, 0.075], abs=1e-3)


@pytest.mark.parametrize("impact", [50, 100, 950])
def test_an_impact_at_an_end_is_refused(impact):
    with pytest.raises(ReferenceError, match="record a longer one"):
        extend(_recording(impact=impact), 0.1)


def test_quintic_path_meets_its_via_points_and_is_the_integral_of_its_velocity():
    points = [ViaPoint(0.3, 0.35), ViaPoint(1.3, 0.15, -0.35), ViaPoint(1.9, 0.03)]
    t = np.linspace(0.0, 2.2, 220001)
    position, velocity = quintic_path(points, t)
    for point in points:
        k = np.searchsorted(t, point.t_s - 1e-9)
        assert position[k] == pytest.approx(point.position, abs=1e-6)
        assert velocity[k] == pytest.approx(point.velocity, abs=1e-4)
    integral = position[0] + np.concatenate([[0.0], np.cumsum(0.5 * (velocity[1:] + velocity[:-1])) * 1e-5])
    np.testing.assert_allclose(position, integral, atol=1e-6)
    acceleration = np.diff(velocity) / 1e-5
    assert np.abs(np.diff(acceleration)).max() < 1e-2  # no jump, also not at a via point
    assert velocity[0] == 0.0
    assert velocity[-1] == 0.0


def test_via_points_have_to_follow_each_other():
    with pytest.raises(ValueError, match="have to increase"):
        quintic_path([ViaPoint(1.0, 0.0), ViaPoint(1.0, 1.0)], np.zeros(3))
