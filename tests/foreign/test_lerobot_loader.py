"""lerobot's own loader, unmodified and from PyPI, reads the export: its frames are the log's, bit for bit.

The first run installs lerobot with PyTorch, some 6 GB, into `.venv-foreign`. LEROBOT_PYTHON names the python of another
environment with lerobot, such as one of 0.6, which needs Python 3.12.
"""

import io
import os
import subprocess
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest
from PIL import Image

from rtstack.datasets.export import export
from rtstack.datasets.lerobot import LeRobot
from tests.support.foreign_robot import environment
from tests.support.log.samples import TRIAL, write_log
from tests.support.log.seen import write_seen_log
from tests.support.quaternions import changes_of_sign

PROGRAM = Path(__file__).parents[1] / "support" / "lerobot_frames.py"
STEP = 20  # ticks of a frame at 50 Hz

pytestmark = [pytest.mark.long, pytest.mark.timeout(3600)]


def _loaded(folder: Path, name: str):
    python = os.environ.get("LEROBOT_PYTHON") or environment("lerobot") / "bin" / "python"
    offline = {"HF_HUB_OFFLINE": "1", "HF_HOME": str(folder / "cache"), "PATH": os.environ["PATH"]}
    command = [str(python), str(PROGRAM), str(folder / name), str(folder / "frames.npz")]
    done = subprocess.run(command, env=offline, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr[-3000:]
    return np.load(folder / "frames.npz")


@pytest.mark.parametrize("video", [False, True], ids=["pictures", "films"])
def test_the_loader_shows_the_pictures_of_the_frames(tmp_path: Path, video: bool) -> None:
    log = write_log(tmp_path / "log.mcap", 430, seed=0, trial={**TRIAL, "object": "rice_box"})
    _, shown = write_seen_log(log.path, tmp_path / "seen.mcap")
    export([tmp_path / "seen.mcap"], tmp_path / "grabs", LeRobot(video=video))
    frames = _loaded(tmp_path, "grabs")["observation.images.front"]
    times = pq.read_table(tmp_path / "grabs" / "data")["timing.picture_t_ns.front"].to_pylist()
    known = {t_ns: np.asarray(Image.open(io.BytesIO(jpeg))) for t_ns, jpeg in shown}
    assert len(frames) == len(times) == 430 // STEP
    for frame, t_ns in zip(frames, times, strict=True):  # (channels, rows, columns), 0 to 1
        loss = np.rint(255.0 * frame) - known[t_ns].transpose(2, 0, 1)
        assert np.abs(loss).mean() < (4.0 if video else 1e-9)


def test_the_loaders_frames_are_the_logs(tmp_path: Path) -> None:
    trial = {**TRIAL, "object": "rice_box"}
    logs = [write_log(tmp_path / f"{k}.mcap", 200 + 30 * k, seed=k, trial=trial) for k in (0, 1)]
    export([log.path for log in logs], tmp_path / "grabs", LeRobot())
    frames = _loaded(tmp_path, "grabs")
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
        wanted = np.hstack([log.columns[f"/{side}/control"]["pose_ref"] for side in ("left", "right")])
        action = frames["action"][rows]
        assert np.abs(action[:-1]).tobytes() == np.abs(wanted[2 * STEP - 1 : STEP * count : STEP]).tobytes()
        assert [changes_of_sign(action[:, k : k + 4]) for k in (3, 10)] == [0, 0]
        assert frames["timestamp"][rows] == pytest.approx(np.arange(count) / 50, abs=1e-5)
    assert frames["action_of_two"].tobytes() == frames["action"][:2].tobytes()
