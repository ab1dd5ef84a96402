"""Our simulated robot and tick beside other authors', as PyPI has them, in one table.

franka-sim and franky-sim are installed by name into environments of their own (.venv-foreign); mink is here. One client
does the same to each robot, one robot at a time, on loopback: it holds an arm, moves it, and provokes it. What another
one does better stands first in the table. Nothing else should compute meanwhile. Exit status 2, with one line, where
one cannot be installed, does not serve, or ends the hold.

Takes some minutes, on a quiet machine.
"""

import re
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from importlib.metadata import version
from pathlib import Path
from statistics import median
from typing import Annotated

import numpy as np
import psutil
import pylibfranka as franka
import typer

from hal.base.files import write_whole
from hal.base.realtime import realtime_thread
from tests.programs import program
from tests.programs.tick_beside_mink import beside_mink
from tests.support.fci.client import connect, hold, torque_control
from tests.support.foreign_robot import VERSIONS, addresses, environment, foreign_command, wait_for

OURS, PEERS = "rtstack", ("franka-sim", "franky-sim")
MOVE_RAD = np.array([0.02, 0.0, 0.02, 0.0, 0.1, 0.1, 0.1])  # near where each robot begins: the wrist
JUMP_NM = 40.0
NO_FIELDS = ("current_errors", "last_motion_errors", "robot_mode", "time")
LOW, HIGH = 0.5, 100.0  # thresholds, Nm and N: what is above the lower one is shown as contact


@dataclass(slots=True)
class Robot:
    """What was measured of one: figures by row, fields that stay empty, what each provocation ended with."""

    figures: dict[str, float] = field(default_factory=dict)
    empty: tuple[str, ...] = ()
    fields: int = 0
    ended: dict[str, str] = field(default_factory=dict)


@contextmanager
def serving(name: str, folder: Path) -> Iterator[tuple[str, psutil.Process, float]]:
    """Serve one robot; give the address of its (left) arm, its process, and the seconds until it answered."""
    address, other = addresses()
    if name == OURS:
        command = [sys.executable, "-m", "rtstack", "sim", "--left", address, "--right", other]
    else:
        command = foreign_command(name, address, folder, slowness=1.0)
    said = folder / "said.txt"
    with open(said, "wb") as output:
        began = time.monotonic()
        process = subprocess.Popen(command, stdout=output, stderr=output, cwd=folder)
        try:
            wait_for(address, process, said)
            took_s = time.monotonic() - began
            time.sleep(1.0)  # until it has let go of that client
            yield address, psutil.Process(process.pid), took_s
        finally:
            process.kill()
            process.wait()


def held(robot: franka.Robot, process: psutil.Process, seconds: float) -> dict[str, float]:
    """Hold the arm by a joint impedance; return what the client saw of the robot's clock, and what the server took."""
    ticks = round(1e3 * seconds)
    came_ns, ids = np.zeros(ticks, dtype=np.int64), np.zeros(ticks, dtype=np.int64)
    q_hold = np.array(robot.read_once().q)

    def law(tick: int, state: franka.RobotState) -> np.ndarray:
        came_ns[tick], ids[tick] = time.perf_counter_ns(), round(1e3 * state.time.to_sec())
        return hold(state, q_hold)

    before = sum(process.cpu_times()[:2])
    with realtime_thread():
        torque_control(robot, ticks, law)
    robots_s = 1e-3 * float(ids[-1] - ids[0])
    period_us = np.diff(came_ns) * 1e-3
    return {
        "link: robot's seconds in a second": robots_s / (1e-9 * float(came_ns[-1] - came_ns[0])),
        "link: period of states, p99, us": float(np.percentile(period_us, 99)),
        "link: states that did not reach the client, of 1000": 1e3 * float((np.diff(ids) - 1).sum()) / ticks,
        "server: CPU seconds a robot's second": (sum(process.cpu_times()[:2]) - before) / robots_s,
        "server: memory, MB": process.memory_info().rss / 1e6,
    }


def state_fields(robot: franka.Robot) -> dict[str, bool]:
    """Move with a load and frames of one's own; return which fields were ever other than zero or identity."""
    robot.set_collision_behavior([LOW] * 7, [HIGH] * 7, [LOW] * 6, [HIGH] * 6)
    robot.set_load(0.2, [0.0, 0.0, 0.05], np.diag([1e-3] * 3).ravel().tolist())
    shifted = np.eye(4)
    shifted[2, 3] = 0.05  # in columns on the wire
    for set_frame in (robot.set_EE, robot.set_K):
        set_frame(shifted.T.ravel().tolist())
    start = np.array(robot.read_once().q_d)
    states = []
    for motion in (_by_positions, _by_torques):
        states += motion(robot, start)
    names = [n for n in dir(states[0]) if not n.startswith("_") and n not in NO_FIELDS]
    kinds = {n: np.array([np.ravel(np.asarray(getattr(s, n), dtype=float)) for s in states]) for n in names}
    return {name: bool((values != _nothing(values.shape[1])).any()) for name, values in kinds.items()}


