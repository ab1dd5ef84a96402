"""Behaviour cloning in NumPy: a network of two hidden layers, trained by Adam (Kingma and Ba 2015) on demonstrations.

What it sees: the time since it began to lead, where the object stood then, where the pads are now, and how high the
object is. What it says: where the pads are to be in each of the next POSES steps. Places are in the object's frame at
the beginning, so that a displaced object looks as one in its place.
"""

from itertools import pairwise
from pathlib import Path
from typing import Any, Self

import numpy as np

from hal.base.arrays import Array
from learned_grab.scripted import POSES, STEP_S
from rtstack.teleoperation.policy import Chunk, Observation

_BASES = 24  # of the time, Gaussian, over _LONGEST_S
_LONGEST_S = 5.6
_HIDDEN = 128
_EPOCHS, _BATCH, _RATE = 120, 256, 2e-3
_DECAY = 1e-4  # of the weights, a step
_NOISE_M = 2e-3  # on the pads' places in training: what a policy sees is never quite what was demonstrated
_AFTER_S = 0.3

Layers = list[tuple[Array, Array]]


def place_of(object_pose: Array) -> Array:
    """Return x, y and yaw of an object's pose (7,), m and rad."""
    w, x, y, z = object_pose[3:]
    return np.array([object_pose[0], object_pose[1], np.arctan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))])


def into(place: Array, poses: Array) -> Array:
    """Return poses (..., 7) in the frame of a place, as x, y, z, and the turn about z that is left of them (..., 4)."""
    c, s = np.cos(place[2]), np.sin(place[2])
    shifted = poses[..., :2] - place[:2]
    x, y = c * shifted[..., 0] + s * shifted[..., 1], c * shifted[..., 1] - s * shifted[..., 0]
    return np.stack([x, y, poses[..., 2], yaw_of(poses) - place[2]], axis=-1)


def yaw_of(poses: Array) -> Array:
    """Return the turn about z of poses (..., 2, 7) of (left, right) pads, 0 where they look along y."""
    w, x, y, z = np.moveaxis(poses[..., 3:], -1, 0)
    # the pad's axis z, in the world: along -y for the left one, along y for the right one
    ahead = np.stack([2.0 * (x * z + w * y), 2.0 * (y * z - w * x)], axis=-1) * np.array([[-1.0], [1.0]])
    return np.arctan2(-ahead[..., 0], ahead[..., 1])


def features(t_s: float, place: Array, pads: Array, object_z: float) -> Array:
    """Return what the network sees, (n,). place (3,): of the object at the beginning; pads (2, 7): now."""
    centres = np.linspace(0.0, _LONGEST_S, _BASES)
    time = np.exp(-0.5 * ((t_s - centres) / (_LONGEST_S / _BASES)) ** 2)
    return np.concatenate([time, 10.0 * place, 5.0 * into(place, pads).ravel(), [10.0 * object_z]])


class Network:
    """Layers (weights, offsets), and the scale of the answer: mean (n,) and deviation (n,)."""

    def __init__(self, layers: Layers, mean: Array, deviation: Array) -> None:
        self.layers, self.mean, self.deviation = layers, mean, deviation

    @classmethod
    def load(cls, path: Path) -> Self:
        """Read a file that `save` wrote. Raises OSError, ValueError, KeyError."""
        with np.load(path) as file:
            count = sum(name.startswith("weights") for name in file.files)
            return cls(
                [(file[f"weights{k}"], file[f"offsets{k}"]) for k in range(count)], file["mean"], file["deviation"]
            )

    def save(self, path: Path) -> None:
        """Write a file."""
        named: dict[str, Any] = {"mean": self.mean, "deviation": self.deviation}
        for k, (weights, offsets) in enumerate(self.layers):
            named |= {f"weights{k}": weights, f"offsets{k}": offsets}
        np.savez(path, **named)

    def say(self, seen: Array) -> Array:
        """Return the answer to what is seen, both (..., n)."""
        for k, (weights, offsets) in enumerate(self.layers):
            seen = seen @ weights + offsets
            if k < len(self.layers) - 1:
                seen = np.tanh(seen)
        return self.mean + self.deviation * seen


