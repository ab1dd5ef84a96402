"""A hit as a run of a one-arm cell: in this process and over the wire, its log, and a stop of the safety judge."""

import re
from dataclasses import asdict, replace

import numpy as np
import pytest

from rtstack.experiments.case_log import case_log
from rtstack.experiments.experiment import Request
from rtstack.experiments.registry import plan_file
from rtstack.log.reader import read_log
from rtstack.loop.end import End
from rtstack.model.cell_description import load_cell_description
from rtstack.papers.aim_aware.arm.experiment import PlatformStudy
from rtstack.papers.aim_aware.arm.study import STUDY, ArmRun, LogFolder, load_arm_run, platform_cell_file
from rtstack.papers.aim_aware.arm.worker import hit_case, judged_case, plan_case, prepare_hit, row_of_log, run_cases
from rtstack.papers.aim_aware.outline import Case
from rtstack.papers.aim_aware.platform.hit import hit_parameters, ticks_of
from rtstack.trials.review import log_columns, review_log
from tests.support.fci.server import serve

FILE = plan_file(STUDY).path
CASE = Case(100.0, 0.51, 4.0)


@pytest.fixture(scope="module")
def run() -> ArmRun:
    return load_arm_run(FILE, True)


@pytest.fixture
def plan(run):
    return plan_case(run.study, CASE, run.tuned.learned["100"])


def test_the_cells_file_has_the_arm_and_the_pad_of_the_study(run):
    description = load_cell_description(platform_cell_file())
    assert description.sides == ("left",)
    assert description.pad == run.study.pad
    arms = [asdict(arm) | {"address": ""} for arm in (*description.arms, run.study.mounting)]
    assert arms[0] == arms[1]


def test_a_hit_over_the_wire_in_lockstep_is_the_one_in_this_process_to_the_last_bit(run):
    direct, _ = judged_case(run, CASE)
    served, done = judged_case(replace(run, cell="lockstep"), CASE)
    assert done.stopped == ""
    assert direct.ticks["post"].any()
    assert (direct.ticks == served.ticks).all()


def test_a_hits_log_has_its_ticks_and_says_what_it_was(run, plan, tmp_path):
    impact, done = judged_case(replace(run, logs=LogFolder(tmp_path, "abc")), CASE)
    path = tmp_path / f"{CASE.id}.mcap"
    log, review = read_log(path), review_log(path)
    parameters = hit_parameters(run.study.description, run.study.gains, plan)
    assert (ticks_of(log_columns(log), run.study.description, parameters, End.COMPLETED) == impact.ticks).all()
    assert (review.kind, review.sides, review.complete) == ("hit", ("left",), True)
    assert (review.recorded["success"], done.stopped) == ("true", "")
    assert log.metadata["campaign"]["digest"] == "abc"
    (row,) = run_cases(run, [CASE])
    assert log.metadata["trial"]["seed"] == str(row["seed"])
    again = row_of_log(run, CASE, case_log(path, CASE, "abc"))
    assert {name: again[name] for name in row if name != "cpu_s"} == {k: v for k, v in row.items() if k != "cpu_s"}
    assert case_log(path, CASE, "another campaign's") is None
    assert {a.name for a in log.attachments} == {"cell.toml", "fr3.urdf"}
    # the verdict in the loop is the one that the report makes of the ticks
    found = impact.assess(next(iter(run.monitors().values())))
    assert review.recorded["impact_verdict"] == found.verdict.name.lower()
    assert float(review.recorded["impact_margin"]) == found.margin
    assert [event.text for event in review.events if event.name == "impact"] == [
        f"detected at {1e-3 * int(np.argmax(impact.ticks['post'])):.3f} s, left"
    ]


def test_a_plan_says_whether_its_hits_are_logged(tmp_path):
    for logs in (False, True):
        path = tmp_path / f"{logs}.toml"
        path.write_text(
            FILE.read_text(encoding="utf-8").replace("seed = 70001", f"seed = 70001\nlogs = {str(logs).lower()}")
        )
        experiment = PlatformStudy(load_arm_run(path, True), Request(plan_file(str(path)), tmp_path))
        assert experiment.specification.logs == (LogFolder(tmp_path / "logs", experiment.digest) if logs else None)
        next(experiment.stages())
        assert (tmp_path / "logs").exists() == logs


@pytest.mark.parametrize(
    ("safety", "said"),
    [
        ({"force_max": 80.0}, "left: the pad pushes harder .* N, allowed 80"),  # after the impact
        ({"ee_speed_max": 0.1}, "left: .* m/s, allowed 0.1"),  # before it
    ],
)
def test_a_stop_of_the_judge_ends_the_hit_and_is_said(run, plan, safety, said):
    study, monitoring = run.study, run.monitors()["a"]
    prepared = prepare_hit(study, CASE, plan, monitoring, 1)
    done = hit_case(study, CASE, replace(prepared, description=replace(study.description, safety=safety)))
    assert 0 < len(done.ticks) < len(plan.dq_post)
    assert re.match(said, done.stopped), done.stopped
    assert done.failure_reason == f"safety stop: {done.stopped}"
    whole = hit_case(study, CASE, prepared).ticks
    assert (done.ticks == whole[: len(done.ticks)]).all()  # what the judge stopped is no tick of the hit


@pytest.mark.long  # a hit over the wire is below; the campaign on arms is in tests/cli/test_real_cells.py
def test_the_hits_of_a_plan_are_run_by_an_arm_at_its_address(tmp_path, command_line):
    """Those of a level platform: simulated arms have no person who would incline it."""
    out = tmp_path / "out"
    with serve("--scene", "platform", "--only", "left", "--lockstep") as served:
        words = (STUDY, "--quick", "--cell", f"fci:{served.left}", "--workers", "1")
        done = command_line("campaign", *words, "--out", str(out))
    assert done.returncode == 2
    assert re.search("set the platform to .* degrees: simulated arms have no person who does", done.stderr)
    assert {log.stem for log in (out / "logs").glob("*.mcap")} == {f"{deg}deg-0.51m-+0deg" for deg in (100, 130)}
    for path in (out / "logs").glob("*.mcap"):
        review = review_log(path)
        assert (review.recorded["success"], review.trial["cell"]) == ("true", f"fci:{served.left}")
        assert review.recorded["impact_verdict"] == "expected"
