"""Where the next torque starts from, by what the robot says that it was commanded."""

import numpy as np
import pytest

from rtstack.loop.command_echo import CommandEcho
from rtstack.trials.assembly import arm_controllers, default_parameters, safety_judges

SENT, OLD = np.full(7, 3.0), np.full(7, 1.5)


@pytest.fixture
def running(cell):
    """An arm whose last torque, SENT, has left, with its judge and its echo; the robot has had a torque of ours."""
    arm, judge = arm_controllers(cell, default_parameters())[0], safety_judges(cell)[0]
    echo = CommandEcho(judge, arm)
    arm.sample["tau_J_d"], judge.memory["tau_applied"] = SENT, SENT
    echo.agree(begun=True)
    assert echo.seen
    judge.memory["tau_J"] = arm.sample["tau_J"] = np.arange(7.0)
    arm.sample["tau_J_d"], arm.workspace["tau_previous"] = OLD, SENT
    return arm, judge, echo


def test_an_answer_that_was_dropped_is_no_start_for_the_next_torque(running):
    arm, judge, echo = running
    arm.sample["tau_J"] += 1e-3
    echo.agree(begun=True)
    assert echo.lost == 1
    np.testing.assert_array_equal(arm.workspace["tau_previous"][0], OLD)
    np.testing.assert_array_equal(judge.memory["tau_applied"][0], OLD)


def test_a_state_that_repeats_the_last_one_tells_nothing_of_the_torque(running):
    """The robot took the last torque, and its state stands still: from an older one the next would jump."""
    arm, judge, echo = running
    echo.agree(begun=True)
    assert echo.lost == 0
    np.testing.assert_array_equal(arm.workspace["tau_previous"][0], SENT)
    np.testing.assert_array_equal(judge.memory["tau_applied"][0], SENT)
