"""A trial on arms that stand elsewhere, as in a lab; that they go back and grab again: tests/hil."""

from dataclasses import replace

import numpy as np
import pytest

from hal.cell import Cell
from hal.errors import HardwareError
from hal.fci import open_pair
from hal.pad import Pad
from hal.tracker_link import NoTracker
from rtstack.testing import ServedArms
from rtstack.trials import carry_out as carried
from rtstack.trials.move import PreparedMove
from rtstack.trials.run_context import RunContext
from rtstack.trials.specification import HandMotion, MoveSpecification, TrialSpecification
from rtstack.trials.start_motion import start_motion
from rtstack.trials.trial import prepare_trial, run_trial

PAD = Pad((0.1, 0.1, 0.03), 0.35, 0.03)


def test_a_way_that_is_broken_off_ends_the_trial_before_its_first_tick(served_arms: ServedArms, cell, demonstration):
    prepared = prepare_trial(TrialSpecification(str(demonstration.path)), cell)
    pair = open_pair(served_arms.left, served_arms.right, (PAD, PAD), shared_clock=True)
    opened = Cell("fci", pair.left, pair.right, NoTracker(), pair, own_clocks=True)
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


def test_real_arms_are_connected_to_once_everything_is_compiled(cell, monkeypatch):
    """A cold cache took three minutes with the key held, and ended in "has sent no state"."""
    done: list[str] = []
    monkeypatch.setattr(carried, "cell_controller", lambda *_: done.append("compiled"))

    class Host:
        def cell(self, run):
            done.append("connected")
            raise HardwareError("no arm")

    run = PreparedMove(MoveSpecification(HandMotion.OPEN), replace(cell, simulated=False))
    with pytest.raises(HardwareError):
        carried.carry_out(run, Host())
    assert done == ["compiled", "connected"]
