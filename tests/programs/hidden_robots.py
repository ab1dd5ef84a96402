"""Robots whose parameters are drawn here, and what `rtstack twin` finds of them in their logs alone.

    python -m tests.programs.hidden_robots --robots 20 --out DIR

Friction, reflected inertia, stiffness, damping, gravity compensation, payload, offset and delay of the force estimate
and the stiffness of a pad on the box are drawn from wide ranges, and every link's inertia differs from its description
(sim_robot/parameters/plant.toml). A robot makes three motions of `rtstack excite`, 66 s: one without its payload, two
with it; and grabs the box once, without it. From these logs it is identified. Then it grabs the box, displaced and
without its payload, twice, with the published friction and with the twin's; and the first of these logs, which no fit
has seen, is run again in the twin, whose profile has the payload taken away. The program goes on where it was left:
`--for-s` says after how long it begins no further step.
DIR/result.json and the last lines say how far the twin is off, and how many of its intervals contain the truth.
"""

import argparse
import json
import shutil
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

from hal.configuration import read_toml, toml_text
from rtstack.cells import load_description
from rtstack.log.reader import read_log
from rtstack.model.cell_description import base_frame
from rtstack.papers.reference_spreading.measures import measure
from rtstack.samples import Mode
from rtstack.trials.review import log_columns
from sim_robot.contact import series
from sim_robot.scene import load_scene

ROOT = Path(__file__).resolve().parents[2]
IDEAL = ROOT / "sim_robot/parameters/profiles/ideal.toml"
NOMINAL = ROOT / "sim_robot/parameters/plant.toml"
# factors on the nominal value, log-uniform
RANGES = {
    "friction_p1": (0.5, 2.0), "friction_p2": (0.7, 1.5), "B_theta": (0.6, 1.6), "K": (0.7, 1.4), "D": (0.7, 1.4),
}  # fmt: skip
GRAVITY = 0.005  # standard deviation of the gravity compensation's factor
PAYLOAD_KG = (0.2, 1.5)
OFFSET_NM = (0.2, 0.4, 0.2, 0.35, 0.09, 0.09, 0.06)  # of the force estimate, standard deviations: the honest profile
DELAY_MS = 6  # of the force estimate, at most
CONTACT = (0.6, 1.6)  # factor on the stiffness of a pad on the box
OBJECT, SHIFT_MM = "rice_box", -30.0  # of the grabs that are judged: one pad comes first
FITTED_SHIFT_MM = 10.0  # of the grab that is fitted
RESULT = ("success", "nominal_impact_time_s", "detected_impact_time_s")
RTSTACK = [sys.executable, "-m", "rtstack"]


def drawn(generator: np.random.Generator) -> dict[str, object]:
    """Return a table of sim_robot.profile.Twin."""
    joints = read_toml(NOMINAL)[0]["joints"]
    arm: dict[str, object] = {
        name: (np.array(joints[name]) * np.exp(generator.uniform(*np.log(bounds), 7))).tolist()
        for name, bounds in RANGES.items()
    }
    arm["friction_p3"] = (np.array(joints["friction_p3"]) * generator.uniform(0.0, 2.0, 7)).tolist()
    arm["gravity_factor"] = (1.0 + GRAVITY * generator.standard_normal(7)).tolist()
    arm["payload_kg"] = float(generator.uniform(*PAYLOAD_KG))
    arm["payload_centre"] = [*generator.uniform(-0.03, 0.03, 2).tolist(), float(generator.uniform(0.1, 0.2))]
    arm["torque_offset"] = (np.array(OFFSET_NM) * generator.standard_normal(7)).tolist()
    arm["estimate_delay_ms"] = int(generator.integers(0, DELAY_MS + 1))
    return arm


def compared(truth: dict[str, dict[str, object]], found: dict[str, dict]) -> list[dict[str, object]]:
    """Return a row for each parameter that was identified, or not."""
    rows = []
    for side in ("left", "right"):
        for each in found[side]["parameters"]:
            name = each["name"]
            if name.startswith("payload_moment"):
                real = truth[side]["payload_kg"] * truth[side]["payload_centre"]["xyz".index(name[-1])]
            elif name in truth[side]:
                value = truth[side][name]
                real = value[each["joint"] - 1] if isinstance(value, list) else value
            else:
                continue
            rows.append({"side": side, "name": name, "joint": each["joint"], "truth": real, **each})
    return rows


