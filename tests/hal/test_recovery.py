"""What an arm has latched, its recovery, and what becomes of the other arm of one that is lost."""

import os
import signal

import numpy as np
import pytest

from hal.cell import Cell
from hal.errors import CommandRejected, ConnectionLost, RecoveryRefused
from hal.fci import FciPair, open_pair
from hal.pad import Pad
from hal.state import RobotMode
from hal.tracker_link import NoTracker
from rtstack.cells.simulator import Simulator
from rtstack.live.idle import IdleView
from rtstack.log.ring import Rings
from rtstack.testing import ServedArms

PAD = Pad((0.1, 0.1, 0.03), 0.35, 0.03)


def trip(pair: FciPair) -> None:
    """Let the left arm stop at a torque jump."""
    pair.start()

    def serve() -> None:
        for k in range(4):
            for arm in (pair.left, pair.right):
                arm.read()
            for arm in (pair.left, pair.right):
                arm.write(np.full(7, 40.0 * (k > 0 and arm is pair.left)))

    with pytest.raises(CommandRejected):
        serve()


def test_an_arm_that_is_opened_in_reflex_says_so_and_recovers(served_arms: ServedArms):
    first = open_pair(served_arms.left, served_arms.right, (PAD, PAD), shared_clock=True)
    trip(first)
    first.close()
    pair = open_pair(served_arms.left, served_arms.right, (PAD, PAD), shared_clock=True)
    assert pair.left.reflex() == ("controller_torque_discontinuity",)
    assert pair.right.reflex() == ()
    with pytest.raises(CommandRejected, match="controller_torque_discontinuity"):
        pair.left.read()
    (line,) = pair.recover()
    assert line == f"the left arm at {served_arms.left} has recovered from controller_torque_discontinuity"
    assert pair.left.read().robot_mode == RobotMode.IDLE
    assert pair.recover() == ()
    pair.close()


def test_a_recovery_is_not_armed_for_the_next_error(served_arms: ServedArms):
    pair = open_pair(served_arms.left, served_arms.right, shared_clock=True)
    assert pair.recover() == ()
    trip(pair)
    pair.left.stop()
    assert pair.left.reflex() == ("controller_torque_discontinuity",)
    pair.close()


def test_a_refusal_names_the_cause_and_comes_after_both_were_asked(scripted):
    with scripted(
        '[[fault]]\nkind = "reflex"\nerror = "joint_reflex"\narm = "left"\nat_s = 0.005\nduration_s = 1e5\n'
        '[[fault]]\nkind = "reflex"\nerror = "power_limit_violation"\narm = "right"\nat_s = 0.005\n'
    ) as pair:
        pair.start()
        with pytest.raises(CommandRejected):
            float_both(pair)
        pair.stop()
        with pytest.raises(RecoveryRefused, match="the cause persists: joint_reflex") as refused:
            pair.recover()
        said = f"the right arm at {pair.right.address} has recovered from power_limit_violation"
        assert said in str(refused.value)
        assert (pair.left.reflex(), pair.right.reflex()) == (("joint_reflex",), ())


def float_both(pair: FciPair) -> None:
    """Answer each state with no torque, for 100 ms."""
    for _ in range(100):
        for arm in (pair.left, pair.right):
            arm.read()
            arm.write(np.zeros(7))


def test_a_user_stop_is_named_where_a_recovery_or_a_motion_is_asked_for(scripted):
    with scripted('[[fault]]\nkind = "user_stop"\narm = "right"\nat_s = 0.005\nduration_s = 0.5\n') as pair:
        pair.start()
        with pytest.raises(CommandRejected):
            float_both(pair)
        pair.stop()
        with Rings.create() as rings:
            refused: list[str] = []
            cell = Cell("fci", pair.left, pair.right, NoTracker(), pair)
            IdleView(rings).watch(cell, lambda: bool(refused), refused.append, lambda: ())
        assert "right arm cannot move, its user stop is pressed: release it" in refused[0]
        with pytest.raises(RecoveryRefused, match="user stop is pressed"):
            pair.recover()
        while pair.right.read().robot_mode is RobotMode.USER_STOPPED:
            pair.left.read()
        assert pair.recover() == ()


def test_an_arm_that_falls_silent_is_named_and_the_other_one_stops():
    """Each arm of a robot of its own; the right one's is frozen in the middle of torque control."""
    robots = [Simulator("rice_box", 0.0, 3, lockstep=True) for _ in range(2)]
    pair = open_pair(robots[0].left, robots[1].right)
    try:
        pair.start()
        frozen = False

        def serve() -> None:
            nonlocal frozen
            for tick in range(2_000_000):
                mask = pair.wait()
                for bit, arm in ((1, pair.left), (2, pair.right)):
                    if mask & bit:
                        arm.read()
                        arm.write(np.zeros(7))
                if tick == 50:
                    os.kill(robots[1].pid, signal.SIGSTOP)
                    frozen = True

        with pytest.raises(ConnectionLost, match=robots[1].right):
            serve()
        assert frozen
        # in this order: the one that is lost must not keep the other one from being stopped
        pair.right.stop()
        pair.left.stop()
        assert pair.left.read().robot_mode == RobotMode.IDLE
    finally:
        pair.close()
        os.kill(robots[1].pid, signal.SIGCONT)
        for robot in robots:
            robot.close()


def test_two_arms_that_fall_silent_together_are_both_let_go_of():
    """A switch without power: nothing that is said to either arm is ever answered."""
    robot = Simulator("rice_box", 0.0, 3, lockstep=True)
    pair = open_pair(robot.left, robot.right)
    pair.start()
    os.kill(robot.pid, signal.SIGSTOP)
    try:
        with pytest.raises(ConnectionLost, match=rf"{robot.left} .*{robot.right}"):  # noqa: PT012
            for _ in range(1000):
                mask = pair.wait()
                for bit, arm in ((1, pair.left), (2, pair.right)):
                    if mask & bit:
                        arm.read()
        pair.left.stop()
        pair.right.stop()
        pair.close()
    finally:
        os.kill(robot.pid, signal.SIGCONT)
        robot.close()
