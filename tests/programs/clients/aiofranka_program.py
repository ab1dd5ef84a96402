"""aiofranka as its quick start and examples use it: the controller in C++, and the older one in Python.

`python aiofranka_program.py ADDRESS [PART...]` prints a line for each part that went well; without parts, all.
"""

import asyncio
import sys

import aiofranka
import numpy as np
from settling import settles  # beside this file

AWAY = 0.3 * np.array([0.5, -1.0, 0.5, 0.0, 1.0, 1.0, 1.0])


def connect(address: str) -> aiofranka.Robot:
    """Connect; no Desk answers where the robot is simulated."""
    return aiofranka.Robot(address, read_tool=False)


def quick_start(address: str) -> None:
    """A planned motion, then targets at 50 Hz for a joint impedance."""
    with connect(address) as robot, aiofranka.Controller(robot) as controller:
        goal = robot.state["qpos"] + AWAY
        controller.move(goal)
        controller.switch("impedance")
        controller.kp, controller.kd = np.full(7, 80.0), np.full(7, 4.0)
        controller.set_freq(50)
        start = np.array(controller.initial_qpos)
        for tick in range(51):
            controller.set("q_desired", start + 0.1 * np.sin(tick / 50 * np.pi))
        assert settles(lambda: np.abs(robot.state["qpos"] - start).max(), 0.03)
        assert np.abs(start - goal).max() < 0.1


def osc(address: str) -> None:
    """A circle of 20 mm in operational space."""
    with connect(address) as robot, aiofranka.Controller(robot) as controller:
        controller.switch("osc")
        controller.ee_kp, controller.ee_kd = np.array([300.0] * 3 + [1000.0] * 3), np.full(6, 10.0)
        controller.set_freq(50)
        goal = np.array(controller.initial_ee)
        start = goal[:3, 3].copy()
        for angle in np.linspace(0.0, 2 * np.pi, 51):
            goal[:3, 3] = start + 0.02 * np.array([0.0, np.sin(angle), 1.0 - np.cos(angle)])
            controller.set("ee_desired", goal.copy())
        assert settles(lambda: np.linalg.norm(robot.state["ee"][:3, 3] - start), 0.01)


def python_loop(address: str) -> None:
    """The same impedance, its loop on asyncio's."""

    async def run() -> None:
        controller = aiofranka.FrankaController(aiofranka.RobotInterface(address, read_tool=False))
        await controller.start()
        controller.switch("impedance")
        controller.set_freq(50)
        start = np.array(controller.initial_qpos)
        for tick in range(51):
            await controller.set("q_desired", start + 0.05 * np.sin(tick / 50 * np.pi))
        assert np.abs(controller.robot.state["qpos"] - start).max() < 0.1
        await controller.stop()

    asyncio.run(run())


PARTS = {part.__name__: part for part in (quick_start, osc, python_loop)}


if __name__ == "__main__":
    for name in sys.argv[2:] or PARTS:
        PARTS[name](sys.argv[1])
        print(name, flush=True)
