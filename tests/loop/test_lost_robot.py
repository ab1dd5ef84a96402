"""A robot that is killed in the middle of a motion: the session ends with one line, and the log is whole."""

import os
import re
import signal

from rtstack.cells import default_cell_file, open_cell
from rtstack.log.reader import read_log
from rtstack.samples import Level
from rtstack.trials.demonstration import run_demonstration
from rtstack.trials.record import open_log
from rtstack.trials.run_context import RunContext
from rtstack.trials.specification import DemonstrationSpecification


def test_a_simulator_that_is_killed_ends_the_session(cell, tmp_path):
    path = tmp_path / "killed.mcap"
    specification = DemonstrationSpecification()
    opened = open_cell("lockstep", "rice_box", 0.0, 0, cell)
    pid = opened.link._simulator.pid

    class Kill:
        ticks = 0

        def trip(self) -> None:
            self.ticks += 1
            if self.ticks == 100:
                os.kill(pid, signal.SIGKILL)

    try:
        log = open_log(path, specification, cell, "lockstep", default_cell_file())
        result = run_demonstration(specification, cell, opened, RunContext(log, watchdogs=(Kill(),)))
    finally:
        opened.close()
    assert re.match("the robot left torque control: the (left|right) arm at 127", str(result.failure_reason))
    found = read_log(path)
    assert found.metadata["fault"]["reaction_ticks"] == ""  # nobody is left to take a torque
    assert found.metadata["fault"]["detail"] in str(result.failure_reason)
    errors = [event for event in found.events if event.level is Level.ERROR]
    assert len(errors) == 1
    assert abs(found.topic("/left/arm")["t_ns"][-1] - errors[0].t_ns) <= 1_000_000
