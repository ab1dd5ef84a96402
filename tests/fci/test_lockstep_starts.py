"""Two arms in one loop that reads both before it answers either: no start may end with both sides waiting."""

import random
import time

import numpy as np
import pytest

from tests.support.fci.motions import moving_state
from tests.support.fci.raw import RawClient
from tests.support.fci.server import Served

# around the server's repeats of the first state, 1, 50 and 100 ms
DELAYS_S = (0.0, 0.0005, 0.002, 0.0495, 0.0505, 0.1, 0.15)


def test_two_arms_that_are_read_before_they_are_answered(lockstep: Served) -> None:
    rng = random.Random(1)
    for _ in range(30):
        with RawClient(lockstep.left) as left, RawClient(lockstep.right) as right:
            both = (left, right)
            for client in both:
                client.connect()
            for client in both:
                client.move()
                time.sleep(rng.choice(DELAYS_S))
            for _ in range(20):
                states = [client.state() for client in both]
                for client, state in zip(both, states, strict=True):
                    client.command(state, tau_J_d=np.zeros(7))
            for client, state in zip(both, [client.state() for client in both], strict=True):
                client.command(state, torque_command_finished=1)


@pytest.mark.long
def test_a_second_motion_leaves_the_firsts_time_alone(lockstep: Served) -> None:
    """The first client is slower than 1 kHz, so that the idle arm's states, which go by the clock, have run ahead."""
    with RawClient(lockstep.left) as slow, RawClient(lockstep.right) as late:
        slow.connect()
        late.connect()
        assert slow.move() == 1
        state = moving_state(slow)
        ids = [int(state["message_id"])]
        for tick in range(60):
            if tick == 30:
                assert late.move() == 1
            time.sleep(4e-3)
            slow.command(state)
            if tick > 30:
                late.command(moving_state(late))
            state = slow.next_state()  # each one: a first state that was repeated may still be unread
            ids.append(int(state["message_id"]))
        assert set(np.diff(ids[3:])) == {1}
