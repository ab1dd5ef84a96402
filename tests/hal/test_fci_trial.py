"""A whole trial over the wire."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from hal.cell import Cell
from hal.state import RobotMode
from rtstack.cells import default_cell_file, open_cell
from rtstack.log.reader import read_log
from rtstack.model.cell_description import CellDescription
from rtstack.papers.reference_spreading.controllers import Controller
from rtstack.samples import SIDES
from rtstack.trials.record import open_log
from rtstack.trials.result import TrialResult
from rtstack.trials.run_context import RunContext
from rtstack.trials.specification import DemonstrationSpecification, TrialSpecification
from rtstack.trials.trial import prepare_trial, run_trial
from tests.support.runs import demonstrate

# the heaviest object has the largest forces that an ordinary grab has: 135 N (left) and 115 N (right) at the impact
LEAST_PEAK_N = 100.0


@pytest.fixture
def run(cell: CellDescription, demonstration):
    """A runner of one trial with a displaced box on an open cell, which it closes; the log goes to a path."""

    def run_on(opened: Cell, log_path: Path) -> TrialResult:
        try:
            specification = TrialSpecification(str(demonstration.path), Controller.PROPOSED, "rice_box", -30.0, 1)
            prepared = prepare_trial(specification, cell)
            log = open_log(log_path, specification, cell, "lockstep", default_cell_file(), reference=prepared.reference)
            return run_trial(prepared, opened, RunContext(log))
        finally:
            opened.close()

    return run_on


def open_(kind: str) -> Cell:
    return open_cell(kind, "rice_box", -0.03, 1)


def test_a_trial_in_lockstep_is_the_direct_one_bit_for_bit(run, tmp_path: Path):
    results = [run(open_(kind), tmp_path / f"{kind}.mcap") for kind in ("direct", "lockstep")]
    assert results[0].success
    assert results[1].success, results[1].failure_reason
    direct, lockstep = (read_log(tmp_path / f"{kind}.mcap") for kind in ("direct", "lockstep"))
    for side in SIDES:
        a, b = direct.topic(f"/{side}/arm"), lockstep.topic(f"/{side}/arm")
        for name in set(a.dtype.names or ()) - {"t_ns", "robot_mode", "control_command_success_rate"}:
            assert np.array_equal(a[name], b[name]), (side, name)
        # the first state: torque control has begun over the wire, and begins with the first torque in this process
        assert np.array_equal(a["robot_mode"][1:], b["robot_mode"][1:])
        assert np.array_equal(a["t_ns"][1:] - a["t_ns"][1], b["t_ns"][1:] - b["t_ns"][1])
        a, b = direct.topic(f"/{side}/control"), lockstep.topic(f"/{side}/control")
        for name in set(a.dtype.names or ()) - {"t_ns"}:
            assert np.array_equal(a[name], b[name]), (side, name)
    a, b = direct.topic("/object/pose"), lockstep.topic("/object/pose")
    assert np.array_equal(a["position"], b["position"])
    assert results[0].max_lift_mm == results[1].max_lift_mm
    assert results[0].average_force_norm == results[1].average_force_norm


@pytest.mark.long
def test_arms_that_are_served_one_by_one_grab_as_well(run, tmp_path: Path):
    """As two control boxes would be: each arm's answer leaves as soon as its own state has arrived."""
    path = tmp_path / "trial.mcap"
    result = run(replace(open_("lockstep"), own_clocks=True), path)
    assert result.success, result.failure_reason
    assert result.missed_deadlines == 0
    log = read_log(path)
    for side in SIDES:
        arm = log.topic(f"/{side}/arm")
        assert np.array_equal(np.unique(np.diff(arm["t_ns"][1:])), [1_000_000])
        # no answer was lost: the robot's torque is the one that was applied a tick before
        assert np.abs(arm["tau_J_d"][2:] - arm["tau_applied"][1:-1]).max() < 1e-5
    assert any(b"0 answers came too late" in text for text in log.topic("/events")["text"])


@pytest.mark.long
def test_a_grab_trips_nothing_with_the_robots_own_thresholds(
    cell: CellDescription, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    """Nobody says SetCollisionBehavior: what sim_robot/fci/settings.py has must live with an ordinary impact."""
    monkeypatch.setattr("hal.fci.arm.configure", lambda robot, tool, collisions: None)
    path, specification = tmp_path / "grab.mcap", DemonstrationSpecification(object="box_220")
    result = demonstrate(path, cell, specification, kind="lockstep")
    assert result.success, result.failure_reason
    log = read_log(path)
    for side in SIDES:
        arm = log.topic(f"/{side}/arm")
        assert not arm["current_errors"].any()
        assert set(arm["robot_mode"][1:]) <= {RobotMode.IDLE, RobotMode.MOVE}
        assert np.linalg.norm(arm["O_F_ext_hat_K"][:, :3], axis=1).max() > LEAST_PEAK_N