def train(seen: Array, said: Array, pads: slice, seed: int) -> tuple[Network, float]:
    """Return a network that says `said` (n, m) where it sees `seen` (n, k), and the root mean square of what is left.

    pads: the columns of `seen` that noise is added to.
    """
    rng = np.random.default_rng(seed)
    mean, deviation = said.mean(axis=0), said.std(axis=0) + 1e-6
    wanted = (said - mean) / deviation
    sizes = [seen.shape[1], _HIDDEN, _HIDDEN, said.shape[1]]
    layers: Layers = [(rng.standard_normal((a, b)) / np.sqrt(a), np.zeros(b)) for a, b in pairwise(sizes)]
    values = [value for layer in layers for value in layer]
    first, second = [np.zeros_like(v) for v in values], [np.zeros_like(v) for v in values]
    step, steps = 0, _EPOCHS * -(-len(seen) // _BATCH)
    for _ in range(_EPOCHS):
        order = rng.permutation(len(seen))
        for begin in range(0, len(order), _BATCH):
            chosen = order[begin : begin + _BATCH]
            batch = seen[chosen].copy()
            batch[:, pads] += 5.0 * _NOISE_M * rng.standard_normal(batch[:, pads].shape)
            step += 1
            rate = _RATE * 0.5 * (1.0 + np.cos(np.pi * step / steps))
            for i, slope in enumerate(_slopes(layers, batch, wanted[chosen])):
                first[i] = 0.9 * first[i] + 0.1 * slope
                second[i] = 0.999 * second[i] + 0.001 * slope**2
                ahead = first[i] / (1.0 - 0.9**step) / (np.sqrt(second[i] / (1.0 - 0.999**step)) + 1e-8)
                values[i] -= rate * (ahead + _DECAY * values[i])
    network = Network(layers, mean, deviation)
    return network, float(np.sqrt(np.mean((network.say(seen) - said) ** 2)))


def _slopes(layers: Layers, batch: Array, wanted: Array) -> list[Array]:
    """Return the gradient of the mean square error by each layer's weights and offsets."""
    passed = [batch]
    for k, (weights, offsets) in enumerate(layers):
        out = passed[-1] @ weights + offsets
        passed.append(np.tanh(out) if k < len(layers) - 1 else out)
    back = 2.0 * (passed[-1] - wanted) / wanted.size
    slopes: list[Array] = []
    for k in reversed(range(len(layers))):
        slopes[:0] = [passed[k].T @ back, back.sum(axis=0)]
        back = (back @ layers[k][0].T) * (1.0 - passed[k] ** 2)
    return slopes


class LearnedGrab:
    """The policy. rotation: of the pads, (2, 4) wxyz, where they look at each other along y: as it first sees them."""

    def __init__(self, network: Network) -> None:
        self._network = network
        self._place: Array | None = None
        self._turned = np.zeros((2, 4))

    def act(self, observation: Observation) -> Chunk | None:
        """See Policy. No answer where the object was never seen."""
        if observation.object_pose is None:
            return None
        if self._place is None or observation.t_s == 0.0:
            self._place, self._turned = place_of(observation.object_pose), observation.pose[:, 3:].copy()
        if observation.t_s > _LONGEST_S + _AFTER_S:
            return Chunk(finished=True)
        seen = features(observation.t_s, self._place, observation.pose, float(observation.object_pose[2]))
        said = self._network.say(seen).reshape(POSES, 2, 4)
        c, s = np.cos(self._place[2]), np.sin(self._place[2])
        poses = np.zeros((POSES, 2, 7))
        poses[..., 0] = self._place[0] + c * said[..., 0] - s * said[..., 1]
        poses[..., 1] = self._place[1] + s * said[..., 0] + c * said[..., 1]
        poses[..., 2] = said[..., 2]
        half = 0.5 * (said[..., 3] + self._place[2])
        cosine, sine = np.cos(half), np.sin(half)
        w, x, y, z = self._turned.T  # about the world's z, after how the pads look at first
        poses[..., 3:] = np.stack(
            [cosine * w - sine * z, cosine * x - sine * y, cosine * y + sine * x, cosine * z + sine * w], axis=-1
        )
        return Chunk(STEP_S, poses)

    def close(self) -> None:
        """See Policy."""


def learned_grab(argument: str) -> LearnedGrab:
    """Offer a trained network as a policy. argument: the file policy.npz of the campaign learned-grab."""
    from rtstack.trials.errors import TrialError

    try:
        return LearnedGrab(Network.load(Path(argument)))
    except (OSError, ValueError, KeyError) as error:
        raise TrialError(f"learned_grab:FILE, policy.npz of rtstack campaign learned-grab: {error}") from None
