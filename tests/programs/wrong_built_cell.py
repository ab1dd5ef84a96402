"""`python -m tests.programs.wrong_built_cell`: demonstrations and trials before and after a calibration, a table.

A simulated cell (lockstep, over the wire) is built otherwise than its file says, and the file says that its arms are
not simulated: they are treated as real ones, with a person at the terminal. A demonstration and a trial of it, with no
calibration in the file, and with one that nobody made; a person touches twelve places with each pad; `rtstack calibrate
--write`; both again. Where the pads really are, MuJoCo says, not our kinematics; a touch has 0.3 mm of noise along each
axis. The bases are too high, not too low: home has to stay inside of the judge's box.
"""

import argparse
import json
import re
import socket
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np

from hal.configuration import toml_text
from rtstack.calibration.points import Point, save_points
from sim_robot.cell import SimulatedCell, simulated_cell
from sim_robot.profile import load_profile
from tests.support.fci.server import addresses, serve
from tests.support.real_cell import CALIBRATED, write_cell_file
from tests.support.terminal import Terminal

COMMAND = Path(sys.executable).with_name("rtstack")
NOISE_M, OBJECT = 3e-4, "rice_box"
WAY_MS, POSES = 900, 12
CASES: dict[str, dict[str, object]] = {
    "as the file says": {},
    "bases 40 and 30 mm off": {"left_mm": [25.0, -28.0, 14.0], "right_mm": [-20.0, 18.0, 13.0]},
    "bases 20 mm higher, turned by 4 and 3 deg": {
        "left_mm": [0.0, 0.0, 20.0], "right_mm": [0.0, 0.0, 20.0],
        "left_deg": [1.5, -1.0, 3.5], "right_deg": [-1.0, 1.2, -2.6],
    },
    "tracker's body 112 mm beside the object's middle": {"pivot_mm": [60.0, -30.0, 90.0]},
    "tracker 0.5 m and 90 deg": {"tracker_mm": [300.0, -400.0, 50.0], "tracker_deg": [0.0, 0.0, 90.0]},
    "all of these": {
        "left_mm": [25.0, -28.0, 24.0], "right_mm": [-20.0, 18.0, 23.0], "left_deg": [1.5, -1.0, 3.5],
        "right_deg": [-1.0, 1.2, -2.6], "tracker_mm": [300.0, -400.0, 50.0], "tracker_deg": [0.0, 0.0, 90.0],
        "pivot_mm": [60.0, -30.0, 90.0],
    },
    "sides swapped": {"swapped": True},
}  # fmt: skip


def profile(path: Path, built: dict[str, object]) -> Path:
    """Write the ideal profile of a cell that was built so."""
    from importlib.resources import files

    text = (files("sim_robot") / "parameters/profiles/ideal.toml").read_text(encoding="utf-8")
    path.write_text(text + toml_text({"built": built}), encoding="utf-8")
    return path


def led(cell: SimulatedCell, homes: np.ndarray, rng: np.random.Generator) -> None:
    """Lead both arms to a posture near home, and let them come to rest."""
    start = cell.states["q"].copy()
    goal = homes + rng.uniform(-0.4, 0.4, (2, 7))
    goal[:, 1] -= 0.3  # above the table
    for k in range(WAY_MS + 300):
        share = min(1.0, k / WAY_MS)
        for side in (0, 1):
            cell.plant.track(side, start[side] + share * (goal[side] - start[side]), np.zeros(7))
        cell.next_state()


def touched(file: Path, built: dict[str, object], tracked: bool) -> dict[str, Point]:
    """Return what is measured in the cell that was built so: twelve places of each pad, and of a marker on it; and
    three times where the tracker sees the object that stands in its place."""
    wire = {key: value for key, value in built.items() if not key.startswith(("tracker", "pivot"))}
    cell = simulated_cell("none", 0.0, 1, profile=str(profile(file, wire)))
    rng, data, points = np.random.default_rng(1), cell.plant.data, {}
    homes = cell.states["q"].copy()
    there, scene = load_profile(str(profile(file.with_stem("tracked"), built))).built, cell.scene
    middle = np.array([0.0, 0.0, scene.table.top_z + scene.objects[OBJECT].size[2] / 2.0])
    for k in range(3 if "pivot_mm" in built else 0):
        seen = there.to_tracker(there.body(middle, np.array([1.0, 0.0, 0.0, 0.0]))) + NOISE_M * rng.standard_normal(3)
        points[f"stands-{k}"] = Point("stand", place=tuple(seen.tolist()), object=OBJECT)
    for k in range(POSES):
        led(cell, homes, rng)
        left, right = (tuple(row) for row in cell.states["q"].tolist())
        for side, name in enumerate(("left", "right")):
            body, face = cell.plant.pad_bodies[side], cell.plant.face_in_pad[side]
            place = data.xpos[body] + data.xmat[body].reshape(3, 3) @ face + NOISE_M * rng.standard_normal(3)
            points[f"{name}-{k}"] = Point("touch", name, tuple(place.tolist()), left, right)
            if tracked:
                seen = there.to_tracker(data.xpos[body]) + NOISE_M * rng.standard_normal(3)
                points[f"{name}-marker-{k}"] = Point("see", name, tuple(seen.tolist()), left, right)
    return points