class Robot:
    """A hidden robot in a folder. Each step is made once; `steps` are in the order in which they need each other."""

    def __init__(self, number: int, out: Path) -> None:
        self.number, self.folder, self.reference = number, out / f"robot{number}", out / "ref.mcap"
        self.folder.mkdir(parents=True, exist_ok=True)
        generator = np.random.default_rng([2026, number])
        self.arms = {side: drawn(generator) for side in ("left", "right")}
        scene = load_scene()
        on_box = series(scene.find(OBJECT).stiffness, scene.pad.stiffness) * np.exp(generator.uniform(*np.log(CONTACT)))
        for arm in self.arms.values():  # what both pads do to one box does not tell one pad from the other
            arm["contact_stiffness"] = float(on_box)
        bare = {side: arm | {"payload_kg": 0.0} for side, arm in self.arms.items()}
        base, _ = read_toml(IDEAL)
        for name, tables in (("bare", bare), ("loaded", self.arms)):
            (self.folder / f"{name}.toml").write_text(toml_text(base | tables))

    @property
    def steps(self) -> list[tuple[str, Callable[[Path], None]]]:
        """The files that are to be made, and what makes each."""
        logs = [(f"{name}{run}.mcap", self._excited(name, run)) for name, run in (("bare", 0), ("loaded", 1),
                                                                                 ("loaded", 2))]  # fmt: skip
        return [
            *logs, ("grab.mcap", self._grab([], FITTED_SHIFT_MM)), ("twin", self._identified),
            ("published.mcap", self._grab([])),
            ("own.mcap", self._grab(["--friction", str(self.folder / "twin/friction.toml")])),
            ("replay.json", self._replayed),
        ]  # fmt: skip

    def _excited(self, name: str, run: int) -> Callable[[Path], None]:
        def make(path: Path) -> None:
            _run("excite", path, "--run", run, "--seed", self.number, "--profile", self.folder / f"{name}.toml")

        return make

    def _identified(self, path: Path) -> None:
        loaded1, loaded2, bare, grab = (
            self.folder / f"{name}.mcap" for name in ("loaded1", "loaded2", "bare0", "grab")
        )
        _run("twin", loaded1, loaded2, "--unloaded", bare, "--unloaded", grab, "--out", path)

    def _grab(self, options: list[str], shift_mm: float = SHIFT_MM) -> Callable[[Path], None]:
        def make(path: Path) -> None:
            asked = ["--reference", self.reference, "--object", OBJECT, "--displacement-mm", shift_mm, *options]
            _run("trial", *asked, "--seed", self.number, "--profile", self.folder / "bare.toml", "--log", path)

        return make

    def _replayed(self, path: Path) -> None:
        document, _ = read_toml(self.folder / "twin" / "profile.toml")
        for side in ("left", "right"):
            document[side] |= {"payload_kg": 0.0}
        profile = self.folder / "twin_bare.toml"
        profile.write_text(toml_text(document))
        path.write_text(_run("replay", self.folder / "published.mcap", "--twin", profile, "--json"))

    def rows(self) -> list[dict[str, object]]:
        """Return the rows of `compared`."""
        return compared(self.arms, json.loads((self.folder / "twin" / "twin.json").read_text()))

    def grabs(self) -> dict[str, object]:
        """Return what both grabs and the replay show."""
        found = {name: grabbed(self.folder / f"{name}.mcap") for name in ("published", "own")}
        return found | {"force_off": json.loads((self.folder / "replay.json").read_text())["force_off"]}


def grabbed(path: Path) -> dict[str, float | None]:
    """Return the RMS of the pads' distance from their reference before the first contact, mm, and of the detection's
    delay, ms."""
    log, (description, _) = read_log(path), load_description(None)
    columns, result = log_columns(log), {name: json.loads(text) for name, text in log.metadata["result"].items()
                                         if name in RESULT}  # fmt: skip
    detected = result["detected_impact_time_s"]
    seen = measure(columns, description, OBJECT, SHIFT_MM, result["nominal_impact_time_s"], detected)
    ante = columns.control[0]["mode"] == Mode.ANTE_IMPACT
    if seen.first_contact_s is not None:
        ante &= np.arange(len(ante)) < round(1e3 * seen.first_contact_s)
    apart = []
    for k, mounting in enumerate((description.left, description.right)):
        frame = base_frame(mounting)
        place = columns.arm[k]["O_T_EE"][:, :3, 3] @ frame.rotation.T + frame.translation
        apart.append(np.sum((place - columns.control[k]["pose_ref"][:, :3])[ante] ** 2, axis=1))
    return {"success": result["success"], "tracking_mm": 1e3 * float(np.sqrt(np.mean(apart))),
            "delay_ms": seen.detection_delay_ms}  # fmt: skip


