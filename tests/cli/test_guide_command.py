"""`rtstack guide` over the wire: a scripted hand pushes a simulated arm back from beyond a limit of the cell's file."""

import json
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from rtstack.cells import default_cell_file
from tests.support.fci.server import serve

COMMAND = Path(sys.executable).with_name("rtstack")
# a hand that pushes joint 1 of the left arm back, harder and harder, and lets go
HAND = "".join(
    f"""
[[fault]]
kind = "joint_push"
arm = "left"
at_s = {0.5 + 0.1 * k}
duration_s = {1.6 - 0.1 * k}
torque_Nm = [2.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]
"""
    for k in range(4)
)


def run(*words: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [str(COMMAND), "guide", *words], capture_output=True, text=True, stdin=subprocess.DEVNULL, timeout=120
    )


@pytest.mark.long
def test_a_hand_leads_an_arm_back_over_the_wire(tmp_path):
    pytest.importorskip("pylibfranka")  # not every Python has it
    # home has joint 1 of the left arm at -0.302 rad: this cell begins at -0.25
    narrow = "q_lower = [-0.25, -1.7, -2.9, -3.0, -2.8, 0.55, -3.0]\n[tracker]"
    (tmp_path / "narrow.toml").write_text(default_cell_file().read_text().replace("[tracker]", narrow, 1))
    (tmp_path / "hand.toml").write_text(HAND)
    with serve("--lockstep", "--object=none", f"--faults={tmp_path / 'hand.toml'}") as served:
        cell = f"--cell=fci:{served.left},{served.right}"
        done = run(cell, f"--cell-file={tmp_path / 'narrow.toml'}", "--seconds=6", "--json")
    assert done.returncode == 0, done.stdout + done.stderr
    result = json.loads(done.stdout)
    assert result["beyond_before"] == ["left arm, joint 1: -0.302 rad, allowed -0.250 to 2.745"]
    assert result["beyond_after"] == []


@pytest.mark.long
def test_without_a_hand_nothing_moves():
    done = run("--seconds=1")
    said = done.stdout.splitlines()
    assert (done.returncode, said[0]) == (0, "let go | both arms are inside the cell's limits")
    # home: the middle of the pads' faces at y = 0.35 m and -0.35 m
    places = [re.findall(r"-?\d\.\d{4}", line) for line in said[1:]]
    assert np.allclose(np.array(places, dtype=float), [[0.0, 0.35, 0.26], [0.0, -0.35, 0.26]], atol=1e-3)
