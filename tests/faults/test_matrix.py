"""A sample of the fault matrix by its own command: each moment, each kind of reaction; and that a case can fail."""

import csv
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
SAMPLE = (
    "stop-asked.idle", "robot-process-killed.teleoperation", "tracker-blind.teleoperation", "reflex.ante",
    "log-process-killed.ante", "packets-lost-for-10-ms.ante", "nan-torque.interim", "exception-in-a-tick.post",
    "parent-gone.stopping",
)  # fmt: skip


@pytest.fixture(scope="module")
def out(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Where all runs of this module write: the demonstration is recorded once."""
    return tmp_path_factory.mktemp("faults")


def run(program: str, out: Path, *arguments: str) -> tuple[int, dict[str, dict[str, str]]]:
    """Run a module; return its exit status and the rows of its table by case."""
    command = [sys.executable, "-m", f"tests.{program}", "--out", str(out), *arguments]
    done = subprocess.run(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, cwd=ROOT)
    table = out / "table.csv"
    assert table.exists(), done.stdout
    with table.open(newline="") as file:
        return done.returncode, {f"{row['fault']}, {row['moment']}": row for row in csv.DictReader(file)}


@pytest.mark.long
def test_a_sample_of_the_matrix(out: Path) -> None:
    status, rows = run("programs.fault_matrix", out, *(word for case in SAMPLE for word in ("--case", case)))
    assert len(rows) == len(SAMPLE)
    assert {name: row["misses"] for name, row in rows.items() if row["misses"]} == {}
    assert status == 0
    assert "refusals" in rows["reflex, ante"]["recovered"]
    assert rows["log process killed, ante"]["log"].startswith("recovered")


@pytest.mark.long
def test_what_is_not_as_it_has_to_be_is_missed(out: Path) -> None:
    status, rows = run("support.faults.sabotage", out)
    assert status == 1
    said = {row["fault"]: row["misses"] for row in rows.values()}
    assert "the reaction is: goes on" in said["nothing is brought about"]
    assert "nothing like 'the moon'" in said["another reason"]
    assert "the fault came in the mode post_impact" in said["another moment"]
    assert "the fault was not brought about" in said["too late"]
    assert "nothing shows that the fault was there" in said["no trace"]
    assert "process left behind" in said["orphan"]


def test_what_there_is_not_is_one_line(tmp_path: Path) -> None:
    command = [sys.executable, "-m", "tests.programs.fault_matrix", "--out", str(tmp_path / "out")]
    done = subprocess.run([*command, "--fault", "bad weather"], capture_output=True, text=True, cwd=ROOT)
    assert done.returncode == 2
    assert "there is no 'bad weather': choose from packets lost for 10 ms, " in done.stderr.splitlines()[-1]
    assert not (tmp_path / "out").exists()
