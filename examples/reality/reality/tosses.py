"""Real tosses of an acrylic cube onto a table, and the same tosses by the plant's contact solver, MuJoCo.

The recordings are PyTorch's: a reader of that format's first version, numbers only, is below.
"""

import pickle
from collections.abc import Sequence
from functools import cache
from pathlib import Path
from typing import Any, BinaryIO

import mujoco
import numpy as np
from scipy.optimize import minimize

from hal.base.arrays import Array
from reality.comparison import Finding
from sim_robot.model import POINTS_PER_FACE, series

HALF_WIDTH_M = 0.0524  # README of the set: lengths are in half widths
PERIOD_S = 1.0 / 148.0  # experiment.json of the set, as is the mass
MASS_KG = 0.37
SUBSTEPS = 8
EVERY = 5  # each fifth toss is for the fit
# friction, stiffness N/m and damping ratio of a face on the table: the scene's for its rice box; the fit begins there
PLANT = (0.4, series(1e5, 5e5), 0.6)
IMPEDANCE = 0.1  # of the scene, as its ratio of friction's to normal impedance below
SCENE = f"""
<mujoco><option timestep="{PERIOD_S / SUBSTEPS}" cone="elliptic" impratio="1000"/><worldbody>
<geom name="table" type="plane" size="5 5 1"/>
<body><freejoint/><geom name="cube" type="box" size="{HALF_WIDTH_M} {HALF_WIDTH_M} {HALF_WIDTH_M}"
mass="{MASS_KG}"/></body></worldbody></mujoco>"""


def compare(folder: Path) -> Finding:
    """Fit the contact on a fifth of the tosses, judge on the others: mean error of the pose over a toss."""
    tosses = [states(path) for path in sorted(folder.glob("**/tosses_processed/*.pt"), key=lambda path: int(path.stem))]
    fit = tosses[::EVERY]
    judge = [toss for k, toss in enumerate(tosses) if k % EVERY]
    found = minimize(
        lambda x: float(np.mean(errors(np.exp(x), fit)[:, 0])), np.log(PLANT), method="Nelder-Mead",
        options={"maxfev": 60, "xatol": 0.02, "fatol": 1e-5},
    )  # fmt: skip
    contact = np.exp(found.x)
    lines = {
        "the plant's contact, nothing fitted": errors(PLANT, judge),
        "contact fitted": errors(contact, judge),
        "it stays as it was released": _resting(judge),
    }
    return Finding(
        len(tosses), len(judge), "mm, degrees", ["mean position", "median position", "mean angle", "median angle"],
        {name: [1e3 * float(e[:, 0].mean()), 1e3 * float(np.median(e[:, 0])), float(e[:, 1].mean()),
                float(np.median(e[:, 1]))] for name, e in lines.items()},
        "contact fitted", "the plant's contact, nothing fitted",
        f"friction {contact[0]:.3f}, stiffness {contact[1]:.3g} N/m, damping ratio {contact[2]:.2f}",
    )  # fmt: skip


def errors(contact: Sequence[float] | Array, tosses: Sequence[Array]) -> Array:
    """Return (n, 2): the mean over each toss of the error of the position, m, and of the angle, degrees."""
    return np.array([_distance(tossed(contact, toss), toss) for toss in tosses])


def tossed(contact: Sequence[float] | Array, toss: Array) -> Array:
    """Return the poses (n, 7) of a cube that begins as the toss (n, 13) does, on a contact as PLANT has it."""
    friction, stiffness, ratio = contact
    model = _scene()
    damping = 2.0 * ratio * np.sqrt(stiffness * MASS_KG)
    share = (1.0 - IMPEDANCE) * model.body_invweight0[1, 0] / POINTS_PER_FACE  # see sim_robot.model
    model.geom_friction[:, 0] = friction
    model.geom_solref[:] = (-stiffness * share, -damping * share)
    model.geom_solimp[:] = (IMPEDANCE, IMPEDANCE, 1e-3, 0.5, 2.0)
    data = mujoco.MjData(model)
    data.qpos[:], data.qvel[:] = toss[0, :7], toss[0, 7:13]
    poses = np.empty((len(toss), 7))
    for pose in poses:
        pose[:] = data.qpos
        mujoco.mj_step(model, data, nstep=SUBSTEPS)
    return poses


@cache
def _scene() -> Any:
    return mujoco.MjModel.from_xml_string(SCENE)


def _resting(tosses: Sequence[Array]) -> Array:
    return np.array([_distance(np.repeat(toss[:1, :7], len(toss), axis=0), toss) for toss in tosses])


def _distance(poses: Array, toss: Array) -> tuple[float, float]:
    position = np.linalg.norm(poses[:, :3] - toss[:, :3], axis=1)
    cosine = np.abs(np.sum(poses[:, 3:7] * toss[:, 3:7], axis=1))
    return float(position.mean()), float(np.degrees(2.0 * np.arccos(np.minimum(cosine, 1.0))).mean())


def states(path: Path) -> Array:
    """Return a toss (n, 13): position m, quaternion wxyz, velocity m/s, angular velocity rad/s in the body's frame."""
    with path.open("rb") as file:
        rows = _tensor(file).reshape(-1, 19)[:, :13].copy()  # what follows is zero
    rows[:, :3] *= HALF_WIDTH_M
    rows[:, 7:10] *= HALF_WIDTH_M
    rows[:, 3:7] /= np.linalg.norm(rows[:, 3:7], axis=1, keepdims=True)
    return rows


class _Tensor(pickle.Unpickler):
    """Reads one tensor; whatever else a pickle names is refused."""

    def find_class(self, module: str, name: str) -> Any:
        allowed = {
            ("torch._utils", "_rebuild_tensor_v2"): lambda _, offset, size, stride, *__: (offset, size, stride),
            ("torch", "DoubleStorage"): "<f8",
            ("torch", "FloatStorage"): "<f4",
            ("collections", "OrderedDict"): dict,
        }
        if (module, name) not in allowed:
            raise pickle.UnpicklingError(f"{module}.{name} is not expected in a toss")
        return allowed[module, name]

    def persistent_load(self, pid: Any) -> Any:
        self.kind = pid[1]
        return None


def _tensor(file: BinaryIO) -> Array:
    """Return the tensor of a file in PyTorch's format before 1.6: four pickles, the storages' keys, their bytes."""
    for _ in range(3):  # magic number, version of the protocol, sizes of the machine's types
        _Tensor(file).load()
    reader = _Tensor(file)
    offset, size, stride = reader.load()
    _Tensor(file).load()
    count = int.from_bytes(file.read(8), "little")
    values = np.frombuffer(file.read(), reader.kind, count).astype(np.float64)
    return np.lib.stride_tricks.as_strided(values[offset:], size, tuple(8 * step for step in stride))
