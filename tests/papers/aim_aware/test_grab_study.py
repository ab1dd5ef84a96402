"""The study of the grab's monitor: what is judged, and how it is counted."""

import json
from collections import Counter
from dataclasses import replace
from pathlib import Path

import pytest

from rtstack.configuration import ConfigurationError
from rtstack.studies.grab.cases import FURTHER, MARKED, TRUE_KIND, FaultKind, judged_file, load_judged
from rtstack.studies.grab.report import About, summarise, write_report
from rtstack.studies.grab.results import RESULTS, Results, check_folder
from rtstack.studies.grab.worker import Finding
from rtstack.trials.errors import TrialError
from rtstack.trials.monitoring import tuning_of
from rtstack.trials.unexpected import Unexpected

FINDING = Finding(
    id="good-0000", fault=None, reference="rice_box/11", displacement_mm=3.0, seed=1, verdict="expected", reason=None,
    kind=None, margin=0.5, verdict_s=1.9, onset_s=1.4, nominal_s=1.4, success=True, failure_reason=None, ticks=5000,
    commit="a",
)  # fmt: skip


def test_the_cases_are_those_of_the_mark() -> None:
    study = load_judged(judged_file())
    every = study.cases(quick=False)
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
    assert every == study.cases(quick=False)
    assert len({case.seed for case in every}) == len({case.id for case in every}) == len(every)


@pytest.mark.parametrize("name", load_judged(judged_file()).objects)
def test_no_tuning_has_seen_what_it_is_judged_by(name) -> None:
    tuned_on = tuning_of(name).provenance
    assert tuned_on["object"] == name
    study = load_judged(judged_file())
    seeds, demonstrations = [{*tuned_on[what], *tuned_on[f"held_out_{what}"]} for what in ("seeds", "demonstrations")]
    assert len(seeds) > 20
    for case in study.cases(quick=False):
        assert case.seed not in seeds
        assert Path(case.reference.file).stem not in demonstrations


def test_a_set_is_of_one_object(tmp_path) -> None:
    path = tmp_path / "judged.toml"
    path.write_text(judged_file().read_text().replace('"parcel/32"', '"bottles/32"'))
    with pytest.raises(ConfigurationError, match=r"sets\.1\.references: a set is of one object"):
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


def test_the_page_has_a_table_for_each_object(tmp_path) -> None:
    parcel = replace(FINDING, id="parcel", reference="parcel/3", verdict="unexpected", reason="load", kind="too heavy")
    about = About("a test", False, "0", 3, {"rice_box": {"object": "rice_box"}, "parcel": {"seeds": [1], "runs": 7}})
    summaries = write_report(tmp_path, [FINDING, parcel], about)
    assert [summaries[name].false_alarms.mean for name in ("rice_box", "parcel")] == [0.0, 1.0]
    page = (tmp_path / "report.html").read_text()
    assert "1 trials are missing" in page
    assert "unexpected: load, too heavy" in page
    assert json.loads((tmp_path / "summary.json").read_text())["parcel"]["reached"] is False


def test_what_was_found_stays_and_a_line_cut_off_is_run_again(tmp_path) -> None:
    check_folder(tmp_path, "one", resume=False)
    with Results(tmp_path, "one") as results:
        results.add(FINDING)
        with pytest.raises(TrialError, match="another study is running"):
            Results(tmp_path, "one")
    with open(tmp_path / RESULTS, "a", encoding="utf-8") as file:
        file.write('{"id": "good-0001", "fault"')
    with pytest.raises(TrialError, match="--resume"):
        check_folder(tmp_path, "one", resume=False)
    with pytest.raises(TrialError, match="another tuning"):
        check_folder(tmp_path, "two", resume=True)
    check_folder(tmp_path, "one", resume=True)
    with Results(tmp_path, "one") as results:
        assert results.findings == {"good-0000": FINDING}