class Cell:
    """The addresses of a cell, and its file."""

    def __init__(self, folder: Path) -> None:
        self.file, self._addresses = folder / "cell.toml", addresses()
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as free:
            free.bind(("127.0.0.1", 0))
            self._tracker = "{}:{}".format(*free.getsockname())
        text = write_cell_file(self.file, *self._addresses, self._tracker)
        self.file.write_text(f"{text}\n[tracker.bodies.{OBJECT}]\nid = 1\n", encoding="utf-8")

    def believed(self, it_is: bool) -> None:
        """Write a calibration into the file that nobody has made, or take it out."""
        text = self.file.read_text(encoding="utf-8").replace(CALIBRATED, "")
        self.file.write_text(text + (CALIBRATED if it_is else ""), encoding="utf-8")

    def runs(self, how: Path) -> str:
        """Make a demonstration and a trial of it, and return the outcome in a few words."""
        left, right = self._addresses
        where = ["--cell", f"fci:{left},{right}", "--cell-file", str(self.file), "--json"]
        robot = ("--lockstep", "--profile", str(how), "--tracker", self._tracker, "--left", left, "--right", right)
        with tempfile.TemporaryDirectory() as folder:
            reference = f"{folder}/taught.mcap"
            for kind, command in (
                ("demonstration", ["teach", reference]),
                ("trial", ["trial", "--reference", reference]),
            ):
                with serve(*robot):
                    status, said, printed = at_a_terminal([str(COMMAND), *command, *where])
                if status == 2:
                    (line,) = re.findall(r"rtstack: (.*)\r?\n", said)
                    return f"{kind} refused: {line.partition(f'{self.file} ')[2] or line}"[:110].strip()
                result = json.loads(printed)
                if not result["success"]:
                    return f"{kind} failed: {result['failure_reason']}"[:110]
        return "success"


def at_a_terminal(command: list[str]) -> tuple[int, str, str]:
    """Run a command at whose terminal a person holds the space bar; return its status, what it says and prints."""
    terminal = Terminal()
    ends = terminal.theirs
    process = subprocess.Popen(command, stdin=ends, stderr=ends, stdout=subprocess.PIPE, text=True)
    terminal.hold()
    printed, _ = process.communicate()
    return process.returncode, terminal.said, printed


def before_and_after(built: dict[str, object], folder: Path) -> tuple[str, str, str, str]:
    """Return the outcome before, the one with a calibration that is made up, what the calibration says, and the
    outcome after it."""
    cell, how = Cell(folder), profile(folder / "built.toml", built)
    cell.believed(False)
    first = cell.runs(how)
    cell.believed(True)
    made_up = cell.runs(how)
    cell.believed(False)
    save_points(folder / "points.toml", touched(folder / "touched.toml", built, "tracker_mm" in built))
    command = [
        str(COMMAND),
        "calibrate",
        str(folder / "points.toml"),
        "--cell-file",
        str(cell.file),
        "--write",
        "--json",
    ]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode == 2:
        said = done.stderr.strip().removeprefix("rtstack: ").partition(": ")[2][:60]
        # the cables are exchanged, and what was touched with the one arm is the other's
        how = profile(folder / "exchanged.toml", {})
        save_points(folder / "points.toml", touched(folder / "right.toml", {}, False))
        done = subprocess.run(command, capture_output=True, text=True, check=True)
        return first, made_up, said, f"{cell.runs(how)}, with the cables exchanged"
    found = json.loads(done.stdout)
    said = f"rms {found['rms_mm']:.2f} mm, pads within {found['uncertainty_mm']:.2f} mm"
    return first, made_up, said, cell.runs(how)


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--case", choices=CASES, action="append", help="this one alone; several times: these")
    asked = parser.parse_args().case or list(CASES)
    print("| built | not calibrated | a made-up calibration | calibration | after |\n|---|---|---|---|---|")
    for name, built in ((name, CASES[name]) for name in asked):
        with tempfile.TemporaryDirectory() as folder:
            print(f"| {name} | {' | '.join(before_and_after(built, Path(folder)))} |", flush=True)


if __name__ == "__main__":
    main()
