"""A policy that sees by a camera: it finds the box in the picture, and grabs it where it stands. No tracker is asked.

Its way to the box comes from the package `examples/learned_grab`: `pip install examples/learned_grab` first.

python 12_policy_that_looks.py
"""

from contextlib import closing
from pathlib import Path

import numpy as np
from learned_grab.scripted import scripted_way

from hal.displacement import Displacement
from rtstack.cells import default_cell_file, load_description, open_cell
from rtstack.log.reader import read_log
from rtstack.trials.record import open_log
from rtstack.trials.run_context import RunContext
from rtstack.trials.specification import TeleoperationSpecification
from rtstack.trials.teleoperation import run_policy

CAMERA = """
[cameras.above]
kind = "simulated"
position = [0.0, 0.0, 1.6]
orientation_wxyz = [0.0, 0.7071, 0.7071, 0.0] # it looks down; to the picture's right is the world's y
width = 384
height = 288
rate_hz = 10.0
"""
TOP_M = 0.4  # of the box's upper face, above the floor


def place_in(rgb, camera):
    """Return x and y of the yellow thing in a picture (rows, columns, 3), m in the world."""
    red, _, blue = np.moveaxis(rgb.astype(int), -1, 0)
    rows, columns = np.nonzero(red - blue > 100)
    u, v = 0.5 * (columns.min() + columns.max()), 0.5 * (rows.min() + rows.max())
    fx, _, cx, _, fy, cy, *_ = camera.K
    depth = camera.position[2] - TOP_M
    return camera.position[0] + (v - cy) / fy * depth, camera.position[1] + (u - cx) / fx * depth


class Looks:
    """Looks once, at its first observation, and goes the way to what it saw."""

    def __init__(self, camera):
        self._camera, self._way, self.saw = camera, None, None

    def act(self, observation):
        if self._way is None:
            self.saw = x, y = place_in(observation.pictures["above"].rgb, self._camera)
            self._way = scripted_way(0, Displacement(x, y))
        return self._way.act(observation)

    def close(self):
        pass


if __name__ == "__main__":
    file = Path("looking.toml")
    file.write_text(default_cell_file().read_text() + CAMERA)
    description, _ = load_description(file)
    policy = Looks(description.cameras["above"])
    asked = TeleoperationSpecification("a policy that looks")
    with closing(open_cell("direct", asked.object, Displacement.given(40.0, -20.0), 0, description)) as cell:
        log = open_log(Path("looking.mcap"), asked, description, cell.name, file, cell=cell, overwrite=True)
        result = run_policy(policy, asked, description, cell, RunContext(log))
    z = read_log(Path("looking.mcap")).topic("/object/pose")["position"][:, 2]
    print(f"saw the box {1e3 * policy.saw[0]:.0f} mm ahead and {1e3 * policy.saw[1]:.0f} mm to the left of its place")
    print(f"{result.failure_reason or 'success'}: lifted by {1e3 * (z.max() - z[0]):.0f} mm")
