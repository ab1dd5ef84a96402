"""Appendix B: each of the three conditions alone decides; the tare: an offset neither hides an impact nor is one."""

from dataclasses import replace
from math import inf

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

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


PAPER = replace(P, tare_n=inf)
DIRECTIONS = [np.eye(3)[0], np.eye(3)[1], -np.eye(3)[1], np.eye(3)[2]]


def first_hit(parameters: DetectorParameters, forces: np.ndarray) -> int | None:
    detector = ImpactDetector(parameters, 1e-3)
    hits = [detector.update(np.ascontiguousarray(force), APPROACH) for force in forces]
    return hits.index(True) if True in hits else None


def with_impact(offset: np.ndarray) -> np.ndarray:
    """Forces (700, 3): an offset from the start on, and from tick 500 on an impact that grows by 1 N a tick."""
    forces = np.tile(offset, (700, 1))
    forces[500:] += np.minimum(np.arange(200) + 1.0, 60.0)[:, None] * np.array([0.0, 1.0, 0.0])
    return forces


@pytest.mark.parametrize("direction", DIRECTIONS, ids=["across", "with the impact", "against it", "up"])
@pytest.mark.parametrize("size", [1.5, 4.5, 8.0, 11.5])
def test_an_impact_is_found_at_any_offset_when_it_is_found_without_one(direction, size):
    at = first_hit(P, with_impact(np.zeros(3)))
    assert at == 505  # above 5 N
    assert first_hit(P, with_impact(size * direction)) == at


def test_the_papers_law_is_blind_from_four_newtons_on():
    assert first_hit(PAPER, with_impact(np.array([0.0, 0.0, 4.5]))) is None


def test_what_is_larger_than_a_tare_is_contact():
    assert first_hit(P, with_impact(np.array([0.0, 0.0, 12.5]))) is None


def test_an_offset_that_changes_slowly_is_no_impact():
    """As the pose changes: 8 N within a second, along the approach."""
    forces = np.linspace([0.0, 0.0, 3.0], [0.0, 8.0, 3.0], 1000)
    assert first_hit(P, forces) is None
    assert first_hit(PAPER, forces) is not None


@given(st.integers(0, 2**32 - 1), st.floats(0.0, 0.9))
def test_below_the_threshold_it_is_the_papers_law_bit_by_bit(seed, size):
    rng = np.random.default_rng(seed)
    direction = rng.normal(size=3)
    offset = size * direction / np.linalg.norm(direction)
    forces = with_impact(offset) + rng.normal(scale=0.02, size=(700, 3))
    detectors = [ImpactDetector(one, 1e-3) for one in (P, PAPER)]
    for force in forces:
        mine, papers = (detector.update(force, APPROACH) for detector in detectors)
        assert mine == papers
        if mine:
            return  # from the first impact on the tare stays
    raise AssertionError("the impact was not found")


@pytest.mark.parametrize(
    ("force", "velocity", "message"),
    [
        (np.zeros(2), APPROACH, r"force: expected shape \(3,\), found \(2,\)"),
        (np.zeros(3), np.zeros(6), r"velocity: expected shape \(3,\), found \(6,\)"),
        (np.full(3, np.nan), APPROACH, "force: expected finite numbers, found nan"),
        (None, APPROACH, "force: expected numbers, found object"),
        (np.zeros(3, "U1"), APPROACH, "force: expected numbers, found <U1"),
    ],
)
def test_a_sample_that_does_not_fit_is_refused_and_not_taken(force, velocity, message):
    detector = _after(np.zeros(3), APPROACH)
    before = [part.tobytes() for part in detector.memory]
    with pytest.raises(ValueError, match=message):
        detector.update(force, velocity)
    assert [part.tobytes() for part in detector.memory] == before
    assert detector.update(PUSH_BACK.tolist(), APPROACH.astype(np.float32)) is True


@pytest.mark.parametrize(
    ("parameters", "period_s", "error"),
    [(P, 0.0, ValueError), (P, 0.3, ValueError), (P, 1e-9, ValueError), (P, inf, ValueError), (P, "1", ValueError),
     ({}, 1e-3, TypeError), (replace(P, force_low_n="4"), 1e-3, ValueError)],
)  # fmt: skip
def test_a_detector_that_makes_no_sense_is_refused(parameters, period_s, error):
    with pytest.raises(error, match=r"^[a-z_]+: expected [^\n]+, found [^\n]+$"):
        ImpactDetector(parameters, period_s)
