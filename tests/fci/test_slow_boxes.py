"""Boxes that take their time: neither arm starves while the process waits for the other one.

In slow motion, so that 20 lost packets are 160 ms of a host that may be busy.
"""

import re
from contextlib import nullcontext, suppress
from dataclasses import replace

import numpy as np
import pytest

from hal.cell import LEFT, RIGHT
from hal.errors import CommandRejected
from hal.fci import FciPair, open_pair
from hal.limits import CollisionBehaviour, HoldBounds
from hal.state import RobotMode
from sim_robot.fci.protocol import Command, RecoveryStatus
from tests.support.fci.raw import RawClient
from tests.support.fci.server import serve

COMMUNICATION = "communication_constraints_violation"
SLOWER, TICKS = 8, 20


def _hold(pair: FciPair) -> None:
    """Start both, and answer each of them for some ms."""
    pair.start()
    arms, ticks = (pair.left, pair.right), [0, 0]
    while min(ticks) < TICKS:
        mask = pair.wait()
        for k, side in enumerate((LEFT, RIGHT)):
            if mask & side:
                arms[k].read()
                arms[k].write(np.zeros(7))
                ticks[k] += 1


@pytest.mark.alone
@pytest.mark.long
@pytest.mark.parametrize("profile", ["honest", "harsh"])
def test_starts_and_stops_of_one_arm_cost_the_other_one_nothing(profile) -> None:
    with serve("--profile", profile, "--slower", str(SLOWER)) as served:
        pair = open_pair(served.left, served.right)
        for first in (LEFT, RIGHT, LEFT):
            _hold(pair)
            pair.stop(first, at_rest=True)
            assert (pair.left.reflex(), pair.right.reflex()) == ((), ())
        pair.close()


@pytest.mark.alone
def test_without_the_hold_the_other_arm_stops_by_itself() -> None:
    with serve("--profile", "harsh", "--slower", str(SLOWER)) as served:
        pair = open_pair(served.left, served.right)
        pair.holding = lambda arm: nullcontext()  # type: ignore[method-assign]
        reflexes: list[str] = []
        for _ in range(3):
            with suppress(CommandRejected):  # the left one, while the right box starts
                _hold(pair) if not reflexes else None
            pair.stop(LEFT, at_rest=True)
            reflexes += pair.left.reflex() + pair.right.reflex()
        assert COMMUNICATION in reflexes
        pair.close()


def test_a_box_that_recovers_says_so_and_takes_its_time() -> None:
    """In lockstep the states go on at 1 kHz meanwhile, and the box counts them."""
    with serve("--lockstep", "--profile", "honest") as served, RawClient(served.left) as raw:
        raw.command(raw.begin())
        state = raw.state()
        raw.command(state, tau_J_d=np.full(7, 40.0))
        while state["robot_mode"] != RobotMode.REFLEX:
            state = raw.state()
        assert raw.answer()[0] == Command.MOVE
        raw.send(Command.AUTOMATIC_ERROR_RECOVERY)
        modes = [int(state["robot_mode"])]
        while modes[-1] != RobotMode.IDLE:
            modes.append(int(raw.state()["robot_mode"]))
        assert 700 <= modes.count(RobotMode.AUTOMATIC_ERROR_RECOVERY) <= 7301
        assert raw.answer()[2] == bytes((RecoveryStatus.SUCCESS,))


@pytest.mark.alone
def test_an_arm_that_was_let_go_names_the_bound() -> None:
    """Its bounds are those that no state is inside of."""
    none = HoldBounds((-9.0,) * 7, (9.0,) * 7, (9.0,) * 7, (-1.0,) * 7, 250.0)
    with serve("--profile", "harsh", "--slower", str(SLOWER)) as served:
        pair = open_pair(served.left, served.right)
        pair.left.set_collisions(replace(CollisionBehaviour(), hold=none))
        said = ""
        for _ in range(6):  # until the right box is slow enough
            try:
                _hold(pair)
            except CommandRejected as error:
                said = str(error)
                break
            pair.stop(LEFT, at_rest=True)
        assert re.search(
            r"held for 0 ms while the other arm's box .* joint 1 feels .* Nm, allowed -1\) .*" + COMMUNICATION, said
        )
        pair.close()
