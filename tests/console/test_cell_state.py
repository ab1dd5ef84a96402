"""The word in the bar: what is so, not only what is allowed."""

from dataclasses import replace

import numpy as np
import pytest

from console.live.remedies import chapters, remedy_of
from console.live.watch import CellState, CellWord, Squeeze, cell_state
from hal.robot_errors import ROBOT_ERRORS
from rtstack.live.protocol import Job, JobKind, JobState, Phase, Status
from rtstack.loop.end import End
from rtstack.safety.judge import Cause

JOB = Job(3, JobKind.TRIAL, JobState.RUNNING, "proposed", 0.5, 0.0)
STATUS = Status(
    "grab",
    "direct",
    "grab.toml",
    "logs",
    True,
    ("box",),
    "box",
    None,
    None,
    Phase.DISARMED,
    None,
    "anna",
    0.0,
    False,
    "fifo",
)


def job(state, phase=Phase.MOVING, reason=None):
    return replace(STATUS, job=replace(JOB, state=state), phase=phase, reason=reason)


@pytest.mark.parametrize(
    ("status", "led", "moved", "held_n", "word", "active"),
    [
        (None, False, False, None, "waiting", True),
        (STATUS, False, False, None, "disarmed", False),
        (STATUS, False, False, 17.0, "holding", False),
        (STATUS, False, True, None, "moving", True),  # by no job of ours
        (replace(STATUS, phase=Phase.ARMED), False, False, None, "armed", False),
        (replace(STATUS, phase=Phase.ARMED), False, False, 17.0, "armed", False),
        (job(JobState.STARTING), False, False, None, "preparing", True),
        (job(JobState.RUNNING), False, False, None, "preparing", True),  # no state yet: nothing can move
        (job(JobState.RUNNING), True, False, None, "holding", True),
        (job(JobState.RUNNING), True, True, 40.0, "moving", True),
        (job(JobState.STOPPING), True, True, None, "moving", True),
        (job(JobState.DONE, Phase.ARMED), True, False, None, "armed", False),
        (job(JobState.STOPPED, Phase.DISARMED), True, False, 17.0, "holding", False),
        (job(JobState.STOPPING, Phase.FAULT, "safety stop"), True, True, None, "fault", True),
        (job(JobState.FAILED, Phase.FAULT, "safety stop"), True, False, 17.0, "fault", False),
        (replace(STATUS, phase=Phase.RECOVERING), False, False, None, "recovering", True),
    ],
)
def test_the_word_says_what_is_so(status, led, moved, held_n, word, active):
    state = cell_state(status, led, moved, held_n)
    assert (state.word, state.active) == (word, active)
    assert state.held_n == (None if status is None else held_n)


@pytest.mark.parametrize(
    ("on_left", "on_right", "held_n"),
    [
        ((0.0, 17.0, 3.0), (0.0, -19.0, 3.0), 17.0),  # the object pushes both pads outwards
        ((0.0, 2.0, 0.0), (0.0, -2.0, 0.0), None),  # noise
        ((0.0, 17.0, 0.0), (0.0, 0.0, 0.0), None),  # one arm leans on something
        ((0.0, -17.0, 0.0), (0.0, 17.0, 0.0), None),  # pulled inwards
        ((0.0, 0.0, 30.0), (0.0, 0.0, 30.0), None),  # pressed on the table
    ],
)
def test_what_both_pads_squeeze_is_held(on_left, on_right, held_n):
    squeeze = Squeeze()
    places = np.array([[0.0, 0.2, 0.3], [0.0, -0.2, 0.3]])
    for _ in range(24):
        squeeze.add(places, np.array([on_left, on_right]))
    assert squeeze.held_n is None  # half a second has not gone by
    squeeze.add(places, np.array([on_left, on_right]))
    assert squeeze.held_n == (None if held_n is None else pytest.approx(held_n))
    squeeze.add(None, None)
    assert squeeze.held_n is None


@pytest.mark.parametrize("reason", [*ROBOT_ERRORS, *(one.text for one in Cause if one is not Cause.NONE), *End])
def test_every_reason_of_a_fault_has_its_row_of_the_runbook(reason):
    found = remedy_of(f"{reason}: more" if reason in list(End) else f"safety stop: left arm: {reason}: more")
    assert found is not None
    assert found.name == reason
    assert found.todo
    assert not found.todo.startswith(("as above", "as for", "the same"))
    assert "`" not in found.todo + found.cause


def test_what_has_no_row_has_no_remedy_and_anchors_are_unique():
    assert remedy_of(None) is None
    assert remedy_of("internal error: division by zero") is None
    anchors = [row.anchor for chapter in chapters() for row in chapter.rows]
    assert len(set(anchors)) == len(anchors) > 70


def test_a_fault_comes_with_its_remedy():
    assert remedy_of("the operator has gone: no signal for 2 s").todo.startswith("Press Recover, take control")
    state = cell_state(job(JobState.FAILED, Phase.FAULT, "the clutch has gone quiet"), True, False, None)
    assert state == CellState(CellWord.FAULT, None, False, remedy_of("the clutch has gone quiet"))
