"""Several trials and campaigns on worker processes, of a script whose controllers are in no module."""

import json
import signal
import subprocess
import sys

import psutil
import pytest

import rtstack
from tests.support.runs import of_the_run

# without `if __name__ == "__main__"`, as a script is that began as a notebook
LAW = """
import json, multiprocessing, os, sys
import rtstack
from rtstack.control.modes import Strategy

def law(request):
    if DIES and multiprocessing.parent_process() is not None:
        os.kill(os.getpid(), 9)
    return request.pair(request.modes(Strategy.NO_INTERIM))

if __name__ != "__main__":
    raise SystemExit("run anew")
reference = sys.argv[1]
"""
TABLES = """
two = rtstack.run_trials(reference, 3, law, displacements=[-20], workers=2)
one = rtstack.run_trials(reference, 3, law, displacements=[-20], workers=1)
print(json.dumps([[row.as_dict() for row in table] for table in (two, one)]))
"""
MANY = """
table = rtstack.run_trials(reference, 400, law, workers=2)
print(len(table), table.missing[-1], flush=True)
"""
CAMPAIGN = """
from pathlib import Path
from rtstack.experiments.experiment import Experiment, Task
from rtstack.experiments.generic import mean_table
from rtstack.experiments.report import Report, Section
from dataclasses import dataclass

@dataclass(frozen=True)
class Plan:
    name: str = "own"
    title: str = "Own"
    quick: bool = False
    def size(self): return 2

@dataclass(frozen=True)
class Case:
    id: str

class Own(Experiment):
    def __init__(self, specification, request):
        super().__init__(specification, request, {"lift": float, "controller": str}, [request.file.path])
    @classmethod
    def read(cls, path, quick): return Plan(quick=quick)
    def cases(self, rows): return [Case("1"), Case("2")]
    def tasks(self, cases): return [Task(each.id, lifted, (each.id,), (each,)) for each in cases]
    def report(self, results):
        return Report([Section("own", tables=[mean_table("lift", results.rows, ["controller"], {"lift": "mm"})])])

def lifted(id):
    row = rtstack.run_trial(reference, law, seed=int(id))
    return [{"id": id, "lift": row.max_lift_mm, "controller": row.controller}]

plan = Path(sys.argv[2]) / "plan.toml"
plan.write_text("")
done = rtstack.run_campaign(Own, plan, plan.with_name("out"), workers=2)
print(done.tally.rows, done.tally.failures, done.page.name, (done.page.parent / "results.csv").read_text())
"""


def printed(process):
    out, errors = process.communicate(timeout=200)
    assert process.returncode == 0, errors
    return out


@pytest.fixture
def script(tmp_path):
    """Start a script as a file: its interpreter knows where its main program is."""

    def start(program, *arguments, dies=False):
        file = tmp_path / "script.py"
        file.write_text(f"DIES = {dies}{LAW}{program}")
        command = [sys.executable, "-W", "error", str(file), *map(str, arguments)]
        return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)

    return start


def test_a_row_is_the_same_on_two_workers_on_one_and_alone(script, demonstration):
    two, one = json.loads(printed(script(TABLES, demonstration.path)))
    assert [row["seed"] for row in two] == [1, 2, 3]
    assert {row["controller"] for row in two} == {"__main__.law"}
    assert all(row["success"] for row in two)
    for ours, theirs in zip(two, one, strict=True):
        alone = rtstack.run_trial(demonstration.path, "no_interim", displacement_mm=-20.0, seed=ours["seed"])
        expected = of_the_run(alone, "controller")
        assert {name: ours[name] for name in expected} == expected
        assert {name: theirs[name] for name in expected} == expected


def _progress(process):
    """Wait for the first trial, and return the workers."""
    while not process.stderr.read(1):
        assert process.poll() is None
    return psutil.Process(process.pid).children(recursive=True)


@pytest.mark.long
def test_ctrl_c_ends_the_workers_and_keeps_the_rows(script, demonstration):
    process = script(MANY, demonstration.path)
    workers = _progress(process)
    process.send_signal(signal.SIGINT)
    count, last = printed(process).split(" ", 1)
    assert 1 <= int(count) < 400
    assert last.strip() == "__main__.law, rice_box, +0 mm, seed 400: interrupted"
    assert psutil.wait_procs(workers, timeout=10.0)[1] == []


@pytest.mark.long
def test_workers_end_with_a_process_that_is_killed(script, demonstration):
    process = script(MANY, demonstration.path)
    workers = _progress(process)
    assert len(workers) >= 2
    process.kill()
    process.communicate()
    assert psutil.wait_procs(workers, timeout=10.0)[1] == []


@pytest.mark.long
def test_a_worker_that_dies_is_said(script, demonstration):
    process = script(TABLES, demonstration.path, dies=True)
    _, errors = process.communicate(timeout=200)
    assert process.returncode == 1
    assert "TrialError: __main__.law, rice_box, -20 mm, seed 1: BrokenProcessPool: A process in the process" in errors


@pytest.mark.long
def test_a_campaign_of_a_class_in_no_module(script, demonstration, tmp_path):
    out = printed(script(CAMPAIGN, demonstration.path, tmp_path))
    assert "2 {} report.html id,lift,controller" in out
    assert out.count("__main__.law") == 2
