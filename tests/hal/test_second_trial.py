"""Two trials on one robot that nobody starts again in between, as in a lab."""

from dataclasses import replace

import numpy as np
import pytest

from hal.cell import Cell
from hal.fci import Tool, open_pair
from hal.pad import Pad
from rtstack.cells import default_cell_file
from rtstack.cells.simulator import Simulator
from rtstack.log.reader import read_log
from rtstack.trials.record import open_log
from rtstack.trials.run_context import RunContext
from rtstack.trials.specification import TrialSpecification
from rtstack.trials.start_motion import start_motion
from rtstack.trials.trial import prepare_trial, run_trial

PAD = Tool.of(Pad((0.1, 0.1, 0.03), 0.35, 0.03))


@pytest.mark.long
def test_the_arms_go_back_to_the_start_and_grab_again(simulator: Simulator, cell, demonstration, tmp_path):
    specification = TrialSpecification(str(demonstration.path))
    prepared = prepare_trial(specification, cell)
    start = prepared.reference.ante[:, 0]
    ways = []
    for number in range(2):
        pair = open_pair(simulator.left, simulator.right, (PAD, PAD), shared_clock=True)
        opened = Cell("fci", pair.left, pair.right, simulator.tracker, pair, own_clocks=True)
        way = start_motion(opened, cell, "rice_box", 0.0, start)
        ways.append(way)
        path = tmp_path / f"{number}.mcap"
        # "lockstep": this robot waits for us, and so we may wait for the log
        log = open_log(path, specification, cell, "lockstep", default_cell_file(), reference=prepared.reference)
        try:
            result = run_trial(prepared, opened, RunContext(log), way=way)
        finally:
            pair.close()
        assert result.success, result.failure_reason
        assert result.max_lift_mm > 150.0
    assert ways[0] is None
    assert ways[1] is not None
    events = [text.decode() for text in read_log(tmp_path / "1.mcap").topic("/events")["text"]]
    assert any("to the start pose" in text for text in events)
    # where the second one began: the first ms of the arms is where the reference begins
    arms = [read_log(tmp_path / f"{number}.mcap").topic("/left/arm") for number in range(2)]
    assert np.abs(arms[0]["q"][0] - arms[1]["q"][0]).max() < cell.start_motion.tolerance_rad
    assert np.abs(np.diff(arms[1]["tau_applied"], axis=0, prepend=0.0)).max() <= 1.0


def test_a_way_that_is_broken_off_ends_the_trial_before_its_first_tick(simulator: Simulator, cell, demonstration):
    prepared = prepare_trial(TrialSpecification(str(demonstration.path)), cell)
    pair = open_pair(simulator.left, simulator.right, (PAD, PAD), shared_clock=True)
    opened = Cell("fci", pair.left, pair.right, simulator.tracker, pair, own_clocks=True)
    elsewhere = np.stack([arm.read().q.copy() for arm in (pair.left, pair.right)])
    elsewhere[0, 0] -= 0.2
    way = start_motion(opened, cell, "rice_box", 0.0, prepared.reference.ante[:, 0])
    assert way is None
    away = replace(cell, left=replace(cell.left, home=tuple(elsewhere[0])))
    way = start_motion(opened, away, "rice_box")
    assert way is not None

    class Stopped:
        stop_requested = True

    result = run_trial(prepared, opened, RunContext(stop=Stopped()), way=way)
    pair.close()
    assert not result.success
    assert result.failure_reason == "stop requested by the operator: on the way to the start pose"
    assert (result.ticks, result.max_lift_mm) == (0, None)
