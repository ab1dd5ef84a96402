"""The law, replayed on recorded runs; where it is changed on purpose, they are recorded anew."""

import re

import pytest

from tests.support.recorded_run import FOLDER, KINDS, RENEW, replayed


@pytest.mark.parametrize("kind", KINDS, ids=lambda kind: kind.name)
def test_controller_and_judge_make_the_same_of_recorded_states(kind, cell, demonstration):
    differs = replayed(kind, FOLDER / f"{kind.name}.npz", demonstration.path, cell)
    assert differs is None, f"{differs}; where the law was to change, record the runs anew: {RENEW}"


def test_another_law_is_found(cell, demonstration):
    from dataclasses import replace

    kind = KINDS[0]
    harder = replace(cell, gains=replace(cell.gains, posture_gain=501.0))
    differs = replayed(kind, FOLDER / f"{kind.name}.npz", demonstration.path, harder)
    assert differs is not None
    assert re.fullmatch(r"tick \d+: (left|right) \w+(\[\d\])?: \S+ recorded, \S+ now", differs)
