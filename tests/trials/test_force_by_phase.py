"""A push in every phase: up to the phase's bound the run goes on, beyond it the judge stops in that very tick."""

import re
import subprocess
import sys
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from hal.cell import Cell
from hal.fci.pair import STALE_IN_LOCKSTEP_S
from hal.limits import CollisionBehaviour
from rtstack.cells import default_cell_file, open_cell
from rtstack.control.watch import FREE_AFTER_S
from rtstack.identification.sweep import sweep
from rtstack.log.reader import Log, read_log
from rtstack.model.cell_description import CellDescription
from rtstack.playback.run import prepare_playback
from rtstack.references.source import load_reference
from rtstack.safety.limits import FORCES_BY_PHASE, ForcePhase
from rtstack.samples import Mode
from rtstack.testing import ServedArms
from rtstack.trials.assembly import arm_controllers, cell_parameters
from rtstack.trials.demonstration import run_demonstration
from rtstack.trials.move import PreparedMove, run_motion
from rtstack.trials.record import open_log
from rtstack.trials.run_context import RunContext
from rtstack.trials.specification import (
    DemonstrationSpecification,
    HandMotion,
    MoveSpecification,
    PlaybackSpecification,
    SweepSpecification,
    TrialSpecification,
)
from rtstack.trials.start_motion import start_motion
from rtstack.trials.tightening import limits_of_arms
from rtstack.trials.trial import prepare_trial, run_trial
from sim_robot.cell import simulated_cell
from sim_robot.faults.file import faults_in
from tests.support.sampling import sampled

APPROACH_N, CONTACT_N = FORCES_BY_PHASE["force_approach_max"], FORCES_BY_PHASE["force_contact_max"]
ROOT = Path(__file__).resolve().parents[2]
PUSH_S = 0.025  # the robot's estimate has a low-pass of 30 Hz: it shows 99 % by then, and the arm has gone 5 mm
# of the bound: more than the estimate needs, and less than a wrist's sensor can take; and what joint torques let pass
HARD, SOFT = 1.15, 0.35


def pushed(object_name: str, at_s: float, force_n: float) -> Cell:
    """A cell whose left pad is pulled on, along y: a push back is an impact, and across it the wrist gives in first."""
    push = {"kind": "push", "arm": "left", "force_N": [0.0, -force_n, 0.0], "at_s": at_s, "duration_s": PUSH_S}
    return simulated_cell(object_name, 0.0, 0, faults=faults_in({"fault": [push]}, "")).as_cell("direct")


Run = Callable[[CellDescription, Path, Cell, RunContext], object]


def a_trial(cell: CellDescription, reference: Path, arms: Cell, context: RunContext) -> object:
    return run_trial(prepare_trial(TrialSpecification(str(reference)), cell), arms, context)


def a_demonstration(cell: CellDescription, _reference: Path, arms: Cell, context: RunContext) -> object:
    return run_demonstration(DemonstrationSpecification(), cell, arms, context)


def a_playback(cell: CellDescription, reference: Path, arms: Cell, context: RunContext) -> object:
    return prepare_playback(PlaybackSpecification(str(reference)), cell).run(arms, context)


def a_sweep(cell: CellDescription, _reference: Path, arms: Cell, context: RunContext) -> object:
    parameters = cell_parameters(cell)
    return run_motion(sweep(cell, arm_controllers(cell, parameters), 6).plan, cell, parameters, arms, context)


def to_the_start(cell: CellDescription, _reference: Path, arms: Cell, context: RunContext) -> object:
    return PreparedMove(MoveSpecification(HandMotion.START), cell).run(arms, context)


def opening(cell: CellDescription, _reference: Path, arms: Cell, context: RunContext) -> object:
    return PreparedMove(MoveSpecification(HandMotion.OPEN), cell).run(arms, context)


# what runs, with which object in the cell, when the push comes (s since the first motion), and what it may reach
PHASES: dict[str, tuple[Run, str, float, float]] = {
    "trial, on its way": (a_trial, "rice_box", 0.6, APPROACH_N),
    "trial, shortly before its impact": (a_trial, "rice_box", 1.2, CONTACT_N),
    "trial, after its release": (a_trial, "rice_box", -0.02, APPROACH_N),
    "demonstration": (a_demonstration, "rice_box", 0.6, CONTACT_N),
    "playback": (a_playback, "", 0.6, APPROACH_N),
    "sweep of a friction identification": (a_sweep, "", 0.6, APPROACH_N),
    "motion to the start": (to_the_start, "", 0.2, APPROACH_N),
    "opening of the pads": (opening, "", 0.2, CONTACT_N),
}
OFTEN = ("trial, on its way", "demonstration", "motion to the start")
KINDS = {a_demonstration: DemonstrationSpecification(), a_trial: TrialSpecification("ref.mcap")}


@pytest.fixture
def run(cell, demonstration, tmp_path) -> Callable[[str, float], tuple[Log, int]]:
    """Run a phase with a push of so many newtons; return the log, and the tick from which on it pushes."""
    parameters = cell_parameters(cell)
    reference = load_reference(demonstration.path, arm_controllers(cell, parameters), parameters.detector)

    def go(phase: str, force_n: float) -> tuple[Log, int]:
        what, object_name, at_s, _ = PHASES[phase]
        at_s = at_s if at_s > 0.0 else reference.release_s + FREE_AFTER_S - at_s
        assert at_s < reference.ticks * reference.period_s - 0.05
        assert what is not a_trial or not 0.0 < reference.nominal_impact_s - at_s < 0.05
        arms = pushed(object_name or "none", at_s, force_n)
        path = tmp_path / f"{force_n:.0f}.mcap"
        specification = SweepSpecification("rice_box", 7, 0)
        log = open_log(path, specification, cell, "direct", default_cell_file(), cell=arms)
        try:
            what(cell, demonstration.path, arms, RunContext(log))
        finally:
            arms.close()
        return read_log(path), round(1e3 * at_s)

    return go


