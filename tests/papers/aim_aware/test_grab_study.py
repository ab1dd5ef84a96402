"""The study of the grab's monitor: what is judged, and how it is counted."""

from collections import Counter
from dataclasses import asdict, replace
from pathlib import Path

import pytest

from hal.base.configuration import ConfigurationError
from rtstack.experiments.claims import ClaimStatus
from rtstack.experiments.experiment import Results
from rtstack.experiments.registry import plan_file
from rtstack.papers.aim_aware.grab.cases import FURTHER, MARKED, TRUE_KIND, FaultKind, load_judged
from rtstack.papers.aim_aware.grab.report import report, summarise
from rtstack.papers.aim_aware.grab.worker import GrabOutcome
from rtstack.trials.monitoring import tuning_of
from rtstack.trials.unexpected import Unexpected

FILE = plan_file("aim-aware-grab").path
FINDING = GrabOutcome(
    id="good-0000", fault=None, reference="rice_box/11", displacement_mm=3.0, seed=1, verdict="expected", reason=None,
    kind=None, margin=0.5, verdict_s=1.9, onset_s=1.4, nominal_s=1.4, success=True, failure_reason=None, ticks=5000,
)  # fmt: skip


def test_the_cases_are_those_of_the_mark() -> None:
    study = load_judged(FILE)
    every = study.cases()
    cases = [case for case in every if case.reference.object == "rice_box"]
    count = Counter(case.fault for case in cases)
    assert count[None] == 400
    assert sum(count[kind] for kind in MARKED) == 400
    assert all(66 <= count[kind] <= 67 for kind in MARKED)
    assert all(count[kind] == 10 for kind in FURTHER)
    assert set(TRUE_KIND.values()) == set(Unexpected) - {Unexpected.UNKNOWN}  # the confusion table has a row for each
    assert len({case.seed for case in cases}) == len(cases) == 830
    shifted = {abs(case.displacement_mm) for case in cases if case.fault is FaultKind.SHIFTED}
    assert shifted == {60.0}
    displaced = (FaultKind.SHIFTED, FaultKind.FAR_SIDE)
    others = [case.displacement_mm for case in cases if case.fault not in displaced]
    assert -30.0 <= min(others) < -29.0
    assert 29.0 < max(others) <= 30.0
    assert every == study.cases()
    assert len({case.seed for case in every}) == len({case.id for case in every}) == len(every)


@pytest.mark.parametrize("name", load_judged(FILE).objects)
def test_no_tuning_has_seen_what_it_is_judged_by(name) -> None:
    tuned_on = tuning_of(name).provenance
    assert tuned_on["object"] == name
    study = load_judged(FILE)
    seeds, demonstrations = [{*tuned_on[what], *tuned_on[f"held_out_{what}"]} for what in ("seeds", "demonstrations")]
    assert len(seeds) > 20
    for case in study.cases():
        assert case.seed not in seeds
        assert Path(case.reference.file).stem not in demonstrations


def test_a_set_is_of_one_object(tmp_path) -> None:
    path = tmp_path / "judged.toml"
    path.write_text(FILE.read_text().replace('"parcel/32"', '"bottles/32"'))
    with pytest.raises(ConfigurationError, match=r"sets\.1\.references: a set must have one object"):
        load_judged(path)


def test_a_verdict_counts_where_it_is_right() -> None:
    push = replace(FINDING, id="faulty-5", fault=str(FaultKind.PUSH), verdict="unexpected", kind="a person's push")
    late, early = replace(push, onset_s=1.8, verdict_s=1.82), replace(push, onset_s=2.0, verdict_s=1.82)
    missed = replace(push, fault=str(FaultKind.LIGHT), verdict="expected", kind=None)
    alarm = replace(FINDING, verdict="unexpected", kind="too heavy")
    assert [f.right for f in (FINDING, late, early, missed, alarm)] == [True, True, False, False, False]
    summary = summarise([FINDING, late, early, missed, alarm])
    assert summary.found.mean == pytest.approx(1.0 / 3.0)
    assert summary.false_alarms.mean == 0.5
    assert not summary.reached
    assert summary.confusion["too light"] == {"expected": 1}
    assert len(summary.wrong) == 3
    wide = replace(missed, fault=str(FaultKind.WIDER))
    further = summarise([FINDING, late, early, missed, alarm, wide])
    assert further.found == summary.found  # the mark does not count it
    assert further.confusion["too early"] == {"expected": 1}
    (line,) = (line for line in summary.lines if line.name == FaultKind.PUSH)
    assert line.delay_ms[0] == pytest.approx(20.0)
    assert summarise([FINDING, late]).reached


def test_the_report_has_a_part_for_each_object() -> None:
    parcel = replace(FINDING, id="parcel", reference="parcel/3", verdict="unexpected", reason="load", kind="too heavy")
    tunings = {"rice_box": {"object": "rice_box"}, "parcel": {"seeds": [1], "runs": 7}}
    rows = [asdict(FINDING), *(asdict(replace(parcel, id=str(n))) for n in range(2))]
    made = report(tunings, Results(rows, Path()), load_judged(FILE).claims)
    assert [part.name for part in made.parts] == ["rice_box", "parcel"]
    assert [part.numbers["false_alarms"]["share"] for part in made.parts] == [0.0, 1.0]
    assert [claim.verdict for claim in made.parts[1].claims] == [ClaimStatus.UNDECIDED, ClaimStatus.DIFFERS]
    assert [claim.verdict for claim in made.parts[0].claims] == [ClaimStatus.UNDECIDED] * 2  # one trial tells nothing
    assert {claim.says for part in made.parts for claim in part.claims} == {""}  # the paper has no such experiment
    assert made.parts[0].claims[0].mark == "at least 99 % of the faults are found"
    assert made.parts[1].numbers["wrong"][0]["kind"] == "too heavy"
    assert not made.reached
    assert "false alarms: 100.0 %" in made.summary
