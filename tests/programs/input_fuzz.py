"""Calls the public functions that take arrays with wrong ones: does each end, and in one line where it refuses?

`python -m tests.programs.input_fuzz --calls 1000000 [--seed 0]`: a call is made from --seed and its number alone.
The calls are made in child processes, so that one that ends the interpreter is named by its number; `--first N
--calls 1` makes it again. Right are a result, and a ValueError, TypeError or SceneError of one line.

Takes 40 minutes a million calls on an idle core.
"""

import json
import os
import pickle
import random
import signal
import struct
import time
import traceback
import warnings
from collections import Counter
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from mmap import mmap
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import mujoco
import numpy as np

from rtstack.control.detector import ImpactDetector
from rtstack.control.observer import MomentumObserver
from rtstack.control.parameters import DetectorParameters
from rtstack.impact_map import (
    SceneError,
    converged,
    pressed,
    problem_from_arrays,
    problem_from_mujoco,
    problem_from_urdf,
    single_step,
)
from rtstack.monitor.monitor import Monitor
from rtstack.monitor.parameters import MonitorParameters
from rtstack.monitor.tuning import GoodMotion, tune_monitor
from tests.programs import FAILED, program
from tests.support.impact_map.models import MODELS, mjcf, urdf

BATCH = 2000
HANGS_S = 60
REFUSALS = (ValueError, TypeError, SceneError)
KINDS = ("f2", "f4", "f8", "g", ">f8", "i1", "i4", "i8", "u8", "?", "c16", "O", "U3", "M8[ns]", [("a", "f8")])
NUMBERS = (0.0, -1.0, 1e-300, 1e300, -1e300, np.nan, np.inf, -np.inf, 2**62, -(2**63), 10**400, 2**64, 1j, True)
OBJECTS = (None, "text", "", b"12", [], [[]], [[1.0], [1.0, 2.0]], {}, {1}, object(), len, (None, None), np.ma.masked)
Rng = random.Random


def odd_array(rng: Rng, good: np.ndarray) -> Any:
    """Return an array that is like a good one but for its values, shape, kind or layout."""
    made = np.array(good)
    for _ in range(rng.randint(1, 2)):
        what = rng.randrange(12)
        if what == 0:
            made = np.zeros([rng.choice((0, 1, 2, 3, 7, 10, 300)) for _ in range(rng.randrange(4))]) + 1.0
        elif what == 1:
            with np.errstate(all="ignore"), warnings.catch_warnings():
                warnings.simplefilter("ignore")
                kind = np.dtype(rng.choice(KINDS))
                with suppress(OverflowError, RuntimeError):  # numpy cannot make every kind of every other one
                    made = made.astype(kind) if kind.names is None else np.zeros(made.shape, kind)
        elif what == 2:
            made = np.asfortranarray(made) if rng.random() < 0.5 else made.T
        elif what == 3 and made.ndim:
            made = made[::-1] if rng.random() < 0.5 else np.repeat(made, 2, axis=0)[::2]
        elif what == 4:
            made = made.copy()
            made.setflags(write=False)
        elif what == 5 and made.dtype.kind == "f" and made.size:
            made = np.array(made)
            made.flat[rng.randrange(made.size)] = float(rng.choice(NUMBERS[:8]))
        elif what == 6 and made.dtype.kind in "fi":
            with np.errstate(all="ignore"):
                made = made * rng.choice((0.0, -1.0, 1e-200, 1e200, 1e-3, 3.0))
        elif what == 7 and made.ndim:
            made = made[: rng.randrange(made.shape[0] + 1)] if rng.random() < 0.5 else np.concatenate([made, made])
        elif what == 8:
            made = made[None] if rng.random() < 0.5 else made[..., None]
        elif what == 9 and made.dtype.kind in "fi":
            room = np.zeros(made.nbytes + 1, np.uint8)
            made = np.frombuffer(room[1:].data, made.dtype).reshape(made.shape)
        elif what == 10:
            return np.broadcast_to(np.float64(1.0), (10**12,) + made.shape[1:])
        elif what == 11:
            return rng.choice((np.ndarray.tolist, np.ma.masked_array, memoryview))(made)
    return made


def odd(rng: Rng, good: Any) -> Any:
    """Return something in the place of a good argument."""
    draw = rng.random()
    if draw < 0.6 and isinstance(good, np.ndarray):
        return odd_array(rng, good)
    return rng.choice(NUMBERS) if draw < 0.8 else rng.choice(OBJECTS)


def mixed(rng: Rng, **good: Any) -> dict[str, Any]:
    """Return arguments of which none, one or some are odd."""
    for name in rng.sample(sorted(good), min(len(good), rng.choice((0, 1, 1, 1, 2, 3)))):
        good[name] = odd(rng, good[name])
    return good


