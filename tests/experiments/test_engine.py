"""The engine with the smallest experiment: stages, cases, retries, the progress file, the report."""

import hashlib
import inspect
import json
import os
import re
from dataclasses import replace

import pytest

from console.campaigns.folder import CampaignFolder
from hal.base.configuration import ConfigurationError
from rtstack.experiments.experiment import Request, Results
from rtstack.experiments.invocation import Preliminary
from rtstack.experiments.plan_file import PlanFile
from rtstack.experiments.progress import campaign_progress
from rtstack.experiments.report import write_report
from rtstack.experiments.runner import AHEAD, Runner
from rtstack.experiments.store import Store
from tests.support.counting import PLAN, CountingExperiment, count
from tests.support.dask_worker import dask_worker


@pytest.fixture(scope="module")
def client():
    """One worker in this process, whose scheduler remembers every result."""
    with dask_worker() as client:
        yield client


@pytest.fixture
def experiment(tmp_path):
    path, out = tmp_path / "plan.toml", tmp_path / "out"
    path.write_text(PLAN)
    out.mkdir()
    return CountingExperiment(CountingExperiment.read(path, False), Request(PlanFile(path, "commit"), out))


def run(experiment, client):
    """Run what is missing. Returns the rows and what failed."""
    with Store(experiment.request.out, experiment.columns) as store:
        store.claim(experiment)
        with campaign_progress(store.out) as progress:
            runner = Runner(experiment, store, client, progress)
            runner.run()
        return store.rows(), runner.tally


def test_what_fails_is_named_and_run_again_with_the_next_invocation(experiment, client, capsys):
    out = experiment.request.out
    (out / "no-2").touch()
    rows, tally = run(experiment, client)
    assert [row["id"] for row in rows] == ["number-1"]  # the last one waits for the others
    line = inspect.getsourcelines(count)[1] + 3
    assert tally.failures == {"number-2": f"ValueError: no 2 (tests/support/counting.py:{line}); mend it there"}
    assert CampaignFolder(out).stage().done == 1
    (out / "no-2").unlink()
    rows, tally = run(experiment, client)  # the scheduler still has the failure, and the stage, under their old keys
    assert [row["number"] for row in rows] == [1, 2, 3]
    assert (tally.rows, tally.robot_s, tally.failures) == (2, 2.0, {})
    for row in rows:
        assert (row["digest"], row["worker"].split(":")[1]) == (experiment.digest, str(os.getpid()))
    said = capsys.readouterr().err.splitlines()
    assert said[0] == "looking for fingers: 0 of 1"
    assert said[-1].startswith("trials: 3 of 3")


def test_the_scheduler_knows_of_a_few_tasks_at_a_time(experiment, client):
    """However many cases a campaign has: a scheduler remembers each task, and its result, as long as somebody does."""
    many = 5 * AHEAD
    experiment.specification = replace(experiment.specification, numbers=tuple(range(many)))
    known = []
    with Store(experiment.request.out, experiment.columns) as store:
        store.claim(experiment)
        with campaign_progress(store.out) as progress:
            Runner(experiment, store, client, progress, lambda: known.append(len(client.futures))).run()
        assert len(store.rows()) == len(known) == many
    assert max(known) <= AHEAD + 2  # one that has ended, and one of the stage before
    assert set(client.cluster.scheduler.task_prefixes) == {"task"}  # each has statistics that nothing deletes


def test_a_page_learns_of_any_stage_from_the_file(tmp_path):
    """Whatever a stage is called: no label is a special one."""
    folder = CampaignFolder(tmp_path)
    assert (folder.stage().label, folder.stage().total) == ("starting", None)
    with campaign_progress(tmp_path) as progress:
        for label in ("friction identification", "identification along the references", "trials"):
            progress.begin(label, 0, 7)
            assert (folder.stage().label, folder.stage().done, folder.stage().total) == (label, 0, 7)
            for _ in range(3):
                progress.advance()
            progress.close()
            assert folder.stage().done == 3


