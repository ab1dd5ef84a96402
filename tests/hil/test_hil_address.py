"""The suite by address, as it is run against metal: here against the simulated cell, as far as that is not moved."""

import subprocess
import sys
from pathlib import Path

import pytest

from tests.support.hil.robot import Robot

HERE = Path(__file__).parent


@pytest.mark.long
def test_by_address_it_leaves_a_report_with_a_verdict_per_number(robot: Robot, tmp_path: Path) -> None:
    report = tmp_path / "kept" / "report.md"
    files = [HERE / "test_01_link.py", HERE / "test_05_impact.py"]
    options = ["--cell", f"{robot.left},{robot.right}", "--hil-report", report, "-p", "no:cacheprovider"]
    done = subprocess.run([sys.executable, "-m", "pytest", "-q", *files, *options], capture_output=True, text=True)
    assert done.returncode == 0, done.stdout
    text = report.read_text()
    assert f"- arms: {robot.left},{robot.right}" in text
    for said in ("- date: 20", "numpy ", "- commit: ", "libfranka "):
        assert said in text
    rows = [[cell.strip() for cell in line.split("|")[1:-1]] for line in text.splitlines() if line.startswith("| 0")]
    assert [(row[0], row[2]) for row in rows] == [("01", "pass")] * 3 + [("05", "not run")]
    assert "left states missed" in rows[0][3]
    assert rows[3][3].startswith("metal: the arms would grab")
