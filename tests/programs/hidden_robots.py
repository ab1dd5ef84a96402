"""Robots whose parameters are drawn here, and what `rtstack twin` finds of them in their logs alone.

    python -m tests.programs.hidden_robots --robots 20 --out DIR

Friction, reflected inertia, stiffness, damping, gravity compensation and payload are drawn from wide ranges, and every
link's inertia differs from its description (sim_robot/parameters/plant.toml). A robot makes three motions of
`rtstack excite`, 66 s: one without its payload, two with it. DIR/result.json and the last lines say how far the twin is
off, and how many of its intervals contain the truth.
"""

import argparse
import json
import subprocess
import sys
from pathlib import Path

import numpy as np

from hal.configuration import read_toml, toml_text

ROOT = Path(__file__).resolve().parents[2]
IDEAL = ROOT / "sim_robot/parameters/profiles/ideal.toml"
NOMINAL = ROOT / "sim_robot/parameters/plant.toml"
# factors on the nominal value, log-uniform
RANGES = {
    "friction_p1": (0.5, 2.0), "friction_p2": (0.7, 1.5), "B_theta": (0.6, 1.6), "K": (0.7, 1.4), "D": (0.7, 1.4),
}  # fmt: skip
GRAVITY = 0.005  # standard deviation of the gravity compensation's factor
PAYLOAD_KG = (0.2, 1.5)
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


def robot(number: int, out: Path) -> list[dict[str, object]]:
    """Draw a robot, make its logs, identify it; return the rows of `compared`. Complete robots are not made again."""
    folder = out / f"robot{number}"
    folder.mkdir(parents=True, exist_ok=True)
    generator = np.random.default_rng([2026, number])
    arms = {side: drawn(generator) for side in ("left", "right")}
    base, _ = read_toml(IDEAL)
    bare = {side: arm | {"payload_kg": 0.0} for side, arm in arms.items()}
    logs = []
    for name, tables, run in (("bare", bare, 0), ("loaded", arms, 1), ("loaded", arms, 2)):
        profile, log = folder / f"{name}.toml", folder / f"{name}{run}.mcap"
        profile.write_text(toml_text(base | tables))
        logs.append(log)
        if not (folder / "twin" / "twin.json").exists() and not log.exists():
            command = ["excite", str(log), "--run", str(run), "--seed", str(number), "--profile", str(profile)]
            subprocess.run([*RTSTACK, *command], check=True, stdout=subprocess.DEVNULL)
    if not (folder / "twin").exists():
        command = ["twin", str(logs[1]), str(logs[2]), "--unloaded", str(logs[0]), "--out", str(folder / "twin")]
        subprocess.run([*RTSTACK, *command], check=True, stdout=subprocess.DEVNULL)
    for log in logs:
        log.unlink(missing_ok=True)  # 40 MB each
    return compared(arms, json.loads((folder / "twin" / "twin.json").read_text()))


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
        relative = not name.startswith(("payload_moment", "friction_p3"))
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


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--robots", type=int, default=20)
    parser.add_argument("--first", type=int, default=0, help="number of the first robot")
    parser.add_argument("--out", type=Path, required=True)
    options = parser.parse_args()
    rows: list[dict[str, object]] = []
    for number in range(options.first, options.first + options.robots):
        rows += robot(number, options.out)
        (options.out / "result.json").write_text(json.dumps(rows, indent=1))
        print(f"{number - options.first + 1} robots\n{report(rows)}", flush=True)


if __name__ == "__main__":
    main()
