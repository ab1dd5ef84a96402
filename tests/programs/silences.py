"""How long a silence of the client is before the robot stops: a table. Needs a machine that does nothing else.

python -m tests.programs.silences [--times 100] [--priority 0] [--milliseconds 15 18 21 22 25 30]

A client answers each state of torque control, is silent for so long (asleep, or busy on its CPU), and goes on with the
newest state that it finds. The robot has to stop at 20 lost packets, which is 20 ms: a silence of 21 ms and more is
caught each time, one of 18 ms never. What the host did to the server meanwhile, the server says at its end.
"""

import argparse
import sys
import time

import numpy as np

from hal.robot_errors import ROBOT_ERRORS
from hal.state import RobotMode
from sim_robot.fci.protocol import Command
from tests.support.fci.client import DAMPING, STIFFNESS
from tests.support.fci.raw import RawClient
from tests.support.fci.server import serve

BEFORE, AFTER = 40, 60
COMMUNICATION = ROBOT_ERRORS.index("communication_constraints_violation")


def silent(raw: RawClient, milliseconds: float, busy: bool) -> tuple[bool, float]:
    """Be silent once in a motion; whether the robot stopped, and how long no answer went out, ms."""
    assert raw.move() == 1
    state = raw.state()
    while state["robot_mode"] != RobotMode.MOVE:
        state = raw.state()
    q_hold, answered_s, longest_s = np.array(state["q"]), time.monotonic(), 0.0
    for tick in range(BEFORE + AFTER):
        now = time.monotonic()
        longest_s, answered_s = max(longest_s, now - answered_s), now
        raw.command(
            state,
            tau_J_d=STIFFNESS * (q_hold - state["q"]) - DAMPING * state["dq"],
            torque_command_finished=tick == BEFORE + AFTER - 1,
        )
        if tick == BEFORE:
            end = time.monotonic() + 1e-3 * milliseconds
            while busy and time.monotonic() < end:
                pass
            time.sleep(max(0.0, end - time.monotonic()))
        state = raw.state()
        if state["robot_mode"] == RobotMode.REFLEX:
            longest_s = max(longest_s, time.monotonic() - answered_s)
            assert np.flatnonzero(state["errors"]).tolist() == [COMMUNICATION]
            raw.answer()  # to Move
            raw.send(Command.AUTOMATIC_ERROR_RECOVERY)
            while raw.answer()[2] != b"\0":
                raw.send(Command.AUTOMATIC_ERROR_RECOVERY)
            return True, 1e3 * longest_s
    while state["robot_mode"] == RobotMode.MOVE:  # the last answer may have come too late
        raw.command(state, torque_command_finished=1)
        state = raw.state()
    raw.answer()
    return False, 1e3 * longest_s


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--times", type=int, default=100)
    parser.add_argument("--priority", default="80", help="of the server, 0 for ordinary scheduling")
    parser.add_argument("--milliseconds", type=float, nargs="+", default=[15, 18, 21, 22, 25, 30])
    options = parser.parse_args()
    wrong = 0
    print(
        "| silence ms | client | caught | really ms, p50 and max | stopped at 19.5 ms or less, or not at 21 or more |"
    )
    print("|---|---|---|---|---|")
    with serve("--priority", options.priority) as served, RawClient(served.left) as raw:
        raw.connect()
        for milliseconds in options.milliseconds:
            for busy in (False, True):
                runs = [silent(raw, milliseconds, busy) for _ in range(options.times)]
                lengths = [length for _, length in runs]
                # a client that the host kept from its CPU was silent for longer than it meant to
                judged = sum((length <= 19.5) if caught else (length >= 21.0) for caught, length in runs)
                wrong += judged
                caught = sum(caught for caught, _ in runs)
                print(
                    f"| {milliseconds:g} | {'busy' if busy else 'asleep'} | {caught} of {len(runs)} "
                    f"| {np.median(lengths):.2f} and {max(lengths):.2f} | {judged} |",
                    flush=True,
                )
    return int(wrong > 0)


if __name__ == "__main__":
    sys.exit(main())
