"""Contact is complete where a pad presses and has stopped against the other one, for long enough. Each condition alone
decides."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from rtstack.control.completion import CompletionDetector
from rtstack.control.parameters import CompletionParameters

P = CompletionParameters()
INTO = Rotation.from_euler("x", 90.0, degrees=True).as_matrix()  # the pad's normal along -y
PRESSED = np.array([0.0, 20.0, 0.0])  # N on the end effector
STILL = np.zeros(3)


def _ticks(detector, n, force=PRESSED, velocity=STILL, other=STILL, first=0, rotation=INTO):
    return [detector.update((first + k) * 1e-3, force, rotation, velocity, other) for k in range(n)]


def test_contact_that_lasts_is_complete():
    assert _ticks(CompletionDetector(P), 30) == [False] * 10 + [True] * 20


def test_sliding_and_going_together_is_no_closing():
    """An object that is carried off by both pads is held."""
    both = np.array([0.1, 0.2, -0.3])
    assert _ticks(CompletionDetector(P), 11, velocity=both, other=both)[-1]
    assert _ticks(CompletionDetector(P), 11, velocity=np.array([0.3, 0.0, 0.2]))[-1]


@pytest.mark.parametrize(
    ("force", "velocity", "other"),
    [
        (np.array([0.0, 4.9, 0.0]), STILL, STILL),  # too weak
        (-PRESSED, STILL, STILL),  # pulled, not pressed
        (np.array([50.0, 0.0, 50.0]), STILL, STILL),  # rubbed, not pressed
        (PRESSED, np.array([0.0, -0.06, 0.0]), STILL),  # still closing
        (PRESSED, STILL, np.array([0.0, 0.06, 0.0])),  # the other one is
        (PRESSED, np.array([0.0, 0.06, 0.0]), STILL),  # bouncing off
    ],
)
def test_no_contact(force, velocity, other):
    detector = CompletionDetector(P)
    assert not any(_ticks(detector, 100, force, velocity, other))
    assert _ticks(detector, 11, first=100)[-1]


def test_an_interruption_begins_anew():
    detector = CompletionDetector(P)
    assert not any(_ticks(detector, 10))
    assert not any(_ticks(detector, 1, force=STILL, first=10))
    assert _ticks(detector, 12, first=11) == [False] * 10 + [True] * 2


def test_a_state_that_is_asked_about_twice_counts_once():
    """Where each arm has its own clock both arms' ticks ask: it is the time that counts."""
    detector = CompletionDetector(P)
    found = [detector.update(k // 2 * 1e-3, PRESSED, INTO, STILL, STILL) for k in range(22)]
    assert found == [False] * 20 + [True] * 2


@given(angles=st.tuples(*3 * [st.floats(-3.0, 3.0)]), press=st.floats(0.0, 10.0), speed=st.floats(-0.1, 0.1))
def test_the_axes_of_the_world_are_of_no_account(angles, press, speed):
    turn = np.ascontiguousarray(Rotation.from_rotvec(angles).as_matrix() @ INTO)
    normal = turn[:, 2].copy()
    across = np.cross(normal, [0.3, 0.5, 0.7])
    force, velocity = 3.0 * across - press * normal, across + speed * normal
    found = _ticks(CompletionDetector(P), 11, force, velocity, -speed * normal, rotation=turn)
    if abs(press - P.force_n) > 1e-6 and abs(abs(speed) - P.speed_m_s) > 1e-6:
        assert found[-1] == (press > P.force_n and abs(speed) < P.speed_m_s)