def test_rows_become_claims_a_table_a_figure_and_a_page(experiment, client):
    rows, _ = run(experiment, client)
    out = experiment.request.out
    with Store(out, experiment.columns) as store:
        page = write_report(experiment.report(Results(rows, out)), experiment, store, rows).read_text()
    numbers = json.loads((out / "report.json").read_text())
    assert (numbers["plan"], numbers["digest"]) == ("counting", experiment.digest)
    assert numbers["conditions"][0]["claims"][0]["verdict"] == "holds"
    assert (out / "figures" / "numbers.png").read_bytes().startswith(b"\x89PNG")
    assert len(re.findall("data:image/png;base64,", page)) == 1
    assert '<td>False</td><td class="number">2</td>' in page
    assert "3 of 3 trials" in page


CLAIMED = """
[registration]
excluded = ["numbers that are not whole"]
chosen_on = ["numbers above 100"]

[[claims]]
judge = "even"
where = "2"
mark = "one at least"
"""


def reported(experiment):
    out = experiment.request.out
    with Store(out, experiment.columns) as store:
        store.claim(experiment)
        rows = store.rows(experiment.cases(store.rows()))
        page = write_report(experiment.report(Results(rows, out)), experiment, store, rows).read_text()
    return page, json.loads((out / "report.json").read_text())


def changed(experiment, text):
    """The same folder, with a plan whose file was changed meanwhile."""
    experiment.request.file.path.write_text(text)
    kind = type(experiment)
    return kind(kind.read(experiment.request.file.path, False), experiment.request)


def test_the_report_says_that_claims_were_changed_after_results_existed(experiment, client):
    run(experiment, client)
    page, numbers = reported(experiment)
    assert "changed after results existed" not in page
    assert numbers["registration"]["changed"] is False
    later = changed(experiment, PLAN + CLAIMED)
    assert later.digest == experiment.digest  # no row depends on it
    page, numbers = reported(later)
    assert "The plan's file was changed after results existed" in page
    registration = numbers["registration"]
    assert registration["changed"] is True
    assert registration["first_digest"] == hashlib.sha256(PLAN.encode()).hexdigest() in page
    assert registration["digest"] == hashlib.sha256((PLAN + CLAIMED).encode()).hexdigest()
    back = changed(experiment, PLAN)
    assert "changed after results existed" not in reported(back)[0]


def test_a_plan_may_change_before_its_first_result(experiment, client):
    with Store(experiment.request.out, experiment.columns) as store:
        store.claim(experiment)
    later = changed(experiment, PLAN + CLAIMED)
    run(later, client)
    page, numbers = reported(later)
    assert numbers["registration"]["changed"] is False
    assert "numbers that are not whole" in page
    assert "numbers above 100" in page


def test_what_the_paper_claims_and_what_we_ask_for_are_two_columns(experiment, client):
    ours = changed(experiment, PLAN + CLAIMED)
    run(ours, client)
    page, numbers = reported(ours)
    (claim,) = numbers["conditions"][0]["claims"]
    assert (claim["where"], claim["claim"], claim["mark"], claim["figures"]) == ("2", "", "one at least", "1 of 3")
    assert "<td>2</td><td>-</td><td>one at least</td><td>1 of 3</td>" in page


@pytest.mark.parametrize(
    ("claim", "said"),
    [
        ('judge = "odd"\nwhere = "1"\nsays = "some are odd"', "key claims.0.judge: unknown 'odd': choose one of even"),
        ('judge = "even"\nwhere = "1"', "key claims.0: give says"),
        ('judge = "even"\nsays = "some are even"', "key claims.0.where"),
    ],
)
def test_a_claim_that_nobody_can_judge_is_refused(experiment, claim, said):
    with pytest.raises(ConfigurationError, match=said):
        changed(experiment, f"{PLAN}[[claims]]\n{claim}\n")


def test_figures_and_claims_of_results_so_far(experiment, client, monkeypatch):
    run(experiment, client)
    out = experiment.request.out
    with Store(out, experiment.columns) as store:
        preliminary = Preliminary(experiment, store)
        preliminary()
        assert CampaignFolder(out).figures() == {}  # not yet
        monkeypatch.setattr(preliminary, "_due_s", 0.0)
        preliminary()
    folder = CampaignFolder(out)
    assert [path.name for path in folder.figures().values()] == ["numbers.png"]
    assert folder.claims()[0]["claim"] == "some are even"
    assert folder.report is None
