"""Run by lerobot's environment, not ours: loads a data set with its loader and writes what the frames have.

python lerobot_frames.py DATASET OUT.npz
"""

import sys
from typing import Any

import lerobot  # pyright: ignore[reportMissingImports]
import numpy as np
import torch  # pyright: ignore[reportMissingImports]
from lerobot.datasets.lerobot_dataset import LeRobotDataset  # pyright: ignore[reportMissingImports]

NAMES = ("observation.state", "action", "observation.q_1khz", "observation.O_F_ext_hat_K_1khz", "control.mode_1khz")


def main(folder: str, out: str) -> None:
    """Load every frame as a training script would."""
    torch.set_default_dtype(torch.float64)  # the loader makes its tensors of Python's numbers: float32 without it
    dataset = LeRobotDataset("local/export", root=folder)
    frames = [dataset[k] for k in range(len(dataset))]
    ahead = LeRobotDataset("local/export", root=folder, delta_timestamps={"action": [0.0, 1 / dataset.fps]})
    fields: dict[str, Any] = {
        name: np.stack([each[name].numpy() for each in frames]) for name in (*NAMES, *dataset.meta.camera_keys)
    }
    np.savez(
        out,
        fps=dataset.fps,
        episode=[int(each["episode_index"]) for each in frames],
        task=[each["task"] for each in frames],
        success=[each["success"] for each in dataset.meta.episodes],
        action_of_two=ahead[0]["action"].numpy(),
        timestamp=[float(each["timestamp"]) for each in frames],
        utc_ns=[int(each["timing.utc_ns"]) for each in frames],
        mean_state=dataset.meta.stats["observation.state"]["mean"],
        version=lerobot.__version__,
        **fields,
    )


if __name__ == "__main__":
    main(*sys.argv[1:])
