"""What a campaign leaves: logs like any trial's, from which its numbers follow without our code, and one page."""

import csv
import json
import re
import tomllib
from shutil import copytree

import numpy as np
import pytest

from rtstack.cells import default_cell_file
from rtstack.experiments.experiment import Request, Results
from rtstack.experiments.plan_file import PlanFile
from rtstack.experiments.registry import plan_file
from rtstack.experiments.store import Store
from rtstack.log.reader import read_log
from rtstack.loop.end import End
from rtstack.papers.demonstrations import Bench
from rtstack.papers.reference_spreading.controllers import Controller
from rtstack.papers.reference_spreading.experiment import ControllerComparison
from rtstack.papers.reference_spreading.plan import load_plan
from rtstack.papers.reference_spreading.worker import run
from rtstack.papers.simulated_cell import conditioned_cell
from rtstack.topics import TOPICS
from rtstack.trials.record import WholeRunLog, frames, open_log
from rtstack.trials.run_context import RunContext
from rtstack.trials.specification import TrialSpecification
from rtstack.trials.trial import prepare_trial, run_trial
from tests.support.recomputed_trial import recompute


@pytest.fixture
def rows(finished):
    with (finished.out / "results.csv").open() as file:
        return list(csv.DictReader(file))


def test_every_row_names_its_log_seed_commit_and_parameters(finished, rows):
    assert len(rows) == 5
    for row in rows:
        log = read_log(finished.out / row["log"])
        assert log.metadata["campaign"]["id"] == row["id"]
        assert log.metadata["campaign"]["digest"] == row["digest"]
        assert log.metadata["trial"]["git_commit"] == row["git_commit"]
        assert json.loads(log.metadata["trial"]["specification"])["seed"] == int(row["seed"])
        assert log.metadata["result"]["success"] == row["success"].lower()


def test_the_numbers_follow_from_the_log_without_our_code(finished, command, rows):
    criterion = tomllib.loads(command.plan.read_text())["success"]
    for row in rows:
        for name, number in recompute(finished.out / row["log"], criterion).items():
            if number is None or isinstance(number, bool | np.bool_):
                assert row[name] == ("" if number is None else str(number)), name
            else:
                assert float(row[name]) == pytest.approx(float(number), rel=1e-6, abs=1e-6), name


def test_the_log_is_the_one_that_the_log_process_writes(finished, command, cell, rows, tmp_path):
    row = next(row for row in rows if row["controller"] == "proposed")
    plan = load_plan(command.plan)
    reference = finished.out / "references" / "rice_box-0.mcap"
    specification = TrialSpecification(
        str(reference), Controller.PROPOSED, row["object"], float(row["displacement_mm"]), int(row["seed"]),
        law_inertia=plan.conditions["nominal"].law_inertia,
    )  # fmt: skip
    prepared = prepare_trial(specification, cell)
    path = tmp_path / "trial.mcap"
    log = open_log(path, specification, cell, "direct", default_cell_file(), reference=prepared.reference)
    built = conditioned_cell(
        row["object"], 1e-3 * specification.displacement_mm, specification.seed, plan.conditions["nominal"]
    )
    opened = built.open("direct", cell)
    assert run_trial(prepared, opened, RunContext(log), criterion=plan.criterion).success
    opened.close()
    theirs, ours = read_log(path), read_log(finished.out / row["log"])
    assert ours.topics == theirs.topics
    for topic in TOPICS:
        if topic != "/timing":
            assert ours.topic(topic).tobytes() == theirs.topic(topic).tobytes(), topic
    assert ours.messages("/tf") == theirs.messages("/tf")
    assert {a.name for a in ours.attachments} == {a.name for a in theirs.attachments}
    assert ours.metadata.keys() == theirs.metadata.keys() | {"campaign"}
    assert ours.metadata["log"] == theirs.metadata["log"]
    assert ours.metadata["trial"]["law_inertia"] == theirs.metadata["trial"]["law_inertia"] == "M"


