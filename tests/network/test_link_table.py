"""A robot and a control PC in two network namespaces, joined by a cable that is as bad as a row says.

The program `link_table` runs all rows. Here are two whose end does not depend on how busy the machine is; to the
robot an answer that comes too late is one that is lost.
"""

import json
import subprocess
import sys
from pathlib import Path

import pytest

from tests.programs import NOT_PERMITTED
from tests.programs.link_table import CLEAN, ROWS, VENDOR, Outcome

ROOT = Path(__file__).resolve().parents[2]
LOST, CUT = "answers are lost from the middle on", "both ways are cut"


@pytest.mark.alone
@pytest.mark.long
@pytest.mark.timeout(900)
def test_past_what_the_link_stands_it_ends_with_the_vendors_name_and_arms_at_rest(demonstration) -> None:
    rows = [f"--rows={k}" for k, row in enumerate(ROWS) if row.name in (LOST, CUT)]
    command = [sys.executable, "-m", "tests.programs.link_table", "--reference", demonstration.path, "--json", *rows]
    done = subprocess.run(command, capture_output=True, text=True, cwd=ROOT)
    if done.returncode == NOT_PERMITTED:
        pytest.skip(f"metal: a machine that permits network namespaces; here: {done.stderr.strip()}")
    assert done.returncode == 0, done.stderr
    rows = {row["row"]["name"]: row for row in json.loads(done.stdout)}
    assert set(rows) == {LOST, CUT}
    for row in rows.values():
        assert not row["success"]
        assert row["rest"]
        assert row["ticks"] > 0
        assert "\n" not in row["said"]
    assert VENDOR in rows[LOST]["said"]
    assert rows[LOST]["lost"] >= 20
    assert all(row["errors"] == [VENDOR] for row in rows.values())  # the robot's own word, until somebody recovers it


def test_a_row_is_judged_by_what_is_left() -> None:
    row = next(row for row in ROWS if row.name == LOST)
    right = {"said": f'motion aborted by reflex! ["{VENDOR}"]', "begun": True, "ticks": 900, "rest": True}
    for other, wrong in (
        ({}, ""),
        ({"ticks": 0}, "the log cannot be read"),
        ({"ticks": 0, "begun": False, "said": "no reason"}, "the log cannot be read"),
        ({"rest": False}, "an arm moves after the end"),
        ({"success": True}, f"it has to end with {VENDOR}"),
        ({"said": CLEAN[1]}, f"it has to end with {VENDOR}"),
    ):
        outcome = Outcome(row, **(right | other))
        outcome.judge()
        assert outcome.wrong == wrong