def _nothing(size: int) -> np.ndarray:
    return np.eye(4).ravel() if size == 16 else np.zeros(size)


def _by_positions(robot: franka.Robot, start: np.ndarray) -> list[franka.RobotState]:
    control = robot.start_joint_position_control(franka.ControllerMode.JointImpedance)
    states = []
    for tick in range(1001):
        states.append(control.readOnce()[0])
        goal = start + 0.5 * MOVE_RAD * (1.0 - np.cos(2.0 * np.pi * 1e-3 * tick))
        command = franka.JointPositions(goal.tolist())
        command.motion_finished = tick == 1000
        control.writeOnce(command)
    return states


def _by_torques(robot: franka.Robot, start: np.ndarray) -> list[franka.RobotState]:
    def law(tick: int, state: franka.RobotState) -> np.ndarray:
        return hold(state, start + 0.5 * MOVE_RAD * (1.0 - np.cos(2.0 * np.pi * 1e-3 * tick)))

    return torque_control(robot, 1000, law)


def _torque_jump(robot: franka.Robot) -> None:
    q = np.array(robot.read_once().q)
    torque_control(robot, 400, lambda tick, state: hold(state, q) + (JUMP_NM if tick == 200 else 0.0) * np.eye(7)[0])


def _positions(robot: franka.Robot, offset: Callable[[int], float]) -> None:
    control = robot.start_joint_position_control(franka.ControllerMode.JointImpedance)
    start = np.array(control.readOnce()[0].q_d)
    for tick in range(400):
        control.writeOnce(franka.JointPositions((start + offset(tick)).tolist()))
        control.readOnce()


def _velocities(robot: franka.Robot) -> None:
    control = robot.start_joint_velocity_control(franka.ControllerMode.JointImpedance)
    for tick in range(400):
        control.readOnce()
        control.writeOnce(franka.JointVelocities([0.0] * 6 + [2.0 if tick > 100 else 0.0]))


def _pose_jump(robot: franka.Robot) -> None:
    control = robot.start_cartesian_pose_control(franka.ControllerMode.JointImpedance)
    pose = list(control.readOnce()[0].O_T_EE_d)
    for tick in range(400):
        pose[14] += 0.05 * (tick == 100)
        control.writeOnce(franka.CartesianPose(pose))
        control.readOnce()


def _silence(robot: franka.Robot) -> None:
    q = np.array(robot.read_once().q)

    def law(tick: int, state: franka.RobotState) -> np.ndarray:
        time.sleep(0.1 if tick == 100 else 0.0)
        return hold(state, q)

    torque_control(robot, 400, law)


def _push(robot: franka.Robot) -> None:
    """Towards the upper end of joint 7, within the torque's rate."""
    q = np.array(robot.read_once().q)
    others = np.diag([1.0] * 6 + [0.0])
    torque_control(
        robot, 4000, lambda tick, state: others @ hold(state, q) + min(0.02 * tick, 4.0) * np.eye(7)[6]
    )  # fmt: skip


def _low_threshold(robot: franka.Robot) -> None:
    """What the arm is said to feel while it is pushed by its own motion exceeds the threshold."""
    robot.set_collision_behavior([0.01] * 7, [0.02] * 7, [0.01] * 6, [0.02] * 6)
    _by_torques(robot, np.array(robot.read_once().q))


PROVOCATIONS: dict[str, Callable[[franka.Robot], None]] = {
    "torque of joint 1 jumps by 40 Nm": _torque_jump,
    "joint positions jump by 0.05 rad": lambda robot: _positions(robot, lambda tick: 0.05 * (tick > 100)),
    "first joint position 0.3 rad from where the arm is": lambda robot: _positions(robot, lambda tick: 0.3),
    "velocity of joint 7 jumps to 2 rad/s": _velocities,
    "pose jumps by 5 cm": _pose_jump,
    "client silent for 100 ms": _silence,
    "joint 7 pushed to its end with 4 Nm": _push,
    "collision thresholds of 0.02 Nm and N while it moves": _low_threshold,
}