@pytest.mark.long
def test_a_trial_over_the_wire_has_the_row_of_the_one_in_the_workers_process(finished, command, rows, tmp_path):
    plan = load_plan(command.plan)
    copytree(finished.out / "references", tmp_path / "references")
    (tmp_path / "logs").mkdir()
    here = next(row for row in rows if row["controller"] == "proposed")
    trial = next(each for each in plan.cases([], {}) if each.id == here["id"])
    bench = Bench(tmp_path, "lockstep", default_cell_file(), "", plan.criterion)
    (there,) = run(bench, trial, plan.conditions[trial.conditions])
    clocked = {name for name in there if name.startswith(("compute_us", "real_time"))} | {"cell"}
    assert len(there.keys() - clocked) > 30
    for name in there.keys() - clocked:
        text = "" if there[name] is None else str(there[name])
        assert text.lower() == here[name].lower(), name
    assert read_log(tmp_path / there["log"]).metadata["trial"]["cell"] == "lockstep"


def test_a_trial_that_the_judge_ends_leaves_its_evidence_in_the_log(finished, cell, tmp_path):
    reference = finished.out / "references" / "rice_box-0.mcap"
    specification = TrialSpecification(str(reference), safety=(("ee_speed_max", 0.1),))
    prepared = prepare_trial(specification, cell)
    log = WholeRunLog(tmp_path / "faulted.mcap", {}, [], frames(cell, specification.object))
    conditions = load_plan(plan_file("reference-spreading").path).conditions["nominal"]
    opened = conditioned_cell(specification.object, 0.0, 1, conditions).open("direct", cell)
    try:
        assert not run_trial(prepared, opened, RunContext(log)).success
    finally:
        opened.close()
    left = read_log(log.path)
    assert left.metadata["fault"]["end"] == End.SAFETY
    assert "the end effector is too fast" in left.metadata["fault"]["detail"]
    assert "last_second.npz" in {attachment.name for attachment in left.attachments}


def test_the_page_needs_nothing_else(finished):
    text = (finished.out / "report.html").read_text()
    sources = re.findall(r"""\s(?:src|href|action)\s*=\s*["']?([^"'>]*)""", text)
    assert len(sources) == 4  # figures 5, 8 and 10, and ours: there is no figure 11 in it
    assert all(source.startswith("data:image/png;base64,") for source in sources)
    assert "url(" not in text
    assert "<script" not in text
    assert {path.name for path in (finished.out / "figures").iterdir()} == {
        "beyond.png",
        *(f"figure{n}.png" for n in (5, 8, 10)),
    }
    fewest = re.search(
        r"no velocity feedback has by far the fewest successful grabs.*?<td class=\"verdict ([a-z-]+)\">", text, re.S
    )
    assert fewest is not None
    assert fewest[1] == "cannot-be-told"  # one reference
    assert "mean force norm: cannot be told with the object displaced." in text


@pytest.fixture
def again(finished, command):
    """The campaign that is finished, and its results, to report on them once more."""
    request = Request(PlanFile(command.plan, "commit"), finished.out)
    experiment = ControllerComparison(load_plan(command.plan), request)
    with Store(finished.out, experiment.columns) as store:
        return experiment, store.rows(experiment.cases([]))


def test_a_controller_that_the_paper_does_not_know_has_its_column(again):
    """One of a plug-in, or of a later version: its trials are run, and then reported."""
    experiment, rows = again
    row = next(row for row in rows if row["controller"] == "proposed")
    sixth = row | {"id": "6", "controller": "sixth_way", "success": False, "failure_reason": "safety: too fast"}
    plan = experiment.specification
    object.__setattr__(plan, "controllers", (*plan.controllers, "sixth_way"))
    report = experiment.report(Results([*rows, sixth], experiment.request.out))
    (part,) = report.parts
    failures = next(table for table in part.tables if table.title == "Failures")
    assert (failures.headings[-1], failures.lines[0][-1]) == ("Sixth way", "1")


def test_experiments_of_any_name_have_a_table_and_a_figure(again, tmp_path):
    experiment, rows = again
    own = [row | {"experiment": "mine", "displacement_mm": d} for row in rows for d in (-10.0, 20.0)]
    (part,) = experiment.report(Results(own, experiment.request.out, preliminary=True)).parts
    (table,) = (table for table in part.tables if table.title == "Experiment mine")
    assert table.headings[:4] == ("controller", "displacement mm", "n", "success")
    assert len(table.lines) == 10
    assert table.lines[-1][:2] == ["Contact completion", "20"]
    (figure,) = part.figures
    figure.draw(tmp_path / figure.file)
    assert (tmp_path / "mine-nominal.png").read_bytes().startswith(b"\x89PNG")
