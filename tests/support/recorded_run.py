"""Short recorded runs that every change of the law is replayed on: the states as float32, which the wire carries, and
what controller and judge made of them.

The output is kept as a checksum of each field in each tick, with the field's first values as float32: all of a torque,
the first one of any other field.
"""

import os
import zlib
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from hal.cell import Cell
from hal.tracker import OBJECT_POSE
from rtstack.control.records import POINT
from rtstack.loop.history import Columns
from rtstack.loop.mailbox import Mailbox
from rtstack.model.cell_description import CellDescription
from rtstack.playback.logged_cell import LoggedStop, logged_cell
from rtstack.playback.replay import OURS
from rtstack.references.spreading import ExtendedReference
from rtstack.samples import ARM_SAMPLE, CONTROL_SAMPLE, SIDES, TIMING_SAMPLE, Reaction
from rtstack.trials.demonstration import run_demonstration
from rtstack.trials.record import RunSamples
from rtstack.trials.run_context import RunContext
from rtstack.trials.specification import DemonstrationSpecification, TeleoperationSpecification, TrialSpecification
from rtstack.trials.teleoperation import run_teleoperation
from rtstack.trials.trial import prepare_trial, run_trial
from tests.support.hand import JOB, Hand

FOLDER = Path(__file__).resolve().parents[1] / "playback/recorded"
STATES = ("q", "dq", "tau_J", "tau_J_d", "tau_ext_hat_filtered", "O_F_ext_hat_K")
REFERENCE = FOLDER / "reference.npz"
PARTS = ("ante", "post")
RENEW = "python -m tests.programs.record_runs"
TORQUES = 7

Start = Callable[[Cell, RunContext], object]


@dataclass(frozen=True, slots=True)
class Kind:
    """A run: its name, how many ticks of it are kept, after how many it is stopped, and what starts it.

    shift_m: of the object along y; faults: a script of the simulated robot, TOML.
    """

    name: str
    ticks: int
    stop: int | None
    start: Callable[[Path, CellDescription], Start]
    shift_m: float = 0.0
    faults: str = ""


def _trial(controller: str, **options) -> Callable[[Path, CellDescription], Start]:
    def made(reference: Path, description: CellDescription) -> Start:
        specification = TrialSpecification(str(reference), controller, seed=4, **options)
        prepared = prepare_trial(specification, description)
        prepared = replace(prepared, reference=as_recorded(prepared.reference))
        return lambda cell, context: run_trial(prepared, cell, context)

    return made


def _demonstration(reference: Path, description: CellDescription) -> Start:
    return lambda cell, context: run_demonstration(DemonstrationSpecification(seed=4), description, cell, context)


def _by_hand(_reference: Path, description: CellDescription) -> Start:
    """An operator leads both pads to and fro, lets the clutch go once, and ends it."""

    def script(ms: int, hand: Hand) -> None:
        if ms < 160 or 220 <= ms < 280:
            hand.hold(((0.0, -0.02, 0.03), (0.02, 0.02, 0.0)) if ms < 160 else ((0.01, 0.0, 0.0), (0.0, 0.0, 0.02)))
        elif ms == 160:
            hand.release()
        elif ms == 280:
            hand.finish()

    def start(cell: Cell, context: RunContext) -> object:
        mailbox = Mailbox.create(f"rtstack-recorded-run-{os.getpid()}")
        try:
            hand = Hand(mailbox, script, description)
            asked = TeleoperationSpecification("anna", seed=4, stop_on_release=False, job=JOB)
            return run_teleoperation(
                asked, description, cell, mailbox, context.with_watchdog(hand), clock=hand.clock
            )  # fmt: skip
        finally:
            mailbox.close()

    return start


REFLEX = """[[fault]]
kind = "reflex"
arm = "left"
at_s = 0.1
duration_s = 0.5
error = "cartesian_reflex"
"""
PUSH = """[[fault]]
kind = "push"
arm = "left"
at_s = 0.5
duration_s = 0.1
force_N = [0.0, 60.0, 0.0]
"""
KINDS = (
    Kind("demonstration", 300, None, _demonstration),
    Kind("through_the_impact", 1500, None, _trial("proposed", displacement_mm=-30.0), -0.03),
    Kind("stopped_by_the_operator", 450, 250, _trial("no_velocity_feedback")),
    Kind("stopped_by_the_judge", 500, None, _trial("contact_completion", safety=(("ee_speed_max", 0.01),))),
    Kind("led_by_hand", 300, None, _by_hand),
    Kind("robot_reflex", 150, None, _trial("no_reference_spreading"), faults=REFLEX),
    Kind("pushed_and_holding", 700, None, _trial("no_interim", reaction=Reaction.HOLD), faults=PUSH),
)


def kept_reference(reference: ExtendedReference, ticks: int) -> dict[str, NDArray]:
    """Return the arrays of the reference's file, as float32: a demonstration that is simulated on another kind of
    processor differs in its eighth digit.
    """
    expected = reference.impact
    assert expected is not None
    arrays = {
        f"{part}_{name}": getattr(reference, part)[name][:, :ticks] for part in PARTS for name in POINT.names or ()
    }
    arrays |= {"dq_post": expected.dq_post[:, :ticks], "net_force": expected.net_force[:ticks]}
    arrays |= {"q_d": expected.q_d, "dq_ante": expected.dq_ante}
    times = [reference.nominal_impact_s, reference.release_s, expected.t_d_s, expected.set_down_s, expected.release_s]
    return {name: values.astype(np.float32) for name, values in arrays.items()} | {"times_s": np.array(times)}