def provoked(robot: franka.Robot, provoke: Callable[[franka.Robot], None]) -> str:
    """Return the errors that the robot names, "refused" where it only refuses, or "" where it goes on."""
    try:
        provoke(robot)
    except (franka.FrankaException, RuntimeError) as error:  # not all of pylibfranka's are FrankaExceptions
        named = re.findall(r"\w+", " ".join(re.findall(r"\[(.*?)\]", str(error), re.DOTALL)))
        return ", ".join(dict.fromkeys(named)) or f"refused: {str(error).splitlines()[0][:60]}"
    return ""


def measured(name: str, seconds: float, rounds: int) -> Robot:
    """Measure one robot: each provocation meets a server of its own, which no other one has touched."""
    one, runs, starts = Robot(), [], []
    with ExitStack() as stack:
        for number in range(rounds):
            folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))
            with serving(name, folder) as (address, process, took_s):
                starts.append(took_s)
                runs.append(held(connect(address), process, seconds))
                if number == 0:
                    fields = state_fields(connect(address))
                    one.empty = tuple(name for name, full in fields.items() if not full)
                    one.fields = len(fields)
        for what, provoke in PROVOCATIONS.items():
            folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))
            with serving(name, folder) as (address, _, took_s):
                starts.append(took_s)
                one.ended[what] = provoked(connect(address), provoke)
    one.figures = {key: median(run[key] for run in runs) for key in runs[0]}
    one.figures["server: seconds from its start to its first state"] = median(starts)
    one.figures["state: fields that say something"] = one.fields - len(one.empty)
    one.figures["faults: provocations that are noticed"] = sum(bool(said) for said in one.ended.values())
    return one


MORE = ("link: robot's", "state:", "faults:")  # rows where more is better


def table(robots: Mapping[str, Robot], ticks_us: Mapping[str, float]) -> str:
    """Return the page: a row a figure, those first in which another one is better."""
    rows: list[tuple[bool, str]] = []
    for row in robots[OURS].figures:
        values = {name: robot.figures[row] for name, robot in robots.items()}
        best = (max if row.startswith(MORE) else min)(values.values())
        shown = " | ".join(f"**{v:.4g}**" if v == best else f"{v:.4g}" for v in values.values())
        rows.append((values[OURS] == best, f"| {row} | {shown} | |"))
    ours_us, mink_us = ticks_us[OURS], ticks_us["mink"]
    pair = (f"**{us:.4g}**" if us == min(ours_us, mink_us) else f"{us:.4g}" for us in (ours_us, mink_us))
    ours, mink = pair
    rows.append(
        (ours_us <= mink_us, f"| tick of two arms (mink: their kinematics alone), p50, us | {ours} | | | {mink} |")
    )
    versions = [version(OURS), *(VERSIONS[name] for name in PEERS), version("mink")]
    lines = [
        "| | " + " | ".join(f"{n} {v}" for n, v in zip((OURS, *PEERS, "mink"), versions, strict=True)) + " |",
        "|---|" + "---:|" * 4,
        *(line for _, line in sorted(rows, key=lambda row: row[0])),
        "",
        "| provoked by | " + " | ".join(robots) + " |",
        "|---|" + "---|" * len(robots),
    ]
    for what in PROVOCATIONS:
        lines.append(f"| {what} | " + " | ".join(robot.ended[what] or "goes on" for robot in robots.values()) + " |")
    lines.append("")
    for name, robot in robots.items():
        lines.append(f"- {name}: of {robot.fields} fields these stay empty: {', '.join(robot.empty) or 'none'}.")
    return "\n".join(lines) + "\n"


def main(
    seconds: Annotated[float, typer.Option(help="how long each arm is held, each round")] = 10.0,
    rounds: int = 2,
    out: Path = Path("out/compare.md"),
) -> int:
    """Measure, print, and write the page."""
    robots = {}
    try:
        for name in PEERS:
            environment(name)
        for name in (OURS, *PEERS):
            print(f"compare: {name}", file=sys.stderr, flush=True)
            robots[name] = measured(name, seconds, rounds)
    except (franka.FrankaException, RuntimeError) as error:
        lines = str(error).strip().splitlines()
        print(f"compare: {' '.join(dict.fromkeys((lines[0], lines[-1])))}", file=sys.stderr)
        return 2
    print("compare: tick", file=sys.stderr, flush=True)
    text = table(robots, beside_mink(rounds))
    out.parent.mkdir(parents=True, exist_ok=True)
    write_whole(out, text)
    print(text)
    return 0


if __name__ == "__main__":
    program(main)
