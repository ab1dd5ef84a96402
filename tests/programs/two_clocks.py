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

from rtstack.log.lateness import lateness_of
from rtstack.log.reader import Log, read_log
from rtstack.samples import SIDES
from rtstack.topics import ARM_TOPICS, CYCLE_TOPICS

LEFT, RIGHT, TRACKER = "127.0.78.1", "127.0.78.2", "127.0.0.1:1341"
BINS = 10  # of the ms by which the states of the two arms come apart
SAME_TORQUE_NM = 1e-3  # the wire rounds to float32
SEEN_S = 0.025  # after an answer was missed the robot's success rate shows it


def losses(topics: Log) -> list[str]:
    """Return, a line a bin of the distance between the arms' states: ticks, and lost answers per 10,000."""
    arms = [topics.topic(topic) for topic in ARM_TOPICS]
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


def labels(topics: Log) -> list[str]:
    """Return whose the late cycles were, and how many falls of the robot's success rate have none before them."""
    found = lateness_of(topics)
    if found is None:
        return ["no cycles in the log"]
    start_ns = min(int(topics.topic(topic)["t_ns"][0]) for topic in CYCLE_TOPICS)
    unexplained = falls = 0
    for side, topic in zip(SIDES, ARM_TOPICS, strict=True):
        arm = topics.topic(topic)
        fell_s = 1e-9 * (arm["t_ns"][1:][np.diff(arm["control_command_success_rate"]) < -5e-3] - start_ns)
        late_s = np.array([-np.inf, *(one.t_s for one in found.late if one.side == side)])
        falls += len(fell_s)
        unexplained += int(np.sum(fell_s - late_s[np.searchsorted(late_s, fell_s, side="right") - 1] > SEEN_S))
    labelled = sum(found.shares.values())
    return [
        found.line,
        f"{labelled} of {len(found.late)} late cycles have a label; {unexplained} of {falls} falls of the success rate "
        "have no late cycle before them",
        *found.table,
    ]


def main() -> int:
    """Run both, print what each says; the exit status is the loop's."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("--phase-us", type=float, default=500.0)
    parser.add_argument("--drift-ppm", type=float, default=50.0)
    parser.add_argument("--log", type=Path, help="keep the log here")
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
        log = options.log or Path(folder) / "loop.mcap"
        done = subprocess.run([sys.executable, *loop, str(log)], stdout=subprocess.PIPE, text=True)
        robot.send_signal(signal.SIGINT)
        print("robot:", *robot.stdout.read().splitlines(), sep="\n  ")
        topics = read_log(log) if log.exists() else None
        print("answers lost:", *(losses(topics) if topics else ("no log",)), sep="\n  ")
        print("late cycles:", *(labels(topics) if topics else ("no log",)), sep="\n  ", flush=True)
    print("loop:", *(f"{name}: {value}" for name, value in json.loads(done.stdout or "{}").items()), sep="\n  ")
    return done.returncode


if __name__ == "__main__":
    sys.exit(main())