def _impact(rng: Rng, numbers: np.random.Generator) -> None:
    nv, n = rng.randint(1, 6), rng.randint(1, 3)
    root = numbers.normal(size=(nv, nv))
    given = {"M": root @ root.T + np.eye(nv), "J": numbers.normal(size=(3 * n, nv))}
    given |= {"velocity": numbers.normal(size=nv), "friction": np.full(n, 0.4)}
    if rng.random() < 0.5:
        given |= {"frames": np.tile(np.eye(3), (n, 1, 1)), "support_velocity": np.zeros((n, 3))}
    if rng.random() < 0.5:
        given |= {"patches": np.zeros(n, np.int64), "maintained": np.ones(n, bool)}
    problem = problem_from_arrays(**mixed(rng, **given))
    if rng.random() < 0.3:
        rng.choice((single_step, converged))(problem, second_opinion=rng.random() < 0.2)
    elif rng.random() < 0.3:
        pressed(problem, odd(rng, np.zeros(len(problem.contacts))), False)


LINKS, Q = MODELS["planar 2R"]
FLOOR = '<geom name="floor" type="plane" size="9 9 1" pos="0 0 1.8"/>'
MODEL = mujoco.MjModel.from_xml_string(mjcf(LINKS, FLOOR))
DATA = mujoco.MjData(MODEL)
DATA.qpos[:], DATA.qvel[:] = Q, (0.5, 1.0)
mujoco.mj_forward(MODEL, DATA)
FOLDER: list[Path] = []  # of this run


def _mujoco(rng: Rng, _: np.random.Generator) -> None:
    problem = problem_from_mujoco(**mixed(rng, model=MODEL, data=DATA, pairs=[("tip", "floor")], maintained=False))
    single_step(problem, False)


def _urdf(rng: Rng, numbers: np.random.Generator) -> None:
    if not (FOLDER[0] / "robot.urdf").exists():
        (FOLDER[0] / "robot.urdf").write_text(urdf(LINKS))
    given = {"q": np.array(Q), "dq": numbers.normal(size=2), "links": ["tip", "tip"], "points": np.zeros((2, 3))}
    given |= {"normals": np.tile([1.0, 0.0, 0.0], (2, 1)), "friction": np.full(2, 0.4), "armature": np.ones(2)}
    single_step(problem_from_urdf(FOLDER[0] / "robot.urdf", **mixed(rng, **given)), False)


def _tuning(joints: int) -> MonitorParameters:
    return MonitorParameters((300.0,) * joints, 13, 15, 19.0, 0.07, 0.1, 0.1, 0.1, 0.1)


def _signals(rng: Rng, numbers: np.random.Generator, *shape: int) -> dict[str, Any]:
    return {name: numbers.normal(size=shape) for name in ("residual", "q", "dq", "dq_ref")}


def _monitor(rng: Rng, numbers: np.random.Generator) -> None:
    joints = rng.choice((1, 2, 7))
    parameters = _tuning(joints)
    if rng.random() < 0.1:
        parameters = replace(parameters, **{rng.choice(MonitorParameters.__slots__): odd(rng, 1.0)})
        if parameters.joints > 7:
            return
    monitor = Monitor(odd(rng, parameters) if rng.random() < 0.05 else parameters)
    if rng.random() < 0.8:
        monitor.expect(**mixed(rng, t_d_ns=100_000_000, q_d=np.zeros(joints)))
    ticks = rng.choice((0, 1, 300))
    for _ in range(rng.randint(1, 2)):
        if rng.random() < 0.3:
            monitor.update(**mixed(rng, t_ns=rng.randrange(10**9), **_signals(rng, numbers, joints)))
        else:
            way = rng.choice((monitor.follow, monitor.assess))
            way(**mixed(rng, t_ns=np.arange(ticks) * 1_000_000, **_signals(rng, numbers, ticks, joints)))


def _tune(rng: Rng, numbers: np.random.Generator) -> None:
    joints, motions = rng.choice((1, 2)), []
    for k in range(rng.randint(1, 2)):
        signals = _signals(rng, numbers, 500, joints)
        signals["residual"] = 0.01 * signals["residual"] + 5.0 * (np.arange(500) > 250)[:, None]
        given = {"t_ns": np.arange(500) * 1_000_000, "t_d_ns": 250_000_000, "q_d": np.zeros(joints), **signals}
        motions.append(GoodMotion(f"run {k}", **mixed(rng, **given)))
    if rng.random() < 0.2:
        tune_monitor(**mixed(rng, motions=motions, sensitivity=1.5))


def _detector(rng: Rng, numbers: np.random.Generator) -> None:
    parameters = DetectorParameters(window_s=0.005)
    if rng.random() < 0.1:
        parameters = replace(parameters, **{rng.choice(("force_low_n", "window_s", "tare_n")): odd(rng, 1.0)})
    detector = ImpactDetector(
        *(mixed(rng, a=parameters, b=1e-3) if rng.random() < 0.1 else {0: parameters, 1: 1e-3}).values()
    )
    for _ in range(rng.randint(1, 12)):
        detector.update(**mixed(rng, force=numbers.normal(size=3), velocity=numbers.normal(size=3)))