def as_recorded(reference: ExtendedReference) -> ExtendedReference:
    """Return the reference with what the recorded runs have followed of it."""
    assert reference.impact is not None
    ante, post = reference.ante.copy(), reference.post.copy()
    dq_post, net_force = np.array(reference.impact.dq_post), np.array(reference.impact.net_force)
    with np.load(REFERENCE) as kept:
        for points, part in ((ante, "ante"), (post, "post")):
            for name in POINT.names or ():
                values = kept[f"{part}_{name}"]
                points[name][:, : values.shape[1]] = values
        dq_post[:, : kept["dq_post"].shape[1]] = kept["dq_post"]
        net_force[: len(kept["net_force"])] = kept["net_force"]
        nominal_s, release_s, t_d_s, set_down_s, let_go_s = kept["times_s"].tolist()
        impact = replace(
            reference.impact, t_d_s=t_d_s, q_d=kept["q_d"].astype(float), dq_ante=kept["dq_ante"].astype(float),
            dq_post=dq_post, net_force=net_force, set_down_s=set_down_s, release_s=let_go_s,
        )  # fmt: skip
    return replace(reference, ante=ante, post=post, nominal_impact_s=nominal_s, release_s=release_s, impact=impact)


def saved(columns: Columns, ticks: int) -> dict[str, NDArray]:
    """Return the arrays of a recorded run's file."""
    arm, control = columns.arm[:, :ticks], columns.control[:, :ticks]
    states = {name: arm[name].astype(np.float32) for name in STATES}
    assert all(np.array_equal(states[name], arm[name]) for name in STATES), "states are float32 on the wire"
    own: dict[str, NDArray] = {}
    for name, values in outputs(arm, control).items():
        own[f"out_{name}_crc"] = checksums(values)
        own[f"out_{name}_first"] = firsts(name, values).astype(np.float32)
    return {**states, **own, "robot_mode": arm["robot_mode"].astype(np.int8), "mode": control["mode"].astype(np.int8)}


def outputs(arm: NDArray, control: NDArray) -> dict[str, NDArray]:
    """Return what the controller and the judge have written, (2, ticks, ...) each."""
    found = {name: arm[name] for name in OURS}
    return found | {name: control[name] for name in CONTROL_SAMPLE.names or () if name != "t_ns"}


def checksums(values: NDArray) -> NDArray[np.uint16]:
    """Return a checksum of each tick, (2, ticks)."""
    return np.array([[zlib.crc32(np.ascontiguousarray(tick).tobytes()) & 0xFFFF for tick in side] for side in values],
                    np.uint16)  # fmt: skip


def firsts(name: str, values: NDArray) -> NDArray:
    """Return the values that are kept of each tick, (2, ticks, n)."""
    flat = values.reshape(*values.shape[:2], -1)
    return flat[:, :, : TORQUES if name in OURS else 1]


def replayed(kind: Kind, file: Path, reference: Path, description: CellDescription) -> str | None:
    """Replay a recorded run; return None for the same bits, or in one line the first tick, field and value."""
    with np.load(file) as kept:
        ticks = kept["q"].shape[1]
        arm, control = np.zeros((2, ticks), ARM_SAMPLE), np.zeros((2, ticks), CONTROL_SAMPLE)
        for name in (*STATES, "robot_mode"):
            arm[name] = kept[name]
        arm["O_T_EE"] = np.eye(4)
        arm["t_ns"] = np.arange(ticks) * 1_000_000
        control["mode"] = kept["mode"]
        columns = Columns(arm, control, np.zeros(ticks, TIMING_SAMPLE), np.zeros(0, OBJECT_POSE))
        cell = logged_cell("direct", columns)
        samples = RunSamples(file)
        stop = LoggedStop(columns) if kind.stop is not None else None
        kind.start(reference, description)(cell, RunContext(samples, stop=stop))
        assert samples.columns is not None
        now = outputs(samples.columns.arm[:, :ticks], samples.columns.control[:, :ticks])
        worst: tuple[int, str] | None = None
        for name, values in now.items():
            made = checksums(values)
            for side, label in enumerate(SIDES):
                was, its = kept[f"out_{name}_crc"][side], made[side]
                n = min(len(was), len(its))
                others = np.flatnonzero(was[:n] != its[:n])
                if len(others) and (worst is None or others[0] < worst[0]):
                    k = int(others[0])
                    worst = k, f"{label} {_differing(name, kept[f'out_{name}_first'][side, k], values[side, k])}"
        if worst is None and samples.columns.arm.shape[1] < ticks:
            return f"it ends after {samples.columns.arm.shape[1]} of {ticks} ticks"
        return None if worst is None else f"tick {worst[0]}: {worst[1]}"


def _differing(name: str, recorded: NDArray, values: NDArray) -> str:
    """Return the field's first value that differs, as it was recorded, to seven digits, and as it is now."""
    today = values.reshape(-1)
    others = np.flatnonzero(today[: len(recorded)].astype(np.float32) != recorded)
    i = int(others[0]) if len(others) else 0
    label = f"{name}[{i}]" if len(today) > 1 else name
    return f"{label}: {float(recorded[i])!r} recorded, {float(today[i])!r} now" + ("" if len(others) else
           ", the same to seven digits; a later value or digit differs")  # fmt: skip
