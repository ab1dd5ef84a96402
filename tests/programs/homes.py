"""`find_home` on random cells of three arms: every pose and every refusal is checked by other means.

Each cell draws a robot, one arm or two, bases, yaws, a table, objects and limits; every third one is made impossible in
some way. A pose is checked with Pinocchio (pad, limits, singular values) and in MuJoCo (contacts of the scene at rest).
A refusal is checked by a search of its own (bounded least squares from random starts, distances by MuJoCo): it must
find no start at any place, and at the first one postures that pass what comes before the reason, but not the reason.
Takes ten minutes.
"""

import json
import re
import sys
import time
from collections import Counter
from itertools import product
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, cast

import mujoco
import numpy as np
import pinocchio as pin
from scipy.optimize import least_squares

from hal.base.arrays import Array
from hal.base.configuration import with_values
from hal.robots import robot
from rtstack.cells import default_cell_file
from rtstack.model.cell_description import CellDescription, base_frame, load_cell_description
from rtstack.planning import home
from rtstack.safety.limits import hardware_limits
from sim_robot.cell import SimulatedCell, simulated_cell
from sim_robot.scene import NO_OBJECT, Scene
from tests.programs import program

IIWA = Path(__file__).parents[2] / "examples" / "iiwa" / "iiwa" / "iiwa14.toml"
ROBOTS = ("fr3", "fer", str(IIWA))
MADE_IMPOSSIBLE = ("far", "high", "in the table", "box", "joint 4", "arms", "low", "joint 6")
STARTS = 12  # of the search, for each rotation of a pad
Place = tuple[float, float, float]
KINDS = {
    "in a grab": "grab", "outside of its box": "box", "out of reach": "reach", "is at its limit": "joint",
    "touch the table": "table", "singular": "singular", "nearer than": "arms",
}  # fmt: skip


