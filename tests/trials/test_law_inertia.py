"""The inertia of the controller's law: M or M + B_theta, from cell, trial and demonstration into the log and back."""

import json
from dataclasses import replace

import numpy as np
import pytest

import rtstack.trials.record as record
from rtstack.cells import default_cell_file, open_cell
from rtstack.control.parameters import InertiaParameters
from rtstack.log.reader import read_log
from rtstack.model.cell_description import load_cell_description
from rtstack.playback.replay import replay
from rtstack.samples import SIDES, LawInertia
from rtstack.trials.assembly import arm_controllers, cell_parameters, with_law
from rtstack.trials.demonstration import run_demonstration
from rtstack.trials.errors import TrialError
from rtstack.trials.followed import Followed
from rtstack.trials.run_context import RunContext
from rtstack.trials.specification import DemonstrationSpecification, TrialSpecification
from rtstack.trials.trial import prepare_trial, run_trial
from tests.support.runs import StopAfter

LINKS, BOTH = LawInertia.LINKS, LawInertia.LINKS_AND_MOTORS
TICKS = 200


@pytest.fixture(scope="module")
def cell_of_links(tmp_path_factory):
    """A cell's file with the law of the links, and its description."""
    path = tmp_path_factory.mktemp("cell") / "cell.toml"
    text = default_cell_file().read_text()
    path.write_text(text.replace("[tracker]", '[gains]\nlaw_inertia = "M"\n\n[tracker]', 1))
    return path, load_cell_description(path)


@pytest.fixture
def run(demonstration, tmp_path):
    """Write the log of the first ticks of a trial, or of a demonstration; return its path."""

    def run(specification, description, cell_file=None):
        path = tmp_path / "log.mcap"
        around = {}
        is_trial = isinstance(specification, TrialSpecification)
        if is_trial:
            prepared = prepare_trial(specification, description)
            around = {"reference": prepared.reference, "followed": Followed(demonstration.path)}
        opened = open_cell("direct", specification.object, 0.0, specification.seed)
        try:
            log = record.open_log(
                path, specification, description, "direct", cell_file or default_cell_file(), overwrite=True, **around
            )
            context = RunContext(log, stop=StopAfter(TICKS))
            run_trial(prepared, opened, context) if is_trial else run_demonstration(
                specification, description, opened, context
            )
        finally:
            opened.close()
        return path

    return run


def _records(path):
    log = read_log(path)
    return log.metadata["trial"], {f"{side}/{kind}": log.topic(f"/{side}/{kind}") for side in SIDES
                                   for kind in ("arm", "control")}  # fmt: skip


def _same(first, second):
    return all(first[name].tobytes() == second[name].tobytes() for name in first)


def test_the_law_adds_the_motors_inertia_or_does_not(cell):
    masses = []
    for law in (LINKS, BOTH, "M"):
        arm = arm_controllers(cell, with_law(cell_parameters(cell), law))[0]
        arm.sample["q"][0] = cell.left.home
        arm.observe()
        masses.append(arm.workspace["M"][0].copy())
    np.testing.assert_allclose(masses[1] - masses[0], np.diag(cell.left.robot.B_theta), atol=1e-12)
    np.testing.assert_array_equal(masses[0], masses[2])
    with pytest.raises(ValueError, match="'m'"):
        _ = InertiaParameters(law_inertia="m").added


@pytest.mark.long
def test_a_trial_uses_what_it_or_else_its_cell_names_and_the_log_says_which(
    run, cell, cell_of_links, demonstration, monkeypatch
):
    asked, (file, links) = TrialSpecification(str(demonstration.path), seed=3), cell_of_links
    absent, usual = _records(run(asked, cell))
    assert absent["law_inertia"] == "M+B_theta"
    named, again = _records(run(replace(asked, law_inertia=BOTH), links, file))
    assert (named["law_inertia"], json.loads(named["specification"])["law_inertia"]) == ("M+B_theta", "M+B_theta")
    assert _same(usual, again)

    path = run(replace(asked, law_inertia=LINKS), cell)
    named, paper = _records(path)
    assert named["law_inertia"] == "M"
    assert not any(np.array_equal(paper[f"{side}/arm"]["tau_desired"], usual[f"{side}/arm"]["tau_desired"])
                   for side in SIDES)  # fmt: skip
    assert replay(path).same
    path = run(asked, links, file)
    decided, again = _records(path)
    assert (decided["law_inertia"], json.loads(decided["specification"])["law_inertia"]) == ("M", "M")
    assert _same(paper, again)
    assert replay(path).same

    with monkeypatch.context() as patch:
        _forget(patch)
        path = run(asked, cell)
    assert "law_inertia" not in read_log(path).metadata["trial"]
    assert replay(path).same
    with monkeypatch.context() as patch:
        _forget(patch, law_inertia="twice M")
        path = run(asked, cell)
    with pytest.raises(TrialError, match="law_inertia: Input should be 'M' or 'M\\+B_theta'"):
        replay(path)


def _forget(patch, **instead):
    """Write the metadata of a trial as a version did that did not know the setting."""
    made = record.trial_metadata

    def older(*arguments):
        values = made(*arguments)
        del values["law_inertia"]
        asked = json.loads(values["specification"])
        del asked["law_inertia"]
        return values | {"specification": json.dumps(asked)} | instead

    patch.setattr(record, "trial_metadata", older)


def test_a_demonstration_uses_what_it_or_else_its_cell_names(run, cell, cell_of_links):
    asked, (file, links) = DemonstrationSpecification(), cell_of_links
    _, usual = _records(run(asked, cell))
    assert _same(usual, _records(run(replace(asked, law_inertia=BOTH), links, file))[1])
    path = run(replace(asked, law_inertia=LINKS), cell)
    named, paper = _records(path)
    assert named["law_inertia"] == "M"
    assert not _same(usual, paper)
    assert replay(path).same
    decided, again = _records(run(asked, links, file))
    assert decided["law_inertia"] == "M"
    assert _same(paper, again)


def test_a_prepared_trial_names_its_law_and_one_that_is_asked_for_later_counts(cell, demonstration):
    asked = TrialSpecification(str(demonstration.path))
    assert prepare_trial(asked, cell).specification.law_inertia is BOTH
    of_program = with_law(cell_parameters(cell), LINKS)
    assert prepare_trial(asked, cell, of_program).specification.law_inertia is LINKS
    prepared = prepare_trial(replace(asked, law_inertia=BOTH), cell, of_program)
    assert prepared.parameters.inertia.law_inertia is BOTH
