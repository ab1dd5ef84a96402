"""The same results whoever computes them, and whatever interrupts it: real workers, really killed."""

import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import psutil
import pytest

from hal.base.configuration import ConfigurationError
from rtstack.cli.campaign import campaign
from rtstack.experiments import workers
from rtstack.trials.errors import TrialError

BIN = Path(sys.executable).parent
PATIENCE_S = 280.0  # for a step that takes seconds, on a machine that is busy
SCHEDULER = (f"127.205.{os.getpid() // 250 % 250}.{1 + os.getpid() % 250}", 18786)


def logs(out):
    return sorted(path.name for path in (out / "logs").glob("*.mcap"))


def wait_for_logs(out, count, process):
    deadline = time.monotonic() + PATIENCE_S
    while len(logs(out)) < count:
        assert process.poll() is None, process.communicate()
        assert time.monotonic() < deadline
        time.sleep(0.05)


def wait_for_end(processes):
    _, left = psutil.wait_procs(processes, timeout=PATIENCE_S)
    assert left == []


@pytest.fixture
def scheduler():
    """A Dask scheduler and a worker of it, in processes of their own."""
    host, port = SCHEDULER
    address = f"tcp://{host}:{port}"
    commands = (
        [BIN / "dask", "scheduler", "--host", host, "--port", str(port), "--no-dashboard"],
        [BIN / "dask", "worker", address, "--host", host, "--nthreads", "1", "--no-dashboard", "--no-nanny"],
    )
    quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    processes = [subprocess.Popen([str(word) for word in command], **quiet) for command in commands]
    yield address
    for process in reversed(processes):
        process.terminate()
        process.wait(PATIENCE_S)


def test_it_says_how_fast_it_was_and_where_the_report_is(finished):
    assert finished.process.returncode == 0, finished.process.stderr
    first, second = finished.process.stdout.splitlines()
    assert "5 trials" in first
    assert "x real time, logs included" in first
    assert second == f"report: {finished.out / 'report.html'}"
    assert len(logs(finished.out)) == 5


@pytest.fixture
def start(command):
    """Start campaigns; one that a failed test leaves behind is ended with it."""
    processes = []

    def start(out, *more):
        processes.append(command.start(out, *more))
        return processes[-1]

    yield start
    for process in processes:
        process.kill()
        process.communicate()


def kill_a_worker(process):
    children = psutil.Process(process.pid).children(recursive=True)
    next(child for child in children if "spawn_main" in " ".join(child.cmdline())).kill()


@pytest.mark.timeout(4 * PATIENCE_S)
@pytest.mark.long
def test_killed_interrupted_and_resumed_elsewhere_it_gives_the_same_results(
    command, finished, results, scheduler, start, tmp_path
):
    out = tmp_path / "out"
    killed = start(out, "--workers", "1")
    wait_for_logs(out, 1, killed)
    kill_a_worker(killed)  # another one takes its trial
    wait_for_logs(out, 2, killed)
    family = psutil.Process(killed.pid).children(recursive=True)
    assert family
    killed.kill()
    killed.communicate()
    wait_for_end(family)  # nothing goes on without it
    kept = {name: (out / "logs" / name).stat().st_mtime_ns for name in logs(out)}

    interrupted = start(out, "--workers", "2", "--resume")
    wait_for_logs(out, len(kept) + 1, interrupted)
    family = psutil.Process(interrupted.pid).children(recursive=True)
    os.killpg(interrupted.pid, signal.SIGINT)  # as Ctrl-C does: to everybody at once
    said = interrupted.communicate(timeout=PATIENCE_S)[1].splitlines()
    assert interrupted.returncode == 1
    assert said[-1].startswith("rtstack: interrupted; go on with: rtstack campaign")
    assert all(line.startswith(("trials: ", "rtstack: ")) for line in said), said
    wait_for_end(family)
    kept |= {name: (out / "logs" / name).stat().st_mtime_ns for name in logs(out)}

    resumed = command.run(out, "--scheduler", scheduler, "--resume")
    assert resumed.returncode == 0, resumed.stderr
    assert results(out) == results(finished.out)
    assert {name: (out / "logs" / name).stat().st_mtime_ns for name in kept} == kept  # no trial was run again


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"resume": True}, "there is nothing to resume"),
        ({"scheduler": "tcp://127.73.5.1:9"}, "no scheduler at tcp://127.73.5.1:9"),
        ({"scheduler": "tcp://127.73.5.1:9", "workers": 2}, "give one of them"),
        ({"quick": True}, "no experiment has a quick sample"),
    ],
    ids=["resume", "scheduler", "both", "quick"],
)
def test_bad_input_is_one_line_and_writes_nothing(command, tmp_path, monkeypatch, options, said):
    monkeypatch.setattr(workers, "CONNECT_S", 0.5)
    out = tmp_path / "out"
    arguments = {"quick": False, "workers": None, "scheduler": None, "resume": False} | options
    with pytest.raises((TrialError, ConfigurationError), match=re.escape(said)) as refused:
        campaign(str(command.plan), out, **arguments)
    assert "\n" not in str(refused.value)
    assert not out.exists()


def test_a_folder_with_results_is_not_begun_again(command, finished, command_line):
    again = command_line("campaign", command.plan, "--out", finished.out)
    assert again.returncode == 2
    (line,) = again.stderr.splitlines()
    assert "go on with --resume" in line