def felt(log: Log) -> tuple[np.ndarray, int]:
    """The size of the left pad's estimated force in each tick, N, and the tick in which the stop begins (-1: never)."""
    arm, control = log.topic("/left/arm"), log.topic("/left/control")
    force = np.linalg.norm(arm["O_F_ext_hat_K"][:, :3], axis=1)
    stopping = np.flatnonzero(control["mode"] == Mode.STOPPING)
    return force, int(stopping[0]) - 1 if len(stopping) else -1  # the mode follows the judge, a tick later


@pytest.mark.parametrize("phase", sampled(PHASES, OFTEN.__contains__))
def test_a_push_beyond_the_bound_stops_in_the_tick_that_shows_it(run, phase, record_property):
    bound = PHASES[phase][3]
    log, push_tick = run(phase, HARD * bound)
    force, tick = felt(log)
    record_property("peak_force_n", float(force[push_tick:].max()))
    print(f"{phase}: bound {bound:g} N, {force[tick]:.1f} N at the stop, {force[push_tick:].max():.1f} N at most")
    assert push_tick <= tick <= push_tick + PUSH_S * 1e3
    assert force[push_tick:tick].max() <= bound
    assert force[push_tick:].max() <= HARD * bound
    said = [event.text for event in log.events if event.name == "safety"]
    assert len(said) == 1
    assert re.match(
        r"safety stop: left: (joint \d: the (momentum residual|estimated external torque) is too large"
        r"|the pad pushes harder than this phase allows \()",
        said[0],
    ), said


@pytest.mark.parametrize("phase", sampled(PHASES, lambda phase: phase in ("trial, on its way", "playback")))
def test_a_push_of_a_third_of_the_bound_stops_nothing(run, phase):
    log, push_tick = run(phase, SOFT * PHASES[phase][3])
    assert [event.text for event in log.events if event.name == "safety"] == []
    force, _ = felt(log)
    assert force[push_tick : push_tick + 40].max() > 0.9 * SOFT * PHASES[phase][3]


# on the wire


class Relay:
    """A relay in a process of its own, and what it has seen."""

    def __init__(self, arm: str, file: Path) -> None:
        first, second, third, last = arm.split(".")
        self.address = f"{first}.{second}.{third}.{int(last) % 100 + 150}"
        self._file = file
        command = [sys.executable, "-m", "tests.support.fci.threshold_relay", arm, self.address, str(file)]
        self._process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, cwd=ROOT)
        assert self._process.stdout is not None
        assert self._process.stdout.readline() == b"listening\n"

    @property
    def thresholds(self) -> np.ndarray:
        """(n, 52), in the order in which they came."""
        return np.frombuffer(self._file.read_bytes()).reshape(-1, 52)

    def close(self) -> None:
        self._process.communicate()


@pytest.fixture
def relays(served_arms: ServedArms, tmp_path: Path) -> Iterator[tuple[Relay, Relay]]:
    """A simulated robot in lockstep, behind two relays."""
    both = Relay(served_arms.left, tmp_path / "left"), Relay(served_arms.right, tmp_path / "right")
    yield both
    for relay in both:
        relay.close()


def upper(thresholds: np.ndarray) -> tuple[list[float], list[float]]:
    """What stops: of 52 numbers lower and upper torques while accelerating and at constant velocity, then forces."""
    torques, forces = thresholds[:28].reshape(4, 7), thresholds[28:].reshape(4, 6)
    assert (torques[1] == torques[3]).all()
    assert (forces[1] == forces[3]).all()
    return torques[1].tolist(), forces[1].tolist()


def as_told(behaviour: CollisionBehaviour) -> tuple[list[float], list[float]]:
    return list(behaviour.collision_torques), list(behaviour.collision_forces)


def test_the_thresholds_on_the_wire_are_those_of_the_next_motion(served_arms, demonstration, relays, monkeypatch):
    # nothing is late in lockstep, but this machine
    monkeypatch.setattr("hal.fci.pair.STALE_S", STALE_IN_LOCKSTEP_S)
    monkeypatch.setattr("rtstack.loop.watchdogs.OVERRUN_TICKS", 10_000)
    both, described = relays, served_arms.description
    for side, relay in zip(("left", "right"), both, strict=True):
        described = replace(described, **{side: replace(getattr(described, side), address=relay.address)})
    prepared = prepare_trial(TrialSpecification(str(demonstration.path)), described)
    arms = open_cell(f"fci:{both[0].address},{both[1].address}", "rice_box", 0.0, 0, described)
    try:
        way = start_motion(arms, described, "rice_box", 0.0, prepared.reference.ante[:, 0])
        assert way is None or way.path.duration_s < 5.0
        result = run_trial(prepared, arms, way=way)
        assert PreparedMove(MoveSpecification(HandMotion.START), described).run(arms).success
        assert PreparedMove(MoveSpecification(HandMotion.OPEN), described).run(arms).success
    finally:
        arms.close()
    assert result.success, result.failure_reason
    limits = limits_of_arms(described)[0]
    phases = (ForcePhase.APPROACH, ForcePhase.IMPACT, ForcePhase.APPROACH, ForcePhase.CONTACT)
    for relay in both:
        seen = [upper(one) for one in relay.thresholds]
        assert seen == [as_told(limits.collisions(phase)) for phase in phases]
