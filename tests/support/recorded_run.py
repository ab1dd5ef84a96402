"""Short recorded runs that every change of the law is replayed on: the states as float32, which the wire carries, and
what controller and judge made of them.

The output is kept as a checksum of each field in blocks of ten ticks, with the field's first value in each block.
"""

import zlib
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from hal.cell import Cell
from hal.tracker import OBJECT_POSE
from rtstack.loop.history import Columns
from rtstack.model.cell_description import CellDescription
from rtstack.playback.logged_cell import LoggedStop, logged_cell
from rtstack.playback.replay import OURS
from rtstack.samples import ARM_SAMPLE, CONTROL_SAMPLE, SIDES, TIMING_SAMPLE
from rtstack.trials.demonstration import run_demonstration
from rtstack.trials.record import RunSamples
from rtstack.trials.run_context import RunContext
from rtstack.trials.specification import DemonstrationSpecification, TrialSpecification
from rtstack.trials.trial import prepare_trial, run_trial

FOLDER = Path(__file__).resolve().parents[1] / "playback/recorded"
STATES = ("q", "dq", "tau_J", "tau_J_d", "tau_ext_hat_filtered", "O_F_ext_hat_K")
RENEW = "python -m tests.programs.record_runs"
BLOCK = 10

Start = Callable[[Cell, RunContext], object]


@dataclass(frozen=True, slots=True)
class Kind:
    """A run: its name, how many ticks of it are kept, after how many it is stopped, and what starts it."""

    name: str
    ticks: int
    stop: int | None
    start: Callable[[Path, CellDescription], Start]


def _trial(controller: str, **options) -> Callable[[Path, CellDescription], Start]:
    def made(reference: Path, description: CellDescription) -> Start:
        specification = TrialSpecification(str(reference), controller, seed=4, **options)
        prepared = prepare_trial(specification, description)
        return lambda cell, context: run_trial(prepared, cell, context)

    return made


def _demonstration(reference: Path, description: CellDescription) -> Start:
    return lambda cell, context: run_demonstration(DemonstrationSpecification(seed=4), description, cell, context)


KINDS = (
    Kind("demonstration", 300, None, _demonstration),
    Kind("through_the_impact", 1500, None, _trial("proposed", displacement_mm=-30.0)),
    Kind("stopped_by_the_operator", 450, 250, _trial("no_velocity_feedback")),
    Kind("stopped_by_the_judge", 500, None, _trial("contact_completion", safety=(("ee_speed_max", 0.01),))),
)


def saved(columns: Columns, ticks: int) -> dict[str, NDArray]:
    """Return the arrays of a recorded run's file."""
    arm, control = columns.arm[:, :ticks], columns.control[:, :ticks]
    states = {name: arm[name].astype(np.float32) for name in STATES}
    assert all(np.array_equal(states[name], arm[name]) for name in STATES), "states are float32 on the wire"
    own = {
        f"out_{name}_{what}": values for name, both in outputs(arm, control).items() for what, values in both.items()
    }
    return {**states, **own, "robot_mode": arm["robot_mode"].astype(np.int8), "mode": control["mode"].astype(np.int8)}


def outputs(arm: NDArray, control: NDArray) -> dict[str, dict[str, NDArray]]:
    """Return checksum and first value of each block (2, blocks) of what the controller and the judge have written."""
    found = {}
    fields = [(name, arm[name]) for name in OURS]
    fields += [(name, control[name]) for name in CONTROL_SAMPLE.names or () if name != "t_ns"]
    for name, values in fields:
        blocks = [np.ascontiguousarray(values[:, k : k + BLOCK]) for k in range(0, values.shape[1], BLOCK)]
        crc = np.array([[zlib.crc32(block[side].tobytes()) for block in blocks] for side in (0, 1)], np.uint32)
        first = np.array([[float(block[side].reshape(-1)[0]) for block in blocks] for side in (0, 1)])
        found[name] = {"crc": crc, "first": first}
    return found


def replayed(kind: Kind, file: Path, reference: Path, description: CellDescription) -> str | None:
    """Replay a recorded run; return None for the same bits, or in one line the first that differ."""
    with np.load(file) as kept:
        ticks = kept["q"].shape[1]
        arm, control = np.zeros((2, ticks), ARM_SAMPLE), np.zeros((2, ticks), CONTROL_SAMPLE)
        for name in (*STATES, "robot_mode"):
            arm[name] = kept[name]
        arm["O_T_EE"] = np.eye(4)
        arm["t_ns"] = np.arange(ticks) * 1_000_000
        control["mode"] = kept["mode"]
        columns = Columns(arm, control, np.zeros(ticks, TIMING_SAMPLE), np.zeros(0, OBJECT_POSE))
        cell, left = logged_cell("direct", columns)
        samples = RunSamples(file)
        stop = LoggedStop(columns, left) if kind.stop is not None else None
        kind.start(reference, description)(cell, RunContext(samples, stop=stop))
        assert samples.columns is not None
        now = outputs(samples.columns.arm[:, :ticks], samples.columns.control[:, :ticks])
        worst: tuple[int, str] | None = None
        for name, values in now.items():
            for side, label in enumerate(SIDES):
                was, its = kept[f"out_{name}_crc"][side], values["crc"][side]
                n = min(len(was), len(its))
                others = np.flatnonzero(was[:n] != its[:n])
                if len(others) and (worst is None or others[0] < worst[0]):
                    k = int(others[0])
                    then, today = kept[f"out_{name}_first"][side, k], values["first"][side, k]
                    where = f"{label} {name} in ticks {BLOCK * k} to {BLOCK * (k + 1) - 1}"
                    worst = k, f"{where}: {then!r} recorded, {today!r} now"
        if worst is None and samples.columns.arm.shape[1] < ticks:
            worst = 0, f"it ends after {samples.columns.arm.shape[1]} of {ticks} ticks"
        return None if worst is None else worst[1]
