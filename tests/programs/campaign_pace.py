"""How fast a campaign's trials go, and beside them MuJoCo alone on their states: `mujoco.rollout`, open loop.

    python -m tests.programs.campaign_pace WORK [--rounds 3] [--trials 3] [--command 60]

A round runs trials of `rtstack campaign reference-spreading --quick` with their logs, as its workers do, and after them
the plant of one of them: from each of its states 1 ms onwards, with the torques and the warm start that the trial had.
Seconds of the CPU count, so that other programs disturb little: prints robot's seconds for each of one core.
Then the whole command, with so many trials and a worker a core, and MuJoCo with as many threads: seconds of the wall.
"""

import argparse
import os
import shutil
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import mujoco
import numpy as np
from mujoco import rollout

from rtstack.experiments.experiment import Request
from rtstack.experiments.plan_file import PlanFile
from rtstack.experiments.registry import plan_file
from rtstack.experiments.store import Store
from rtstack.papers.demonstrations import LOGS, RECORDINGS
from rtstack.papers.reference_spreading.experiment import ControllerComparison
from rtstack.papers.reference_spreading.worker import run
from sim_robot.model import SUBSTEPS
from sim_robot.plant import Plant
from tests.programs.growth import comparison, write_plan

CORES = len(os.sched_getaffinity(0))


class Recording:
    """The states of a plant before each millisecond, with the torques on the links and the solver's warm start."""

    def __init__(self) -> None:
        self.states: list[np.ndarray] = []
        self.torques: list[np.ndarray] = []
        self.warm: list[np.ndarray] = []
        self.plant: Plant | None = None

    def __enter__(self) -> "Recording":
        self._advance = advance = Plant.advance

        def recorded(plant: Plant) -> None:
            data, self.plant = plant.data, plant
            self.states.append(np.concatenate([[data.time], data.qpos, data.qvel]))
            self.warm.append(data.qacc_warmstart.copy())
            advance(plant)
            self.torques.append(data.qfrc_applied.copy())

        Plant.advance = recorded
        return self

    def __exit__(self, *_: object) -> None:
        Plant.advance = self._advance


class Campaign:
    """The campaign's trials, run in this process."""

    def __init__(self, out: Path) -> None:
        for name in (RECORDINGS, LOGS):
            (out / name).mkdir(parents=True, exist_ok=True)
        path = plan_file("reference-spreading").path
        self._experiment = ControllerComparison(
            ControllerComparison.read(path, True), Request(PlanFile(path, "commit"), out)
        )
        for stage in self._experiment.stages():
            for task in stage.tasks[:1]:
                task.function(*task.arguments)
            break
        cases = self._experiment.cases([])
        self._tasks = [task for task in self._experiment.tasks(cases) if task.cases[0].reference == cases[0].reference]

    def run(self, number: int) -> float:
        """Run a trial; return its robot's seconds."""
        task = self._tasks[number % len(self._tasks)]
        (row,) = run(*task.arguments)
        return self._experiment.robot_s(row)


def open_loop(recording: Recording, clock: Callable[[], float] = time.process_time, threads: int = 1) -> float:
    """Return how many times real time MuJoCo goes by itself, of the seconds of a clock."""
    assert recording.plant is not None
    model = recording.plant.model
    states, torques, warm = (np.array(each) for each in (recording.states, recording.torques, recording.warm))
    control = np.repeat(torques[:, None, :], SUBSTEPS, axis=1)
    data = [mujoco.MjData(model) for _ in range(threads)]
    began_s = clock()
    rollout.rollout(
        model, data, states, control, control_spec=int(mujoco.mjtState.mjSTATE_QFRC_APPLIED),
        initial_warmstart=warm,
    )  # fmt: skip
    return 1e-3 * len(states) / (clock() - began_s)


def whole_command(work: Path, trials: int) -> tuple[float, float, float]:
    """Run `rtstack campaign` with a worker a core; return the seconds of robot, trials and all."""
    plan, out = work / "command.toml", work / "command"
    shutil.rmtree(out, ignore_errors=True)
    write_plan(plan, trials)
    command = [str(Path(sys.executable).parent / "rtstack"), "campaign", str(plan), "--out", str(out)]
    began_s = time.perf_counter()
    subprocess.run([*command, "--workers", str(CORES)], check=True, stdout=subprocess.DEVNULL)
    all_s = time.perf_counter() - began_s
    with Store(out, comparison(plan, out).columns) as store:
        (told,) = store.invocations()
    return told["robot_s"], told["wall_s"], all_s


def main() -> None:
    """Measure in turns, and print a table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("work", type=Path)
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--trials", type=int, default=3)
    parser.add_argument("--command", type=int, default=0)
    options = parser.parse_args()
    campaign = Campaign(options.work.resolve())
    with Recording() as recording:
        campaign.run(0)  # compiles, and fills what trials share
    assert recording.plant is not None
    recording.plant.look_at_all()  # it has left geoms out: MuJoCo alone does not
    print(
        "| round | trials with logs, x real time | mujoco.rollout, x real time | ratio |\n|---|---|---|---|", flush=True
    )
    for number in range(1, options.rounds + 1):
        began_s = time.process_time()
        robot_s = sum(campaign.run(number * options.trials + k) for k in range(options.trials))
        pace = robot_s / (time.process_time() - began_s)
        alone = open_loop(recording)
        print(f"| {number} | {pace:.2f} | {alone:.2f} | {pace / alone:.2f} |", flush=True)
    if options.command:
        robot_s, trials_s, all_s = whole_command(options.work.resolve(), options.command)
        alone = open_loop(recording, time.perf_counter, CORES)
        paces = (
            f"{robot_s / trials_s:.1f} x real time in {trials_s:.0f} s, {robot_s / all_s:.1f} x in all {all_s:.0f} s"
        )
        print(f"\n{options.command} trials on {CORES} cores: {paces}; mujoco.rollout {alone:.1f} x")
        print(f"load of this machine: {os.getloadavg()[0]:.1f}")


if __name__ == "__main__":
    main()
