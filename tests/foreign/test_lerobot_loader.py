"""lerobot's own loader, unmodified and from PyPI, reads the export: its frames are the log's, bit for bit.

The first run installs lerobot with PyTorch, some 6 GB, into `.venv-foreign`.
"""

import os
import subprocess
from pathlib import Path

import numpy as np
import pytest

from rtstack.datasets.export import export
from rtstack.datasets.lerobot import LeRobot
from tests.support.foreign_robot import environment
from tests.support.log.samples import TRIAL, write_log

PROGRAM = Path(__file__).parents[1] / "programs" / "lerobot_frames.py"
STEP = 20  # ticks of a frame at 50 Hz

pytestmark = [pytest.mark.long, pytest.mark.timeout(3600)]


def test_the_loaders_frames_are_the_logs(tmp_path: Path) -> None:
    trial = {**TRIAL, "object": "rice_box"}
    logs = [write_log(tmp_path / f"{k}.mcap", 200 + 30 * k, seed=k, trial=trial) for k in (0, 1)]
    export([log.path for log in logs], tmp_path / "grabs", LeRobot())
    python = environment("lerobot") / "bin" / "python"
    offline = {"HF_HUB_OFFLINE": "1", "HF_HOME": str(tmp_path / "cache"), "PATH": os.environ["PATH"]}
    command = [str(python), str(PROGRAM), str(tmp_path / "grabs"), str(tmp_path / "frames.npz")]
    done = subprocess.run(command, env=offline, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr[-3000:]
    frames = np.load(tmp_path / "frames.npz")
    assert int(frames["fps"]) == 50
    assert set(frames["task"].tolist()) == {"grab the rice box with both arms"}
    assert frames["success"].tolist() == ["true", "true"]
    for number, log in enumerate(logs):
        rows = frames["episode"] == number
        count = int(rows.sum())
        assert count == len(log.columns["/timing"]) // STEP
        sides = [log.columns[f"/{side}/arm"][: STEP * count] for side in ("left", "right")]
        state = np.hstack([side[name][STEP - 1 :: STEP] for name in ("q", "dq") for side in sides])
        assert frames["observation.state"][rows].tobytes() == state.tobytes()
        for name in ("q", "O_F_ext_hat_K"):
            ticks = np.hstack([side[name] for side in sides]).reshape(count, STEP, -1)
            assert frames[f"observation.{name}_1khz"][rows].tobytes() == ticks.tobytes()
    assert frames["action_of_two"].tobytes() == frames["action"][:2].tobytes()