def robot_of(number: int) -> str:
    """Return the robot of a cell: each one meets each way to be impossible."""
    return ROBOTS[(number + number // 3) % len(ROBOTS)]


def drawn(number: int, rng: np.random.Generator) -> tuple[str, str]:
    """Return a cell's file, and how it was made impossible, "" where it was not."""
    why = MADE_IMPOSSIBLE[number // 3 % len(MADE_IMPOSSIBLE)] if number % 3 == 2 else ""
    model = robot_of(number)
    iiwa = model == str(IIWA)
    x, y, yaw = rng.uniform(-0.65, -0.35) - 0.1 * iiwa, rng.uniform(0.4, 0.65), rng.uniform(-0.6, 0.6)
    top, z = rng.uniform(0.05, 0.4), rng.uniform(-0.1, 0.1)
    x, top = {"far": (-1.5, top), "high": (x, 1.0), "in the table": (-0.05, top)}.get(why, (x, top))
    y, z = {"in the table": (0.2, z), "arms": (0.06, z), "low": (y, 0.75)}.get(why, (y, z))
    things = {
        f"box_{k}": [round(float(a), 3) for a in rng.uniform((0.12, 0.16, 0.14), (0.24, 0.36, 0.3))]
        for k in range(rng.integers(1, 4))
    }
    safety: dict[str, Any] = {"ee_lower": [-0.3, -0.8, top], "ee_upper": [0.3, 0.8, top + 1.2], "power_max": 100.0}
    if why == "box":
        safety["ee_upper"] = [0.3, 0.2, top + 1.2]
    if why.startswith("joint"):
        joint = int(why[-1]) - 1
        limits = hardware_limits(robot(model))
        low, high = list(limits.q_lower), list(limits.q_upper)
        low[joint] = low[joint] + 0.8 * (high[joint] - low[joint])  # the upper fifth of its range
        safety |= {"q_lower": low, "q_upper": high}
    text = default_cell_file().read_text(encoding="utf-8")
    text = re.sub(r"(?s)\[safety\].*?\[tracker\]", "[safety]\n[tracker]", text)
    text = re.sub(r"(?s)\[objects\..*", "", text)
    text = re.sub(r"(?m)^home = .*\n", "", text)
    values: dict[tuple[str, ...], Any] = {("table", "top_z"): top}
    values |= {("safety", key): value for key, value in safety.items()}
    for name, size in things.items():
        values |= {("objects", name, "mass"): 1.0, ("objects", name, "size"): size}
    for sign, side in ((1.0, "left"), (-1.0, "right")):
        turn = sign * yaw
        values |= {(side, "model"): model, (side, "base_position"): [x, sign * y, z]}
        values[side, "base_orientation_wxyz"] = [float(np.cos(turn / 2)), 0.0, 0.0, float(np.sin(turn / 2))]
    text = with_values(text, values)
    if why != "arms" and rng.uniform() < 0.25:
        text = re.sub(r"(?s)\[right\].*?\n\n", "", text)
    return text, why


class Other:
    """One arm, and what is found about it without the stack's own model of it."""

    def __init__(self, description: CellDescription, side: str, plant: SimulatedCell) -> None:
        mounting = description.mountings[side]
        frame = base_frame(mounting)
        self.side, self.base, self.pad = (
            side,
            pin.SE3(frame.rotation, frame.translation),
            mounting.pad or description.pad,
        )
        self.model = pin.buildModelFromXML(mounting.robot.urdf)
        self.data, self.flange = self.model.createData(), self.model.getFrameId("link8")
        limits = hardware_limits(mounting.robot).tightened(description.safety)
        self.low, self.high, self.limits = np.array(limits.q_lower), np.array(limits.q_upper), limits
        self.sign = 1.0 if side == "left" else -1.0
        self.plant, self.first = plant.plant, 7 * plant.scene.sides.index(side)
        names = [plant.plant.model.geom(k).name for k in range(plant.plant.model.ngeom)]
        self.links = [k for k, name in enumerate(names) if re.match(rf"{side}_link[1-7]", name)]
        self.geoms = [k for k, name in enumerate(names) if name.startswith(f"{side}_")]
        self.table = names.index("table")

    def face(self, q: Array) -> pin.SE3:
        """Return the pad's face in the world."""
        pin.framesForwardKinematics(self.model, self.data, q)
        return self.base * self.data.oMf[self.flange] * pin.SE3(self.pad.F_T_face)

    def jacobian(self, q: Array) -> Array:
        """Return the Jacobian (6, 7) of the face's twist along the world's axes."""
        J = pin.computeFrameJacobian(self.model, self.data, q, self.flange, pin.LOCAL_WORLD_ALIGNED)
        turn = self.base.rotation
        J = np.vstack([turn @ J[:3], turn @ J[3:]])
        lever = self.face(q).translation - (self.base * self.data.oMf[self.flange]).translation
        return np.vstack([J[:3] - pin.skew(lever) @ J[3:], J[3:]])

    def terms(self, q: Array) -> Array:
        """Return the room to limits, the links' gap over the table, and the smallest singular value."""
        self.plant.data.qpos[self.first : self.first + 7] = q
        mujoco.mj_kinematics(self.plant.model, self.plant.data)
        gap = min(
            mujoco.mj_geomDistance(self.plant.model, self.plant.data, k, self.table, 0.5, None) for k in self.links
        )
        J = np.vstack([self.jacobian(q), np.eye(7)[0]])
        room = float(np.minimum(q - self.low, self.high - q).min())
        return np.array([room, gap, np.linalg.svd(J, compute_uv=False)[-1]])

    def found(
        self, place: Place, rng: np.random.Generator, free: tuple[int, ...] = (), near: Array | None = None
    ) -> list[Array]:
        """Return configurations with the pad flat there, 0.1 rad from limits. free: joints without limits (from 0).
        near: one of which the pad's edges and joint 1 are to be kept, 0.05 rad from limits."""
        margin = home.LEAST[0] if near is None else home.LEAST_IN_GRAB[0]
        low, high = self.low + margin, self.high - margin
        low[list(free)], high[list(free)] = -2.0 * np.pi, 2.0 * np.pi
        level = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -self.sign], [0.0, self.sign, 0.0]])
        quarters = [level @ pin.utils.rotate("z", quarter * np.pi / 2.0) for quarter in range(4)]
        rotations = quarters if near is None else [self.face(near).rotation.copy()]
        found = []
        for rotation, kept in product(rotations, [None] if near is None else [near]):

            def error(q: Array, rotation: Array = rotation, kept: Array | None = kept) -> Array:
                face = self.face(q)
                off = np.concatenate([face.translation - place, pin.log3(face.rotation @ rotation.T)])
                return off if kept is None else np.append(off, q[0] - kept[0])

            def derivative(q: Array, rotation: Array = rotation, kept: Array | None = kept) -> Array:
                turn = self.face(q).rotation @ rotation.T
                J = self.jacobian(q)
                J[3:] = pin.Jlog3(turn) @ turn.T @ J[3:]
                return J if kept is None else np.vstack([J, np.eye(7)[0]])

            starts = rng.uniform(low, high, (STARTS, 7)) if near is None else np.clip([near], low + 1e-6, high - 1e-6)
            for start in starts:
                done = least_squares(error, start, cast(Any, derivative), bounds=(low, high), max_nfev=60, xtol=1e-12)
                if np.abs(done.fun).max() < 1e-7:
                    found.append(done.x)
        return found

    def grabs(self, q: Array, places: list[Place], rng: np.random.Generator) -> bool:
        """Return whether a grab from q comes through, without a jump to another kind of posture."""
        for place in places:
            there = self.found(place, rng, near=q)
            if not there or np.abs(there[0] - q).max() > 1.5 or np.any(self.terms(there[0]) < home.LEAST_IN_GRAB):
                return False
            q = there[0]
        return True


