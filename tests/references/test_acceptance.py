"""What a person says about a recording counts for every trial that follows it."""

import shutil

import pytest

from rtstack.references.acceptance import (
    Acceptance,
    AcceptanceError,
    AcceptanceState,
    acceptance_file,
    load_acceptance,
    save_acceptance,
)
from rtstack.references.recording import ReferenceError
from rtstack.trials.errors import TrialError
from rtstack.trials.extraction import AROUND_S, extract
from rtstack.trials.specification import TrialSpecification
from rtstack.trials.trial import prepare_trial


@pytest.fixture
def recording(demonstration, tmp_path):
    """A copy of the demonstration, about which something may be said."""
    return shutil.copy(demonstration.path, tmp_path / "recording.mcap")


def nominal_s(recording, cell):
    return prepare_trial(TrialSpecification(str(recording)), cell).reference.nominal_impact_s


def test_an_impact_that_is_set_by_hand_is_the_trials_nominal_one(recording, cell):
    detected_s = nominal_s(recording, cell)
    save_acceptance(recording, Acceptance("grab", "late", AcceptanceState.ACCEPTED, detected_s + 0.05))
    assert nominal_s(recording, cell) == pytest.approx(detected_s + 0.05, abs=1e-9)
    assert load_acceptance(recording).note == "late"


def test_a_rejected_recording_is_not_followed_and_an_impossible_time_is_named(recording, cell):
    save_acceptance(recording, Acceptance(verdict=AcceptanceState.REJECTED))
    with pytest.raises(TrialError, match="rejected"):
        nominal_s(recording, cell)
    save_acceptance(recording, Acceptance(nominal_impact_s=500.0))
    with pytest.raises(TrialError, match="set to 500 s by hand, past its end"):
        nominal_s(recording, cell)


@pytest.mark.parametrize("text", ["", "[]", '{"verdict": "perhaps"}', '{"nominal_impact_s": NaN}', '{"more": 1}'])
def test_a_broken_file_is_one_line_that_says_what_to_do(recording, cell, text):
    acceptance_file(recording).write_text(text)
    with pytest.raises(AcceptanceError, match="remove the file") as error:
        load_acceptance(recording)
    assert "\n" not in str(error.value)
    with pytest.raises(TrialError, match="remove the file"):
        nominal_s(recording, cell)


def test_the_extraction_shows_the_references_that_a_trial_follows(recording, cell):
    reference = prepare_trial(TrialSpecification(str(recording)), cell).reference
    extraction = extract(recording, cell, Acceptance())
    assert extraction.problem is None
    assert extraction.detected_impact_s == extraction.nominal_impact_s == reference.nominal_impact_s
    first = round((reference.nominal_impact_s - AROUND_S) / reference.period_s)
    for arm, side in enumerate(("left", "right")):
        n = len(extraction.t_s)
        assert extraction.velocity[side].ante == reference.ante[arm]["twist"][first : first + n, 1].tolist()
        assert extraction.force[side].post == reference.post[arm]["wrench_ff"][first : first + n, 1].tolist()


def test_what_cannot_be_followed_is_shown_with_its_problem(recording, cell):
    extraction = extract(recording, cell, Acceptance(nominal_impact_s=0.02))
    assert "less than 0.1 s from an end" in (extraction.problem or "")
    assert len(extraction.whole_t_s) > 100
    with pytest.raises(ReferenceError):
        extract(recording.with_name("none.mcap"), cell, Acceptance())
