"""How well pictures and samples share a clock: a simulated cell moves for so long, with two cameras and without.

    python -m tests.programs.pictures_in_one_clock --seconds 120 --out DIR

Says of each camera how many pictures the log has, and how far the time that is drawn into one is from its stamp at
most; and of the loop how long it computed, with the cameras beside it and without.
"""

import argparse
import io
from dataclasses import replace
from pathlib import Path

import numpy as np
from PIL import Image

from rtstack.cameras.source import read_time
from rtstack.cells import default_cell_file, load_description, open_cell
from rtstack.log.reader import read_log
from rtstack.model.cell_description import CameraDescription
from rtstack.teleoperation.policy import Chunk
from rtstack.trials.policy import run_policy
from rtstack.trials.record import open_log
from rtstack.trials.run_context import RunContext
from rtstack.trials.specification import TeleoperationSpecification

DOWN = CameraDescription("simulated", (0.1, 0.0, 1.6), (0.0, 0.7071, 0.7071, 0.0), width=384, height=288, stamped=True)
CAMERAS = {"down": DOWN, "front": replace(DOWN, position=(1.4, 0.0, 0.5), orientation_wxyz=(0.5, -0.5, -0.5, 0.5))}


class Wave:
    """A policy that moves both pads up and down, 5 cm, once in 4 s."""

    def __init__(self) -> None:
        self._begin: np.ndarray | None = None

    def act(self, observation):
        self._begin = observation.pose_ref.copy() if self._begin is None else self._begin
        t_s = observation.t_s + 0.05 * np.arange(1, 11)
        poses = np.repeat(self._begin[None], 10, axis=0)
        poses[:, :, 2] += (0.05 * (1.0 - np.cos(0.5 * np.pi * t_s)) / 2.0)[:, None]
        return Chunk(0.05, poses)

    def close(self) -> None:
        pass


def run(out: Path, seconds: float, cameras: dict[str, CameraDescription]) -> Path:
    """Move for so long; return the log."""
    description, _ = load_description(None)
    asked = TeleoperationSpecification("wave")
    cell = open_cell("direct", "rice_box", 0.0, 0)
    described = replace(description, cameras=cameras)
    log = open_log(out, asked, described, "direct", default_cell_file(), overwrite=True, cell=cell)
    try:
        run_policy(Wave(), asked, described, cell, RunContext(log), longest_s=seconds)
    finally:
        cell.close()
    return out


def main() -> None:
    """Run both, and say what came out."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=60.0, help="of the robot")
    parser.add_argument("--out", type=Path, required=True)
    asked = parser.parse_args()
    asked.out.mkdir(parents=True, exist_ok=True)
    for name, cameras in (("without", {}), ("with", CAMERAS)):
        log = read_log(run(asked.out / f"{name}.mcap", asked.seconds, cameras))
        compute = log.topic("/timing")["compute_us"]
        p50, p99 = np.percentile(compute, [50, 99])
        print(
            f"{name} cameras: {log.duration_s:.1f} s, compute p50 {p50:.0f} us, p99 {p99:.0f} us, {len(compute)} ticks"
        )
        for camera in cameras:
            shown = log.pictures(f"/camera/{camera}/image")
            off = [abs(read_time(np.array(Image.open(io.BytesIO(jpeg)))) - t_ns) for t_ns, jpeg in shown]
            wanted = int(log.duration_s * 30.0) + 1
            print(f"  {camera}: {len(shown)} of {wanted} pictures, at most {max(off) * 1e-6:.3f} ms off")
        for event in log.events:
            if event.name == "camera":
                print(f"  {event.text}")


if __name__ == "__main__":
    main()
