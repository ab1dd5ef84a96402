"""04 faults: whoever controls dies in the middle, and the robot stops by itself, says why, and is led out of it.

Faults that need a script are of the simulated cell alone (`fault_matrix`). On metal there is one more, for a person:
press the user stop while 02 is running; the run has to end with a line that names it.
"""

import signal
import subprocess
import sys

import pytest

from hal.fci import open_pair
from hal.state import RobotMode

LOST = "communication_constraints_violation"
ANSWERS = 200
STATES = 3000  # to wait for the reflex: 20 ms of the robot
AT_REST = 0.02  # rad/s, with the noise of its measurement

_HOLD = """
import sys
import numpy as np
from hal.fci import open_pair
pair = open_pair(*sys.argv[1:3], shared_clock=sys.argv[3] == "True")
pair.start()
arms, still, count = (pair.left, pair.right), np.zeros(7), 0
while True:
    ready = pair.wait()
    for side, arm in enumerate(arms):
        if ready & 1 << side:
            arm.read()
            arm.write(still)
    count += 1
    if count == int(sys.argv[4]):
        print("holding", flush=True)
"""


@pytest.mark.usefixtures("let_go")
def test_a_controller_that_is_killed_leaves_both_arms_stopped_with_the_vendors_name(robot, record_property) -> None:
    command = [sys.executable, "-c", _HOLD, robot.left, robot.right, str(robot.simulated), str(ANSWERS)]
    controller = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    try:
        assert controller.stdout is not None
        assert controller.stdout.readline() == "holding\n"
    finally:
        controller.send_signal(signal.SIGKILL)
        controller.communicate()
    pair = open_pair(robot.left, robot.right, shared_clock=robot.simulated)
    try:
        for side, arm in (("left", pair.left), ("right", pair.right)):
            looks = 1
            while not (errors := arm.reflex()) and looks < STATES:
                looks += 1
            record_property(f"{side} looks until the reflex", looks)
            assert errors == (LOST,)
        recovered = pair.recover()
        assert [LOST in line for line in recovered] == [True, True]
        for arm in (pair.left, pair.right):
            state = arm.read()
            assert state.robot_mode == RobotMode.IDLE
            assert max(map(abs, state.dq)) < AT_REST
    finally:
        pair.close()
