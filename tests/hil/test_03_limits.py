"""03 limits: the robot has the limits that we count on, and refuses what breaks them."""

from collections.abc import Callable

import numpy as np
import pytest

from hal.cell import LEFT, RIGHT
from hal.errors import CommandRejected
from hal.fci import FciPair, ask_for_urdf, limits_in
from hal.robots import FR3
from hal.state import RobotMode
from tests.support.hil.robot import Robot

STEP_NM = 40.0  # in one tick, where the robot takes 1
TICKS = 20


@pytest.mark.parametrize("side", ["left", "right"])
def test_the_robots_limits_are_those_we_keep(robot, side, record_property) -> None:
    own = limits_in(ask_for_urdf(getattr(robot, side)), side)
    found = {name: getattr(own, name) for name in ("q_lower", "q_upper", "dq_max", "tau_max")}
    ours = {name: getattr(FR3.limits, name) for name in found}
    # stricter than the robot is safe, the other way round is a reflex
    spare = {name: (found[name] - ours[name]) * (-1 if name == "q_lower" else 1) for name in ours}
    for name, values in spare.items():
        record_property(f"{name} to spare", float(values.min()))
        assert values.min() >= -1e-6, (name, values)


@pytest.mark.usefixtures("let_go")
def test_a_torque_jump_is_refused_by_name_and_recovered_from(robot: Robot) -> None:
    pair = robot.pair()
    try:
        pair.start()
        assert _refused(lambda: _jump(pair, robot)).errors == ("controller_torque_discontinuity",)
        pair.left.stop()
        pair.right.stop()
        assert pair.left.reflex() == ("controller_torque_discontinuity",)
        assert [line.partition(" has ")[0] for line in pair.recover()] == [f"the left arm at {robot.left}"]
        assert [arm.read().robot_mode for arm in (pair.left, pair.right)] == [RobotMode.IDLE] * 2
    finally:
        pair.close()


@pytest.mark.usefixtures("let_go")
def test_a_torque_that_is_no_number_never_leaves(robot: Robot) -> None:
    pair = robot.pair()
    try:
        pair.start()
        pair.left.read()
        assert "NaN" in str(_refused(lambda: pair.left.write(np.full(7, np.nan))))
        pair.recover()  # meanwhile nobody has answered the right arm
    finally:
        pair.close()


def _refused(command: Callable[[], None]) -> CommandRejected:
    """Return what a command is refused with. Its traceback would keep the client connected: it is let go."""
    try:
        command()
    except CommandRejected as error:
        return error.with_traceback(None)
    raise AssertionError("it was not refused")


def _jump(pair: FciPair, robot: Robot) -> None:
    """Answer both arms without a torque of ours; then ask the left one's last joint for too much."""
    arms, step = (pair.left, pair.right), np.array([0.0] * 6 + [STEP_NM])
    answered = [0, 0]
    while min(answered) < TICKS:
        mask = LEFT | RIGHT if robot.simulated else pair.wait()
        ready = [arm for bit, arm in zip((LEFT, RIGHT), arms, strict=True) if mask & bit]
        for arm in ready:
            arm.read()
        for arm in ready:
            side = arms.index(arm)
            arm.write(step if side == 0 and answered[0] > TICKS // 2 else np.zeros(7))
            answered[side] += 1
