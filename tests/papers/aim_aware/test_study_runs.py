"""The sample of the study, run by the command line: killed workers, Ctrl-C, and the same results after it."""

import csv
import os
import signal
import sqlite3
import subprocess
import sys
import time
from pathlib import Path

import psutil
import pytest

from rtstack.papers.aim_aware.grid import Case
from rtstack.papers.aim_aware.worker import run_cases

RTSTACK = [sys.executable, "-m", "rtstack", "campaign", "aim-aware-planar", "--quick", "--workers", "1"]
PATIENCE_S = 250.0


def _start(out: Path, *more: str) -> subprocess.Popen[str]:
    pipe = subprocess.PIPE
    return subprocess.Popen(
        [*RTSTACK, "--out", str(out), *more], stdout=pipe, stderr=pipe, text=True, start_new_session=True
    )


def _wait_for_rows(out: Path, count: int, process: subprocess.Popen[str]) -> None:
    end_s = time.monotonic() + PATIENCE_S
    while _rows(out) < count:
        assert process.poll() is None, process.communicate()
        assert time.monotonic() < end_s
        time.sleep(0.02)


def _rows(out: Path) -> int:
    try:
        with sqlite3.connect(f"file:{out / 'campaign.sqlite'}?mode=ro", uri=True) as database:
            return database.execute("SELECT count(*) FROM results").fetchone()[0]
    except sqlite3.Error:
        return 0


@pytest.fixture
def ended():
    """Processes that are ended when the test is."""
    started: list[subprocess.Popen[str]] = []
    yield started
    for process in started:
        if process.poll() is None:
            os.killpg(process.pid, signal.SIGKILL)
        process.communicate()


@pytest.mark.long
def test_interrupted_resumed_and_robbed_of_a_worker_it_gives_what_one_process_gives(
    tmp_path, study_run, ended, command_line
):
    out = tmp_path / "out"
    process = _start(out)
    ended.append(process)
    _wait_for_rows(out, 1, process)
    family = psutil.Process(process.pid).children(recursive=True)
    os.killpg(process.pid, signal.SIGINT)  # as Ctrl-C does: to everybody at once
    _, said = process.communicate(timeout=PATIENCE_S)
    assert process.returncode == 1
    assert said.strip().splitlines()[-1].startswith("rtstack: interrupted; go on with: rtstack campaign")
    assert "Traceback" not in said
    assert psutil.wait_procs(family, timeout=20.0)[1] == []  # nobody is left
    before = _rows(out)
    assert 0 < before < study_run.grid.size()

    process = _start(out, "--resume")
    ended.append(process)
    _wait_for_rows(out, before + 1, process)
    children = psutil.Process(process.pid).children(recursive=True)
    next(child for child in children if "spawn_main" in " ".join(child.cmdline())).kill()
    said, wrong = process.communicate(timeout=PATIENCE_S)
    assert process.returncode == 0, wrong
    assert f"{study_run.grid.size()} simulations" in said

    with open(out / "results.csv", encoding="utf-8") as file:
        rows = {row["id"]: row for row in csv.DictReader(file)}
    assert len(rows) == study_run.grid.size() == _rows(out)
    for row in run_cases(study_run, [Case(90.0, 0.22, deg) for deg in study_run.grid.inclination_deg.values()]):
        kept = rows[row["id"]]
        for name in ("verdict_a", "reason_b", "margin_c", "impacts", "last_ms"):
            assert kept[name] == ("" if row[name] is None else str(row[name])), name
    page = (out / "report.html").read_text(encoding="utf-8")
    assert page.count("data:image/png;base64,") == 4
    assert "http" not in page
    assert (out / "signals.npz").exists()

    again = command_line(*RTSTACK[3:], "--out", out)
    assert again.returncode == 2
    assert "go on with --resume" in again.stderr