def distance(one: Other, other: Other, q: tuple[Array, ...]) -> float:
    """Return how far two arms are apart, m, at most 0.5."""
    data, model = one.plant.data, one.plant.model
    for arm, joints in zip((one, other), q, strict=True):
        data.qpos[arm.first : arm.first + 7] = joints
    mujoco.mj_kinematics(model, data)
    return min(mujoco.mj_geomDistance(model, data, a, b, 0.5, None) for a, b in product(one.geoms, other.geoms))


def plant_of(path: Path, text: str, homes: dict[str, list[float]]) -> SimulatedCell:
    """Return the simulated cell with the arms at these homes."""
    path.write_text(with_values(text, {(side, "home"): q for side, q in homes.items()}), encoding="utf-8")
    return simulated_cell(NO_OBJECT, 0.0, 1, cell_file=path)


def check_pose(path: Path, text: str, description: CellDescription, homes: dict[str, Array]) -> list[str]:
    """Return what is wrong with a pose that was found."""
    wrong, plant = [], plant_of(path, text, {side: q.tolist() for side, q in homes.items()})
    load_cell_description(path)  # as every other command reads it
    names = [plant.plant.model.geom(k).name for k in range(plant.plant.model.ngeom)]
    mujoco.mj_forward(plant.plant.model, plant.plant.data)
    for pair in plant.plant.data.contact.geom[: plant.plant.data.ncon]:
        if any(re.match("left_|right_", names[k]) for k in pair):
            wrong.append(f"contact of {names[pair[0]]} and {names[pair[1]]}")
    widest = max(thing.size[1] for thing in description.objects.values()) / 2.0
    for side, q in homes.items():
        arm = Other(description, side, plant)
        face, terms = arm.face(q), arm.terms(q)
        x, y, z = face.translation
        above = z - description.table.top_z - arm.pad.size[1] / 2.0
        beside = arm.sign * y - widest
        if abs(x) > 1e-5 or min(abs(above - a) for a in home.ABOVE_M) > 1e-5:
            wrong.append(f"{side}: x {x:.6f}, {above:.6f} above the table")
        if min(abs(beside - b) for b in home.BESIDE_M) > 1e-5:
            wrong.append(f"{side}: {beside:.6f} beside the widest object")
        level = np.abs(face.rotation).round(5)
        if face.rotation[1, 2] * arm.sign > -1.0 + 1e-9 or set(level.ravel()) != {0.0, 1.0}:
            wrong.append(f"{side}: not flat: {face.rotation.tolist()}")
        if np.any(terms < np.array(home.LEAST) - 1e-5):
            wrong.append(f"{side}: room, gap, singular value {terms.tolist()}")
    return wrong


def places_of(description: CellDescription, sign: float, above: float, beside: float) -> list[Place]:
    """Return the start of a pad, and where a grab takes it."""
    things, top = description.objects.values(), description.table.top_z
    wide, narrow = (of(thing.size[1] for thing in things) / 2.0 for of in (max, min))
    start = top + above + description.pad.size[1] / 2.0
    low, high = (max(top + of(thing.size[2] for thing in things) / 2.0 + 0.02, start + 0.05) for of in (min, max))
    ways = [(0.0, wide + beside, start), (0.0, wide + (beside + 0.07) / 2.0, start), (0.0, wide + 0.07, low - 0.03)]
    ways += [(0.0, narrow, low), (0.0, wide, high), (0.05, narrow, high + 0.25)][: 1 + len(description.arms)]
    return [(x, sign * y, z) for x, y, z in ways]


