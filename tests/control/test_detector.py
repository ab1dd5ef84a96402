"""Appendix B: each of the three conditions alone decides."""

from dataclasses import replace
from math import inf

import numpy as np
import pytest

from rtstack.control.detector import ImpactDetector
from rtstack.control.parameters import DetectorParameters

P = DetectorParameters()
APPROACH = np.array([0.0, -0.35, 0.0])  # m/s
PUSH_BACK = np.array([0.0, 20.0, 0.0])  # N on the end effector


def _after(quiet_force: np.ndarray, velocity: np.ndarray, samples: int = 300) -> ImpactDetector:
    detector = ImpactDetector(P, 1e-3)
    for _ in range(samples):
        assert not detector.update(quiet_force, velocity)
    return detector


def test_an_impact_is_found():
    assert _after(np.zeros(3), APPROACH).update(PUSH_BACK, APPROACH)


def test_the_force_may_keep_its_time_for_the_length_of_the_window():
    detector = _after(np.zeros(3), APPROACH)
    hits = [detector.update(PUSH_BACK, np.zeros(3)) for _ in range(300)]
    assert hits == [True] * 200 + [False] * 100


@pytest.mark.parametrize(
    ("before", "velocity", "now"),
    [
        (np.array([0.0, 4.5, 0.0]), APPROACH, PUSH_BACK),  # 1) already in contact
        (np.zeros(3), APPROACH, np.array([0.0, 4.9, 0.0])),  # 2) too weak
        (np.zeros(3), np.zeros(3), PUSH_BACK),  # 3) was at rest
        (np.zeros(3), -APPROACH, PUSH_BACK),  # 3) moved with the force, not against it
        (np.zeros(3), np.array([0.35, 0.0, 0.0]), PUSH_BACK),  # 3) moved across it
    ],
)
def test_no_impact(before, velocity, now):
    detector = ImpactDetector(replace(P, tare_n=inf), 1e-3)  # the tare has tests of its own
    for _ in range(300):
        detector.update(before, velocity)
    assert not detector.update(now, velocity)


def test_nothing_is_detected_before_the_window_is_full():
    detector = _after(np.zeros(3), APPROACH, samples=199)
    assert not detector.update(PUSH_BACK, APPROACH)
