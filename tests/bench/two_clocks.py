"""The whole loop against two control boxes with a clock each, which drift past each other.

`python tests/bench/two_clocks.py --seconds 60 --phase-us 500 --drift-ppm 50`: a simulated robot in a process of its
own, `rtstack bench loop` as its client, and at the end what the robot saw: the time from each state to its answer, by
its own clock, and the states that were not answered in time. Nothing else should compute meanwhile.
"""

import argparse
import json
import signal
import subprocess
import sys

LEFT, RIGHT, TRACKER = "127.0.78.1", "127.0.78.2", "127.0.0.1:1341"


def main() -> int:
    """Run both, print what each says; the exit status is the loop's."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("--phase-us", type=float, default=500.0)
    parser.add_argument("--drift-ppm", type=float, default=50.0)
    options = parser.parse_args()
    serve = [
        sys.executable,
        "-m",
        "sim_robot.fci",
        "--left",
        LEFT,
        "--right",
        RIGHT,
        "--tracker",
        TRACKER,
        "--cpu",
        "0",
    ]
    serve += ["--phase-us", f"{options.phase_us:g}", "--drift-ppm", f"{options.drift_ppm:g}"]
    loop = [sys.executable, "-m", "rtstack", "bench", "loop", "--cell", f"fci:{LEFT},{RIGHT}"]
    loop += ["--seconds", f"{options.seconds:g}", "--json"]
    with subprocess.Popen(serve, stdout=subprocess.PIPE, text=True) as robot:
        assert robot.stdout is not None
        if not robot.stdout.readline().startswith("serving"):
            raise SystemExit("the simulated robot did not start")
        done = subprocess.run(loop, stdout=subprocess.PIPE, text=True)
        robot.send_signal(signal.SIGINT)
        print("robot:", *robot.stdout.read().splitlines(), sep="\n  ")
    print("loop:", *(f"{name}: {value}" for name, value in json.loads(done.stdout or "{}").items()), sep="\n  ")
    return done.returncode


if __name__ == "__main__":
    sys.exit(main())
