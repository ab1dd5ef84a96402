"""Zarr (format 2), in the form of Diffusion Policy's replay buffer: the frames of all episodes behind one another.

`data` has an array (frames, ...) for each feature of rtstack.datasets.frames and each camera, `meta/episode_ends` (n,)
where each episode ends. https://github.com/real-stanford/diffusion_policy, diffusion_policy/common/replay_buffer.py
"""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from rtstack.datasets.frames import IMAGES, FrameFormat, written
from rtstack.log.video import pixels_of

_CHUNK = 100  # frames, 2 s at 50 Hz: a learner reads some ten at a time


class Zarr(FrameFormat):
    """A folder: see FrameFormat."""

    name = "zarr"
    needs = ("zarr",)

    def join(self, episodes: Sequence[Path], whole: Path, about: dict[str, Any]) -> None:
        import zarr

        root = zarr.open_group(str(whole), mode="w", zarr_format=2)
        data, lengths, labels = root.create_group("data"), [], []
        arrays: dict[str, zarr.Array] = {}
        for said, found in written(episodes):
            for name, feature in sorted(said["features"].items()):
                values = found[name]
                if name.startswith(IMAGES):
                    shown = {jpeg: pixels_of(jpeg) for jpeg in set(values)}
                    values = np.stack([shown[jpeg] for jpeg in values])
                if name not in arrays:
                    shape, chunks = (0, *values.shape[1:]), (_CHUNK, *values.shape[1:])
                    arrays[name] = data.create_array(name, shape=shape, chunks=chunks, dtype=values.dtype)
                    attributes = {key: each for key, each in feature.items() if key not in ("dtype", "shape")}
                    arrays[name].attrs.update(attributes)
                arrays[name].append(values)
            lengths.append(len(found["action"]))
            labels.append(said["labels"])
        meta = root.create_group("meta")
        meta.create_array("episode_ends", data=np.cumsum(lengths))
        meta.attrs.update({"episodes": labels, "fps": self.fps, **about})