def _run(*words: object) -> str:
    done = subprocess.run([*RTSTACK, *map(str, words)], capture_output=True, text=True)
    if done.returncode == 2 or (done.returncode and words[0] in ("excite", "twin", "teach")):
        raise SystemExit(f"{' '.join(map(str, words))}: {done.stderr or done.stdout}")
    return done.stdout


def report(rows: list[dict]) -> str:
    """Return the table: how far off, and how often the truth is in the interval."""
    lines = [f"{'parameter':<18}{'identified':>12}{'median off':>12}{'90 %':>9}{'largest':>9}{'in interval':>13}"]
    for name in dict.fromkeys(row["name"] for row in rows):
        its = [row for row in rows if row["name"] == name]
        sure = [row for row in its if row["identified"]]
        if not sure:
            lines.append(f"{name:<18}{f'0 of {len(its)}':>12}")
            continue
        off = np.array([abs(row["value"] - row["truth"]) for row in sure])
        relative = not name.startswith(("payload_moment", "friction_p3", "torque_offset", "estimate_delay"))
        off = 100.0 * off / np.abs([row["truth"] for row in sure]) if relative else 1e3 * off
        inside = np.mean([abs(row["value"] - row["truth"]) <= row["half_width"] for row in sure])
        figures = "".join(f"{value:>9.2f}" for value in (np.quantile(off, 0.9), off.max()))
        unit = "%" if relative else "e-3"
        lines.append(
            f"{name:<18}{f'{len(sure)} of {len(its)}':>12}{np.median(off):>9.2f} {unit:<2}{figures}{inside:>12.0%}"
        )
    sure = [row for row in rows if row["identified"]]
    inside = np.mean([abs(row["value"] - row["truth"]) <= row["half_width"] for row in sure])
    return "\n".join([*lines, f"all: {inside:.1%} of {len(sure)} intervals contain the truth"])


def report_grabs(grabs: list[dict]) -> str:
    """Return the table: the published friction beside the twin's, and the force in the twin beside the log's."""
    lines = [f"{'grabs':<18}{'published':>12}{'twin':>12}{'twin better':>13}"]
    for name, unit in (("tracking_mm", "mm"), ("delay_ms", "ms")):
        pairs = [(each["published"][name], each["own"][name]) for each in grabs]
        both = np.array([pair for pair in pairs if None not in pair])
        means = "".join(f"{value:>9.2f} {unit}" for value in both.mean(axis=0))
        lines.append(f"{name:<18}{means}{np.mean(both[:, 1] < both[:, 0]):>12.0%} of {len(both)}")
    wins = [sum(each[name]["success"] for each in grabs) for name in ("published", "own")]
    lines.append(f"{'success':<18}{wins[0]:>12}{wins[1]:>12}")
    off = np.abs([value for each in grabs for value in each["force_off"] if value is not None])
    lines.append(f"contact force in the twin: off by {100 * np.median(off):.1f} % (median), {100 * off.max():.1f} % at "
                 f"most; {np.mean(off <= 0.1):.0%} of {len(off)} within 10 %")  # fmt: skip
    return "\n".join(lines)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--robots", type=int, default=20)
    parser.add_argument("--first", type=int, default=0, help="number of the first robot")
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--for-s", type=float, default=np.inf, help="begin no step after so long")
    parser.add_argument("--only", nargs="*", default=None, help="of the steps: the files that are to be made")
    options = parser.parse_args()
    began, rows, grabs = time.monotonic(), [], []
    options.out.mkdir(parents=True, exist_ok=True)
    robots = [Robot(number, options.out) for number in range(options.first, options.first + options.robots)]
    if not (options.out / "ref.mcap").exists():
        _run("teach", options.out / "ref.mcap", "--object", OBJECT)
    for robot in robots:
        for name, make in robot.steps:
            path = robot.folder / name
            if path.exists() or (options.only is not None and name not in options.only):
                continue
            if time.monotonic() - began > options.for_s:
                break
            partial = path.with_name(f"partial_{name}")
            shutil.rmtree(partial) if partial.is_dir() else partial.unlink(missing_ok=True)
            make(partial)
            partial.rename(path)
        if (robot.folder / "twin").exists():
            rows += robot.rows()
        if (robot.folder / "replay.json").exists():
            grabs.append(robot.grabs())
    missing = [f"{each.folder.name}/{name}" for each in robots for name, _ in each.steps
               if not (each.folder / name).exists()]  # fmt: skip
    (options.out / "result.json").write_text(json.dumps({"parameters": rows, "grabs": grabs}, indent=1))
    if rows:
        print(report(rows))
    if grabs:
        print(report_grabs(grabs))
    print(f"{len(missing)} steps are left: {', '.join(missing[:3])}" if missing else "complete")


if __name__ == "__main__":
    main()
