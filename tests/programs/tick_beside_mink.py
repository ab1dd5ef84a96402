"""The dual-arm tick beside mink's inverse kinematics for the same two arms, turn by turn in one run.

mink solves kinematics alone: two frame tasks and a posture task, position and velocity limits, by daqp. A round is
`rtstack bench tick` and as many solutions of mink's, in this process; ratios are of the medians, then over the rounds.

Takes a minute, on a quiet machine.
"""

import sys
import time
from importlib.metadata import version
from statistics import median

import mink
import mujoco
import numpy as np

from rtstack.bench.tick import bench_tick
from rtstack.cells import load_description
from rtstack.trials.assembly import default_parameters
from sim_robot.plant import Plant
from sim_robot.plant_parameters import load_plant_parameters
from sim_robot.scene import SIDES, load_scene
from tests.programs import program

TICKS = 500
PERIOD_S = 1e-3


class KinematicsOnly:
    """mink on the simulated cell's kinematics, both pads as targets."""

    def __init__(self) -> None:
        model = Plant.nominal(load_scene(), load_plant_parameters(), "rice_box").model
        self.configuration = mink.Configuration(model)
        home = np.concatenate([load_scene().left.home, load_scene().right.home])
        q = self.configuration.q.copy()
        q[: len(home)] = home
        self.configuration.update(q)
        self._pads = [
            mink.FrameTask(f"{side}_pad", "body", position_cost=1.0, orientation_cost=1.0, lm_damping=1e-6)
            for side in SIDES
        ]
        posture = mink.PostureTask(model, cost=1e-3)
        posture.set_target(q)
        for task in self._pads:
            task.set_target_from_configuration(self.configuration)
        self._targets = [self.configuration.get_transform_frame_to_world(f"{side}_pad", "body") for side in SIDES]
        self._tasks = [*self._pads, posture]
        joints = [f"{side}_joint{number}" for side in SIDES for number in range(1, 8)]
        self._limits = [mink.ConfigurationLimit(model), mink.VelocityLimit(model, dict.fromkeys(joints, 2.0))]

    def solve(self, k: int) -> int:
        """Solve a tick; return its time in ns."""
        shift = 0.02 * np.sin(2e-3 * k) * np.array([0.3, 1.0, 0.5])
        for task, target in zip(self._pads, self._targets, strict=True):
            task.set_target(mink.SE3.from_translation(shift) @ target)
        began = time.perf_counter_ns()
        velocity = mink.solve_ik(
            self.configuration, self._tasks, PERIOD_S, solver="daqp", damping=1e-6, limits=self._limits
        )
        self.configuration.integrate_inplace(velocity, PERIOD_S)
        return time.perf_counter_ns() - began


def beside_mink(rounds: int) -> dict[str, float]:
    """Measure in turns, print each round, and return the medians in us: of mink, and of our tick."""
    kinematics, description, parameters = KinematicsOnly(), load_description(None)[0], default_parameters()
    print(
        "| round | mink p50 us | tick p50 us | ratio | limits active p50 us | of the tick |\n|---|---|---|---|---|---|",
        file=sys.stderr,
    )
    theirs, ours, constrained = [], [], []
    for number in range(1, rounds + 1):
        ticks = bench_tick(description, parameters, TICKS)
        theirs.append(1e-3 * median(kinematics.solve(number * TICKS + k) for k in range(TICKS)))
        ours.append(ticks["tick_us_p50"])
        constrained.append(ticks["constrained_tick_us_p50"] / ticks["tick_us_p50"])
        print(
            f"| {number} | {theirs[-1]:.1f} | {ours[-1]:.1f} | {ours[-1] / theirs[-1]:.3f} | "
            f"{ticks['constrained_tick_us_p50']:.1f} | {constrained[-1]:.2f} |",
            file=sys.stderr, flush=True,
        )  # fmt: skip
    ratio = median(our / their for our, their in zip(ours, theirs, strict=True))
    print(
        f"\nmedian: {ratio:.3f} of mink's, limits active {median(constrained):.2f} of the tick without\n"
        f"mink {version('mink')}, MuJoCo {mujoco.__version__}",
        file=sys.stderr,
    )
    return {"rtstack": median(ours), "mink": median(theirs)}


def main(rounds: int = 10) -> None:
    """Measure and print."""
    beside_mink(rounds)


if __name__ == "__main__":
    program(main)
