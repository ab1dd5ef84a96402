"""Carries out each kind of motion once, on a simulated cell with so many arms, so that what it needs is compiled.

    python -m rtstack.cli.each_motion ARMS

It ends with its standard input, a pipe of its parent's.
"""

import os
import sys
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from hal.displacement import Displacement
from rtstack.cells import default_cell_file, load_description
from rtstack.experiments.simulation import simulated
from rtstack.live.parent_watch import watch_parent
from rtstack.playback.run import prepare_playback
from rtstack.teleoperation.policy import Chunk, Observation, Policy
from rtstack.trials import specification as asked
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
    watch_parent(lambda: os._exit(1))
    two, file = int(sys.argv[1]) == 2, default_cell_file()
    cell, file = load_description(file if two else file.with_name("one_arm.toml"))
    by_hand = asked.TeleoperationSpecification(operator="", object=next(iter(cell.objects)), recorded=True)
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
