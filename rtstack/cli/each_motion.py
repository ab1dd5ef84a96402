"""Carries out each kind of motion once, on a simulated cell with so many arms, so that what it needs is compiled.

    python -m rtstack.cli.each_motion ARMS PART

PART: cell or controller, which it begins with: one process for each, and neither waits long for the other. It ends with
its standard input, a pipe of its parent's.
"""

import gc
import os
import sys
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from hal.displacement import Displacement
from rtstack.cells import default_cell_file, load_description, open_cell
from rtstack.control.modes import Strategy
from rtstack.experiments.simulation import simulated
from rtstack.live.parent_watch import watch_parent
from rtstack.playback.run import prepare_playback
from rtstack.teleoperation.policy import Chunk, Observation, Policy
from rtstack.trials import specification as asked
from rtstack.trials.assembly import cell_controller, cell_parameters, following
from rtstack.trials.demonstration import prepare_demonstration
from rtstack.trials.teleoperation import RATE_HZ, PreparedPolicy
from rtstack.trials.trial import prepare_trial


class _Still(Policy):
    """A policy that leaves the pads where they are, and ends."""

    def act(self, observation: Observation) -> Chunk:
        """See rtstack.teleoperation.policy.Policy."""
        return Chunk(poses=np.array([observation.pose] * 3), finished=observation.t_s > 0.1)


def main() -> None:
    """Lead the arms by hand; of two arms also record a demonstration, try it, and play it."""
    gc.disable()  # a tenth of the time, in a process that ends soon
    watch_parent(lambda: os._exit(1))
    two, file = int(sys.argv[1]) == 2, default_cell_file()
    cell, file = load_description(file if two else file.with_name("one_arm.toml"))
    by_hand = asked.TeleoperationSpecification(operator="", object=next(iter(cell.objects)), recorded=True)
    if sys.argv[2] == "cell":
        open_cell("direct", by_hand.object, Displacement(), 0, cell, cell_file=file).close()
    else:
        cell_controller(cell, cell_parameters(cell), following(Strategy.PROPOSED), nominal_impact_s=0.0)
    simulated(PreparedPolicy(by_hand, cell, _Still(), RATE_HZ, Displacement()), "direct", file, None)
    if not two:
        return
    with TemporaryDirectory() as folder:
        log = Path(folder) / "log.mcap"
        simulated(prepare_demonstration(asked.DemonstrationSpecification(), cell), "direct", file, log)
        simulated(prepare_trial(asked.TrialSpecification(str(log)), cell), "direct", file, log.with_name("trial.mcap"))
        simulated(prepare_playback(asked.PlaybackSpecification(str(log)), cell), "direct", file, None)


if __name__ == "__main__":
    main()
