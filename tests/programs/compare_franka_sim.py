"""Our two arms with contact, control and logging, turn by turn with franka-sim's one arm in free space.

`python -m tests.programs.compare_franka_sim --rounds 3 --seconds 60`. The rival is installed by name from PyPI, into
an environment of its own (kept in --environment for the next time) and runs as it comes, in its own process, on a
loopback address of its own. Both sides are measured alike, by the client: the time between the states that it gets, and
how far the robot's clock got in the host's time. Nothing else should compute meanwhile.
"""

import argparse
import json
import os
import signal
import subprocess
import sys
import time
import venv
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
import pylibfranka as franka

from hal.realtime import realtime_thread
from hal.robots import FR3

RIVAL = "franka-sim==1.1.7"
RIVAL_ADDRESS = "127.0.77.1"
# its command binds every interface; this is the same server, as the command makes it, on loopback. Its own model is
# downloaded from elsewhere at its first start: it gets ours, whose capsules cost it less than its meshes
RIVAL_PROGRAM = f"""
from franka_sim.franka_sim_server import FrankaSimServer
FrankaSimServer(host={RIVAL_ADDRESS!r}, enable_gripper=False, physics="mujoco").start()
"""
START_S = 60.0
BEST_P99_US, LEAST_FACTOR = 1100.0, 0.999


@dataclass(frozen=True, slots=True)
class Pace:
    """One run of one side. period_us: between states at the client; gaps: states that the client never saw."""

    who: str
    seconds: float
    real_time_factor: float
    period_us_p50: float
    period_us_p99: float
    period_us_max: float
    missed: int


def ours(seconds: float) -> Pace:
    """The whole loop with both arms, as `rtstack bench loop` runs it in its own processes."""
    command = [sys.executable, "-m", "rtstack", "bench", "loop", "--seconds", f"{seconds:g}", "--json"]
    done = subprocess.run(command, stdout=subprocess.PIPE, text=True)
    if not done.stdout.strip():
        raise SystemExit(f"our loop printed nothing and ended with {done.returncode}")
    figures = json.loads(done.stdout)
    if not figures["success"]:
        print(f"  our run failed: {figures['failure_reason']}")
    return Pace(
        "rtstack, two arms", figures["seconds"], figures["real_time_factor"], figures["period_us_p50"],
        figures["period_us_p99"], figures["period_us_max"], figures["missed_deadlines"],
    )  # fmt: skip


def rival(folder: Path, seconds: float) -> Pace:
    """One arm of franka-sim, held by a joint impedance in a thread that is scheduled as our loop is."""
    with _rival_server(folder), realtime_thread():
        return _hold(RIVAL_ADDRESS, round(1e3 * seconds))


@contextmanager
def _rival_server(folder: Path) -> Iterator[None]:
    command = [str(folder / "bin" / "python"), "-c", RIVAL_PROGRAM]
    arm = folder / "fr3.urdf"
    arm.write_text(FR3.urdf)
    process = subprocess.Popen(
        command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, cwd=folder, start_new_session=True,
        env=os.environ | {"FR3_MJCF": str(arm)},
    )  # fmt: skip
    try:
        _wait_for(RIVAL_ADDRESS, process)
        yield
    finally:
        with suppress(ProcessLookupError):
            os.killpg(process.pid, signal.SIGKILL)
        process.wait()


def _wait_for(address: str, process: subprocess.Popen) -> None:
    end_s = time.monotonic() + START_S
    while time.monotonic() < end_s:
        if process.poll() is not None:
            raise SystemExit(f"the rival's server ended with {process.returncode}")
        try:
            franka.Robot(address, franka.RealtimeConfig.kIgnore).read_once()
        except franka.NetworkException:
            time.sleep(0.2)
        else:
            time.sleep(1.0)  # until it has let go of that client
            return
    raise SystemExit("the rival's server did not serve")


def _hold(address: str, ticks: int) -> Pace:
    robot = franka.Robot(address, franka.RealtimeConfig.kIgnore)
    q_hold = np.array(robot.read_once().q)
    came_ns, ids = np.zeros(ticks, dtype=np.int64), np.zeros(ticks, dtype=np.int64)
    control = robot.start_torque_control()
    for tick in range(ticks):
        state, _ = control.readOnce()
        came_ns[tick], ids[tick] = time.perf_counter_ns(), round(1e3 * state.time.to_sec())
        command = franka.Torques((100.0 * (q_hold - state.q) - 10.0 * np.array(state.dq)).tolist())
        command.motion_finished = tick == ticks - 1
        control.writeOnce(command)
    period_us = np.diff(came_ns) * 1e-3
    elapsed_ms = (came_ns[-1] - came_ns[0]) * 1e-6
    return Pace(
        "franka-sim, one arm", round(1e-3 * float(ids[-1] - ids[0]), 3),
        round(float(ids[-1] - ids[0]) / elapsed_ms, 5), *np.percentile(period_us, (50, 99, 100)).round(1).tolist(),
        int(np.maximum(np.diff(ids) - 1, 0).sum()),
    )  # fmt: skip


def install(folder: Path) -> None:
    """Install the rival unless it is there."""
    if not (folder / "bin" / "run-franka-sim-server").exists():
        venv.create(folder, with_pip=True)
        subprocess.run([folder / "bin" / "python", "-m", "pip", "install", "--quiet", RIVAL], check=True)


def main() -> int:
    """Alternate, print a table, and say whether ours is no worse; exit status 1 when it is, or misses its own marks."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("--environment", type=Path, default=Path.home() / ".cache" / "rtstack" / "franka-sim")
    parser.add_argument("--json", action="store_true")
    options = parser.parse_args()
    install(options.environment)
    runs: list[tuple[Pace, Pace]] = []
    for _ in range(options.rounds):
        runs.append((ours(options.seconds), rival(options.environment, options.seconds)))
        for pace in runs[-1]:
            print(
                f"{pace.who:20} {pace.seconds:7.2f} s  {pace.real_time_factor:.4f} of real time  period p50 "
                f"{pace.period_us_p50:6.0f}  p99 {pace.period_us_p99:6.0f}  max {pace.period_us_max:7.0f} us  "
                f"missed {pace.missed}",
                file=sys.stderr if options.json else sys.stdout, flush=True,
            )  # fmt: skip
    good = all(a.real_time_factor >= LEAST_FACTOR and a.period_us_p99 <= BEST_P99_US for a, _ in runs)
    factor, p99 = ([[getattr(p, n) for p in pair] for pair in runs] for n in ("real_time_factor", "period_us_p99"))
    no_worse = np.median(np.array(factor), axis=0), np.median(np.array(p99), axis=0)
    better = bool(no_worse[0][0] >= no_worse[0][1] and no_worse[1][0] <= no_worse[1][1])
    if options.json:
        print(json.dumps({"runs": [[asdict(p) for p in pair] for pair in runs], "marks": good, "no_worse": better}))
    else:
        print(f"own marks {'held' if good else 'missed'}; {'no worse' if better else 'worse'} than the rival (medians)")
    return 0 if good and better else 1


if __name__ == "__main__":
    sys.exit(main())
