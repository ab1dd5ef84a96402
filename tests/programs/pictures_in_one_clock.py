"""How well pictures and samples share a clock, and what cameras take from the loop: long grabs in real time, with two
cameras and without by turns.

    python -m tests.programs.pictures_in_one_clock [--seconds 20] [--rounds 4] --out DIR

Says of each camera how many pictures the log has, and how far the time that is drawn into one is from its stamp at
most; of the loop how long it computed and how many deadlines it missed; and how much of it the cameras are. Exit status
1 where a drawn time is more than 1 ms off. Nothing else should compute meanwhile, unless only the clock is looked at
(--rounds 0: one run, with cameras).
"""

import argparse
import io
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
from PIL import Image

from rtstack.bench.loop import SHORTEST_S, LoopBenchmark, long_grab, loop_figures
from rtstack.cameras.source import read_time
from rtstack.cells import load_description, open_cell
from rtstack.log.reader import read_log
from rtstack.model.cell_description import CameraDescription
from rtstack.trials.demonstration import run_demonstration
from rtstack.trials.record import open_log
from rtstack.trials.run_context import RunContext
from rtstack.trials.specification import DemonstrationSpecification
from rtstack.trials.start_motion import start_motion

DOWN = CameraDescription("simulated", (0.1, 0.0, 1.6), (0.0, 0.7071, 0.7071, 0.0), width=384, height=288, stamped=True)
CAMERAS = {"down": DOWN, "front": replace(DOWN, position=(1.4, 0.0, 0.5), orientation_wxyz=(0.5, -0.5, -0.5, 0.5))}
MOST_MS = 1.0


def run(out: Path, kind: str, seconds: float, cameras: dict[str, CameraDescription]) -> LoopBenchmark:
    """Grab the box, carry it for so long, and put it down; return the figures of the log `out`. Says what has failed, a
    stall of this machine as a rule, and tries again twice."""
    description, source = load_description(None)
    described, asked = replace(description, cameras=cameras), DemonstrationSpecification()
    for _ in range(3):
        cell = open_cell(kind, asked.object, 0.0, asked.seed, described)
        try:
            way = start_motion(cell, described, asked.object)
            context = RunContext(open_log(out, asked, described, kind, source, overwrite=True, cell=cell))
            result = run_demonstration(asked, described, cell, context, way=way, script=long_grab(seconds))
        finally:
            cell.close()
        if result.success:
            return loop_figures(out, kind, True, None)
        print(f"a run has failed: {result.failure_reason}", flush=True)
    raise SystemExit(1)


def look(path: Path, seconds: float) -> float:
    """Say what a log of so many seconds has of each camera; return how far a time is from its stamp at most, ms."""
    log = read_log(path)
    worst_ms = 0.0
    for camera in CAMERAS:
        shown = log.pictures(f"/camera/{camera}/image")
        off_ms = [1e-6 * abs(read_time(np.array(Image.open(io.BytesIO(jpeg)))) - t_ns) for t_ns, jpeg in shown]
        worst_ms = max(worst_ms, *off_ms)
        wanted = int(seconds * DOWN.rate_hz) + 1
        print(f"  {camera}: {len(shown)} of {wanted} pictures, at most {max(off_ms):.3f} ms off", flush=True)
    for event in log.events:
        if event.name == "camera":
            print(f"  {event.text}", flush=True)
    return worst_ms


def main() -> int:
    """Run by turns, and say what came out."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seconds", type=float, default=20.0, help="of the robot, a run")
    parser.add_argument("--rounds", type=int, default=4, help="of one run without cameras and one with them")
    parser.add_argument("--cell", default="realtime")
    parser.add_argument("--out", type=Path, required=True)
    asked = parser.parse_args()
    asked.out.mkdir(parents=True, exist_ok=True)
    found: dict[str, list[LoopBenchmark]] = {"without": [], "with": []}
    worst_ms = 0.0
    run(asked.out / "first.mcap", "direct", SHORTEST_S, {})  # what is not compiled yet is now
    for k in range(max(1, asked.rounds)):
        for name in ("with",) if not asked.rounds else ("without", "with") if k % 2 == 0 else ("with", "without"):
            path = asked.out / f"{name}.mcap"
            one = run(path, asked.cell, asked.seconds, CAMERAS if name == "with" else {})
            found[name].append(one)
            print(
                f"{name} cameras: {one.seconds:.1f} s, compute p50 {one.compute_us_p50:.0f} us, p99 "
                f"{one.compute_us_p99:.0f} us, period p99 {one.period_us_p99:.0f} us, {one.missed_deadlines} of "
                f"{one.ticks} deadlines missed",
                flush=True,
            )
            if name == "with":
                worst_ms = max(worst_ms, look(path, one.seconds))
    for name in ("compute_us_p50", "compute_us_p99", "period_us_p99") if asked.rounds else ():
        ratios = [getattr(b, name) / getattr(a, name) for a, b in zip(found["without"], found["with"], strict=True)]
        shown = ", ".join(f"{ratio:.3f}" for ratio in ratios)
        print(f"{name}: with / without {np.median(ratios):.3f}, median of {shown}")
    for name, runs in found.items():
        print(f"{name} cameras: {sum(one.missed_deadlines for one in runs)} deadlines missed in {len(runs)} runs")
    return int(worst_ms > MOST_MS)


if __name__ == "__main__":
    sys.exit(main())