def _observer(rng: Rng, numbers: np.random.Generator) -> None:
    n = rng.choice((1, 2, 7))
    observer = MomentumObserver(
        **(mixed(rng, joints=n, gain_hz=200.0, period_s=1e-3) if rng.random() < 0.1 else {"joints": n})
    )
    n = observer.joints
    given = {"M": np.eye(min(n, 9)), "C": np.zeros((min(n, 9),) * 2)}
    given |= {name: numbers.normal(size=min(n, 9)) for name in ("gravity", "tau_J", "dq")}
    for _ in range(rng.randint(1, 3)):
        observer.update(**mixed(rng, **given))


TARGETS: dict[str, Callable[[Rng, np.random.Generator], None]] = {
    "impact map from arrays": _impact, "impact map from MuJoCo": _mujoco, "impact map from a URDF": _urdf,
    "monitor": _monitor, "tuning": _tune, "impact detector": _detector, "momentum observer": _observer,
}  # fmt: skip


def called(seed: int, number: int) -> tuple[str, str]:
    """Make a call; return whom it was for and what came of it: taken, refused, or "wrong: ..."."""
    rng = random.Random(f"{seed} {number}")
    name = rng.choice(sorted(TARGETS))
    try:
        TARGETS[name](rng, np.random.default_rng(rng.randrange(2**32)))
    except REFUSALS as error:
        text = str(error)
        return name, "refused" if text and "\n" not in text else f"wrong: {type(error).__name__}: {text!r}"
    except BaseException as error:
        if isinstance(error, KeyboardInterrupt):
            raise
        place = traceback.extract_tb(error.__traceback__)[-1]
        return name, f"wrong: {type(error).__name__}: {error} ({place.filename}:{place.lineno})"
    return name, "taken"


def batch(seed: int, first: int, count: int, at: mmap) -> Counter[str]:
    """Make calls in a child process. A child that dies is one wrong call, and the next child goes on behind it."""
    found: Counter[str] = Counter()
    while count > 0:
        reading, writing = os.pipe()
        child = os.fork()
        if child == 0:
            os.close(reading)
            warnings.simplefilter("error")
            os.dup2(os.open(os.devnull, os.O_WRONLY), 2)  # urdfdom writes what is wrong with a URDF
            mine: Counter[str] = Counter()
            for number in range(first, first + count):
                at[:8] = struct.pack("q", number)
                signal.alarm(HANGS_S)
                name, said = called(seed, number)
                mine[f"{name}: {said.split(':')[0]}"] += 1
                if said.startswith("wrong"):
                    mine[f"call {number}, {name}: {said}"] += 1
            with os.fdopen(writing, "wb") as pipe:
                pickle.dump(mine, pipe)
            os._exit(0)
        os.close(writing)
        with os.fdopen(reading, "rb") as pipe:
            sent = pipe.read()
        _, status = os.waitpid(child, 0)
        if status == 0 and sent:
            return found + pickle.loads(sent)
        number = struct.unpack("q", at[:8])[0]
        died = signal.Signals(status & 127).name if status & 127 else f"status {status >> 8}"
        found["died: wrong"] += 1
        found[
            f"call {number}: wrong: the interpreter ended by {died}; those before it in its batch are not counted"
        ] += 1
        count -= number + 1 - first
        first = number + 1
    return found


def main(calls: int = 1_000_000, seed: int = 0, first: int = 0, minutes: float = 0.0) -> int:
    """Print a table. minutes: after which no further batch begins. Returns 1 where a call was wrong."""
    found, began, made = Counter[str](), time.monotonic(), 0
    at = mmap(-1, 8)
    with TemporaryDirectory() as folder:
        FOLDER[:] = [Path(folder)]
        for number in range(300 if calls > 1 else 0):  # what is compiled now is there in each child
            called(-1, number)
        while made < calls and (not minutes or time.monotonic() - began < 60.0 * minutes):
            count = min(BATCH, calls - made)
            found += batch(seed, first + made, count, at)
            made += count
            if made % (25 * BATCH) == 0:
                wrong = sum(times for name, times in found.items() if name.endswith(": wrong"))
                print(f"{made} calls, {time.monotonic() - began:.0f} s, wrong: {wrong}", flush=True)
    for name in TARGETS:
        print(
            f"{name:24} " + " ".join(f"{kind} {found[f'{name}: {kind}']:8}" for kind in ("taken", "refused", "wrong"))
        )
    bad = [name for name in found if name.startswith("call ")]
    for line in bad[:30]:
        print(json.dumps(line)[:400])
    print(f"{made} calls, seed {seed}, {time.monotonic() - began:.0f} s, wrong: {len(bad)}")
    return FAILED if bad else 0


if __name__ == "__main__":
    program(main)
