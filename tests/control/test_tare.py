"""The detector's tare: an offset neither hides an impact nor is one, and without an offset the law is the paper's."""

from dataclasses import replace
from math import inf

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rtstack.control.detector import ImpactDetector
from rtstack.control.parameters import DetectorParameters

P = DetectorParameters()
PAPER = replace(P, tare_n=inf)
APPROACH = np.array([0.0, -0.35, 0.0])  # m/s
PUSH_BACK = np.array([0.0, 20.0, 0.0])  # N on the end effector
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
