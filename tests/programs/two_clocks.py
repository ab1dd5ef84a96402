"""The whole loop against two control boxes with a clock each, which drift past each other.

`python -m tests.programs.two_clocks --seconds 60 --phase-us 500 --drift-ppm 50`: a simulated robot in a process of its
own, `rtstack bench loop` as its client, and at the end what the robot saw: the time from each state to its answer, by
its own clock, and the states that were not answered in time. The log then tells at which distance of the two clocks
answers were lost: where one arm costs the other one's packets, it is where their states come together; what the host
costs is spread over all distances. Nothing else should compute meanwhile.
"""

import argparse
import json
import signal
import subprocess
import sys
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from rtstack.log.reader import read_log
from rtstack.samples import SIDES

LEFT, RIGHT, TRACKER = "127.0.78.1", "127.0.78.2", "127.0.0.1:1341"
BINS = 10  # of the ms by which the states of the two arms come apart
SAME_TORQUE_NM = 1e-3  # the wire rounds to float32


def losses(log: Path) -> list[str]:
    """Return, a line a bin of the distance between the arms' states: ticks, and lost answers per 10,000."""
    topics = read_log(log)
    arms = [topics.topic(f"/{side}/arm") for side in SIDES]
    skew_us = topics.topic("/timing")["pair_skew_us"]
    lost = np.zeros(len(skew_us), dtype=bool)
    for arm in arms:
        lost[1:] |= np.abs(arm["tau_J_d"][1:] - arm["tau_applied"][:-1]).max(axis=1) > SAME_TORQUE_NM
    bins = np.minimum(skew_us * BINS / 1000.0, BINS - 1).astype(int)
    return [
        f"{100 * k:3d}-{100 * (k + 1)} us apart: {np.sum(bins == k):6d} ticks, "
        f"{1e4 * np.mean(lost[bins == k]) if np.any(bins == k) else 0.0:5.1f} lost in 10,000"
        for k in range(BINS)
    ]


def main() -> int:
    """Run both, print what each says; the exit status is the loop's."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("--phase-us", type=float, default=500.0)
    parser.add_argument("--drift-ppm", type=float, default=50.0)
    options = parser.parse_args()
    serve = f"-m sim_robot.fci --left {LEFT} --right {RIGHT} --tracker {TRACKER} --cpu 0".split()
    serve += f"--phase-us {options.phase_us:g} --drift-ppm {options.drift_ppm:g}".split()
    loop = f"-m rtstack bench loop --cell fci:{LEFT},{RIGHT} --seconds {options.seconds:g} --json --log".split()
    with (
        TemporaryDirectory() as folder,
        subprocess.Popen([sys.executable, *serve], stdout=subprocess.PIPE, text=True) as robot,
    ):
        assert robot.stdout is not None
        if not robot.stdout.readline().startswith("serving"):
            raise SystemExit("the simulated robot did not start")
        log = Path(folder) / "loop.mcap"
        done = subprocess.run([sys.executable, *loop, str(log)], stdout=subprocess.PIPE, text=True)
        robot.send_signal(signal.SIGINT)
        print("robot:", *robot.stdout.read().splitlines(), sep="\n  ")
        print("answers lost:", *(losses(log) if log.exists() else ("no log",)), sep="\n  ")
    print("loop:", *(f"{name}: {value}" for name, value in json.loads(done.stdout or "{}").items()), sep="\n  ")
    return done.returncode


if __name__ == "__main__":
    sys.exit(main())
