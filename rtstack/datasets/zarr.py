"""Zarr (format 2), in the form of Diffusion Policy's replay buffer: the frames of all episodes behind one another.

`data` has an array (frames, ...) for each feature of rtstack.datasets.frames and each camera, `meta/episode_ends` (n,)
where each episode ends. https://github.com/real-stanford/diffusion_policy, diffusion_policy/common/replay_buffer.py
"""

import io
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from rtstack.datasets.episode import Episode, Pictures
from rtstack.datasets.frames import FrameFormat, frames_of, pictures_at
from rtstack.log.errors import LogError

_CHUNK = 100  # frames, 2 s at 50 Hz: a learner reads some ten at a time
_SAID = "said"


class Zarr(FrameFormat):
    """A Format, a folder: see FrameFormat."""

    name = "zarr"
    needs: tuple[str, ...] = ("zarr",)

    def write(self, episode: Episode, path: Path) -> None:
        features = frames_of(episode, self.fps, self.ticks)
        arrays = {name: feature.values for name, feature in features.items()}
        attributes = {name: {**each.attributes, "names": each.names} for name, each in features.items()}
        count = len(arrays["action"])
        for camera, pictures in episode.pictures.items():
            at = pictures_at(episode, pictures, count, self.fps)
            arrays[f"observation.images.{camera}"] = _decoded(pictures, at)
            arrays[f"timing.picture_t_ns.{camera}"] = np.array(pictures.t_ns, np.int64)[at]
        said = {"labels": {**episode.labels, **episode.facts, "source": episode.source}, "attributes": attributes}
        with open(path, "wb") as file:
            np.savez(file, **arrays, **{_SAID: np.array(json.dumps(said))})  # type: ignore[arg-type]

    def join(self, episodes: Sequence[Path], whole: Path, about: dict[str, Any]) -> None:
        import zarr

        root = zarr.open_group(str(whole), mode="w", zarr_format=2)
        data, ends, labels = root.create_group("data"), [], []
        arrays: dict[str, zarr.Array] = {}
        for path in episodes:
            with np.load(path) as file:
                said = json.loads(str(file[_SAID]))
                names = set(file.files) - {_SAID}
                if arrays and names != set(arrays):
                    other = json.loads(said["labels"]["source"])["file"]
                    raise LogError(f"{other}: its topics or cameras are not those of the first log")
                rows = 0
                for name in sorted(names):
                    values = file[name]
                    if name not in arrays:
                        shape = values.shape[1:]
                        arrays[name] = data.create_array(
                            name, shape=(0, *shape), chunks=(_CHUNK, *shape), dtype=values.dtype
                        )
                        arrays[name].attrs.update(said["attributes"].get(name, {}))
                    elif values.shape[1:] != arrays[name].shape[1:]:
                        raise LogError(f"{path.name}: {name} has another shape than in the first log")
                    arrays[name].append(values)
                    rows = len(values)
                ends.append((ends[-1] if ends else 0) + rows)
                labels.append(said["labels"])
        meta = root.create_group("meta")
        meta.create_array("episode_ends", data=np.array(ends, np.int64))
        meta.attrs.update({"episodes": labels, "fps": self.fps, **about})


def _decoded(pictures: Pictures, at: NDArray[np.intp]) -> NDArray[np.uint8]:
    """Return the pictures at the frames, (n, rows, columns, 3), RGB."""
    chosen, inverse = np.unique(at, return_inverse=True)
    shown = [np.array(Image.open(io.BytesIO(pictures.jpeg[k])).convert("RGB")) for k in chosen]
    return np.stack(shown)[inverse]
