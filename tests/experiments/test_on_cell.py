"""A campaign on arms at their addresses: the object is set in its place by them, and every row comes from its log."""

import csv
import json
import signal
import socket
import time

import pytest

from rtstack.cells import default_cell_file
from rtstack.experiments.cell_runner import aborted
from rtstack.log.reader import read_log
from tests.support.campaigns import PATIENCE_S, Command, two_controllers
from tests.support.fci.server import serve


def free_port() -> int:
    """Return a UDP port that nobody has."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as udp:
        udp.bind(("127.0.0.1", 0))
        return udp.getsockname()[1]


def until(happened, process):
    """Wait until something has happened while a process runs."""
    end_s = time.monotonic() + PATIENCE_S
    while not happened():
        assert process.poll() is None, process.communicate()
        assert time.monotonic() < end_s
        time.sleep(0.05)


@pytest.mark.timeout(900)
def test_a_campaign_runs_on_served_arms_and_what_a_person_aborts_counts_for_nothing(tmp_path):
    out, cell_file, tracker = tmp_path / "out", tmp_path / "cell.toml", f"127.0.0.1:{free_port()}"
    cell_file.write_text(default_cell_file().read_text().replace("127.0.0.1:1341", tracker))
    command = Command(two_controllers(tmp_path / "small.toml", 20.0))
    with serve("--lockstep", "--tracker", tracker) as served:
        kind = f"fci:{served.left},{served.right}"
        words = ("--workers", "1", "--cell", kind, "--cell-file", str(cell_file))
        process = command.start(out, *words)
        until(lambda: any((out / "logs").glob("*")), process)  # the first trial is running: the object was placed
        process.send_signal(signal.SIGINT)
        _, said = process.communicate(timeout=PATIENCE_S)
        assert process.returncode == 2, said
        assert "was aborted, and is run again: stop requested by the operator" in said
        (aborted,) = (out / "logs").glob("*.mcap")
        assert aborted.name.endswith(".aborted-1.mcap")
        done = command.run(out, "--resume", *words)
    assert done.returncode in (0, 1), done.stderr  # 1: a claim of the paper is not reached by so few
    rows = list(csv.DictReader((out / "results.csv").read_text().splitlines()))
    assert len(rows) == 2
    for row in rows:
        log = read_log(out / row["log"])
        assert log.metadata["trial"]["cell"] == kind
        assert log.metadata["campaign"]["id"] == row["id"]
        pose = log.topic("/object/pose")
        first = pose[pose["seen"] == 1][0]["position"]
        assert abs(1e3 * first[1] - float(row["displacement_mm"])) < 6.0
        assert row["success"].lower() == log.metadata["result"]["success"]
    beside, claims = json.loads((out / "report.json").read_text())["tables"]
    assert beside["note"].startswith("2 common rows; ")
    assert len(claims["lines"]) > 0
    assert "Rows of the simulation and the arms" in (out / "report.html").read_text()


@pytest.mark.parametrize(
    ("reason", "counts"),
    [
        (None, True),
        ("safety stop: left: the end effector is too fast", True),
        ("the object was not held until release", True),
        ("stop requested by the operator: on the way to the start pose", False),
        ("the operator let go", False),
        ("the robot left torque control: the left arm has sent no state for 100 ms", False),
    ],
)
def test_an_abort_is_no_result_of_a_controller(reason, counts):
    assert aborted(reason) is not counts


def test_what_cannot_run_on_arms_says_so_before_anything_is_made(tmp_path, command_line):
    done = command_line(
        "campaign", "aim-aware-grab", "--out", str(tmp_path / "out"), "--cell", "fci:127.0.0.11,127.0.0.12"
    )
    assert done.returncode == 2
    assert "aim-aware-grab runs in the simulator: direct, or lockstep" in done.stderr
    assert not (tmp_path / "out").exists()