def check_refusal(
    path: Path, text: str, description: CellDescription, line: str, rng: np.random.Generator, told: Counter[str]
) -> list[str]:
    """Return what is wrong with a refusal."""
    kind = next(kind for words, kind in KINDS.items() if words in line)
    told[f"refused: {kind}"] += 1
    middle = {
        side: ((arm.robot.limits.q_lower + arm.robot.limits.q_upper) / 2.0).tolist()
        for side, arm in description.mountings.items()
    }
    plant, wrong = plant_of(path, text, middle), []
    arms = {side: Other(description, side, plant) for side in description.sides}
    stages: dict[str, dict[str, list[Array]]] = {}
    both = list(arms.values())
    for above, beside in product(home.ABOVE_M, home.BESIDE_M):
        pairs = []
        for side, arm in arms.items():
            start, *grab = places_of(description, arm.sign, above, beside)
            inside = bool(np.all((arm.limits.ee_lower < np.array(start)) & (start < np.array(arm.limits.ee_upper))))
            held = arm.found(start, rng) if inside else []
            terms = [arm.terms(q) for q in held]
            over = [q for q, (_, gap, _) in zip(held, terms, strict=True) if gap >= home.LEAST[1]]
            good = [
                q for q, (_, gap, s) in zip(held, terms, strict=True) if gap >= home.LEAST[1] and s >= home.LEAST[2]
            ]
            grabbing = [q for q in good if arm.grabs(q, grab, rng)]
            stages.setdefault(side, {
                "box": [] if inside else [np.array(start)], "joint": held, "table": over, "singular": good,
                "grab": grabbing,
            })  # fmt: skip
            pairs.append(grabbing)
        if any(len(pair) < 2 or distance(both[0], both[-1], pair) >= 0.05 for pair in product(*pairs)):
            wrong.append(f"{above} above the table and {beside} beside the object there is a start")
    if kind == "arms":
        first = [found["grab"] for found in stages.values()]
        return wrong if all(first) else [*wrong, "an arm has no start by itself"]
    side = line.split()[0]
    first, start = stages[side], places_of(description, arms[side].sign, home.ABOVE_M[0], home.BESIDE_M[0])[0]
    order = ["joint", "table", "singular", "grab"]
    if kind == "box":
        return wrong if first["box"] else [*wrong, "the place is inside of the box"]
    if kind == "reach":
        return [*wrong, "the place is in reach"] if arms[side].found(start, rng, free=tuple(range(7))) else wrong
    if first[kind]:
        wrong.append(f"postures pass what is refused: {first[kind][0].tolist()}")
    if kind == "joint":
        (number,) = map(int, re.findall(r"joint (\d)", line))
        alone = bool(arms[side].found(start, rng, free=(number - 1,)))
        told["refused: joint, and in reach without this limit" if alone else "refused: joint, and others besides"] += 1
        if not alone and not arms[side].found(start, rng, free=tuple(range(7))):
            wrong.append("out of reach, whatever the limits are")
    elif not first[order[order.index(kind) - 1]]:
        wrong.append(f"no posture comes as far as the {kind}")
    return wrong


def main(cells: int = 50, seed: int = 1) -> None:
    """Draw so many cells, and print what became of them as JSON."""
    Scene.displacement_range = lambda *_: (-9.0, 9.0)  # type: ignore[method-assign]  # of what does not stand there
    rng, told, wrong = np.random.default_rng(seed), Counter[str](), []
    seconds = []
    with TemporaryDirectory() as folder:
        path = Path(folder) / "cell.toml"
        for number in range(cells):
            text, why = drawn(number, rng)
            path.write_text(text, encoding="utf-8")
            name = f"cell {number}, {Path(robot_of(number)).stem}{', made impossible: ' * bool(why)}{why}"
            description = load_cell_description(path, homeless=True)
            begin = time.perf_counter()
            try:
                homes = home.find_home(description)
            except home.NoHome as error:
                seconds.append(time.perf_counter() - begin)
                line = str(error)
                told[f"{Path(robot_of(number)).stem}: refused"] += 1
                problems = check_refusal(path, text, description, line, rng, told)
            else:
                seconds.append(time.perf_counter() - begin)
                line = "found"
                told[f"{Path(robot_of(number)).stem}: found"] += 1
                problems = check_pose(path, text, description, homes)
            print(f"{name}: {line}", *problems, sep="\n    ", file=sys.stderr, flush=True)
            wrong += [f"{name}: {problem}" for problem in problems]
    print(json.dumps({
        "seed": seed, "cells": cells, "what": dict(sorted(told.items())), "wrong": wrong,
        "seconds_p50": round(float(np.median(seconds)), 1), "seconds_max": round(max(seconds), 1),
    }, indent=1))  # fmt: skip


if __name__ == "__main__":
    program(main)
