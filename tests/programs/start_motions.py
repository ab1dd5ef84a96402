"""Ways to the start from random postures over random tables: which are gone, and what the plant feels on them.

Each case draws a posture of both arms about home and the height of the table, which the cell's file knows; the judge
has no box, which would refuse nearly all of them. Postures that touch something already are not counted. A way that is
not refused is followed on the plant in this process, with the judge, and every contact of a link or a pad that MuJoCo
finds counts.

Takes five minutes.
"""

import json
import re
import sys
from collections import Counter
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

import mujoco
import numpy as np

from hal.cell import Cell
from rtstack.cells import load_description
from rtstack.loop.plan import SessionPlan
from rtstack.loop.publisher import Publisher
from rtstack.model.cell_description import CellDescription
from rtstack.safety.limits import ForcePhase
from rtstack.trials.assembly import arm_controllers, cell_parameters
from rtstack.trials.run import Run
from rtstack.trials.run_context import NO_CONTEXT
from rtstack.trials.start_motion import JointPath, MeasuredPoints, StartMotion, WayRefused, _look_along
from rtstack.trials.tightening import limits_of_arms
from sim_robot.cell import SimulatedCell, simulated_cell
from sim_robot.plant_parameters import OWN_FILES
from sim_robot.scene import NO_OBJECT, Scene
from tests.programs import program

SCENE = (OWN_FILES / "scenes" / "grab.toml").read_text(encoding="utf-8")
SPREAD_RAD = 0.45  # standard deviation of a joint about home
LOWER_M, HIGHER_M = -0.1, 0.005  # of the table; at home the pads are 10 mm above it


class Contacts:
    """What touches in each millisecond of a plant. largest_n: the largest normal force of a contact, by its geoms."""

    def __init__(self, cell: SimulatedCell) -> None:
        self._model, self._data, self._advance = cell.plant.model, cell.plant.data, cell.next_state
        self.largest_n: dict[str, float] = {}
        cell.next_state = self._next_state  # type: ignore[method-assign]

    def look(self) -> None:
        """Take the contacts of now."""
        force = np.zeros(6)
        for number in range(self._data.ncon):
            mujoco.mj_contactForce(self._model, self._data, number, force)
            geoms = self._data.contact[number].geom
            names = [mujoco.mj_id2name(self._model, mujoco.mjtObj.mjOBJ_GEOM, geom) for geom in geoms]
            name = " and ".join(sorted(names))
            self.largest_n[name] = max(self.largest_n.get(name, 0.0), float(force[0]))

    def _next_state(self, *arguments: object) -> object:
        answer = self._advance(*arguments)  # type: ignore[arg-type]
        self.look()
        return answer


def drawn(
    description: CellDescription, rng: np.random.Generator, folder: Path
) -> tuple[CellDescription, Path, np.ndarray]:
    """Return a cell with another table, the scene of it in which the arms begin elsewhere, and where."""
    top_z = description.table.top_z + rng.uniform(LOWER_M, HIGHER_M)
    begin = description.home + rng.normal(0.0, SPREAD_RAD, description.home.shape)
    ranges = [model.limits for model in description.robots]
    begin = np.clip(begin, [each.q_lower + 0.05 for each in ranges], [each.q_upper - 0.05 for each in ranges])
    text = re.sub(r"(?m)^top_z = .*", f"top_z = {top_z}", SCENE)
    homes = iter(begin.tolist())
    text = re.sub(r"(?m)^home = .*", lambda _: f"home = {next(homes)}", text)
    scene = folder / "scene.toml"
    scene.write_text(text, encoding="utf-8")
    unboxed = {key: value for key, value in description.safety.items() if key not in ("ee_lower", "ee_upper")}
    return replace(description, table=replace(description.table, top_z=top_z), safety=unboxed), scene, begin


def followed(description: CellDescription, way: StartMotion, cell: Cell) -> str:
    """Follow a way; return how that ended, "" where the arms have arrived."""
    parameters = cell_parameters(description)
    control, end = parameters.control, MeasuredPoints(0.002, len(cell.arms))
    plan = SessionPlan.from_source(end, control.stiffness, control.period_s, ForcePhase.APPROACH)
    with Run(description, parameters, plan, limits_of_arms(description), NO_CONTEXT, way) as run:
        outcome = run._go_to_start(cell, way, Publisher([], None, sides=cell.sides))
        run.close({})
    return "" if outcome is None else f"{outcome.end}: {outcome.detail}"


def main(cases: int = 500, seed: int = 1) -> None:
    """Draw so many postures that touch nothing, and print what became of them as JSON."""
    Scene.displacement_range = lambda *_: (-9.0, 9.0)  # type: ignore[method-assign]  # of what does not stand there
    rng, description = np.random.default_rng(seed), load_description(None)[0]
    said, touched, ended = Counter[str](), Counter[str](), Counter[str]()
    largest_n = largest_rad = 0.0
    with TemporaryDirectory() as folder:
        while said.total() < cases:
            cell_description, scene, begin = drawn(description, rng, Path(folder))
            cell = simulated_cell(NO_OBJECT, 0.0, int(rng.integers(1 << 30)), scene=scene)
            contacts = Contacts(cell)
            mujoco.mj_forward(cell.plant.model, cell.plant.data)
            contacts.look()
            if contacts.largest_n:
                continue
            goal, limits = cell_description.home, cell_description.start_motion
            path = JointPath.between(begin, goal, limits)
            if np.abs(goal - begin).max() > limits.longest_rad:
                said["refused: further than longest_rad"] += 1
                continue
            arms = arm_controllers(cell_description, cell_parameters(cell_description))
            try:
                _look_along(path, arms, cell_description, None)
            except WayRefused as error:
                said["refused: " + re.sub("left|right", "SIDE", str(error).partition(":")[0])] += 1
                continue
            said["followed"] += 1
            reason = followed(cell_description, StartMotion(path, limits), cell.as_cell("direct"))
            ended[reason or "arrived"] += 1
            largest_rad = max(largest_rad, float(np.abs(cell.states["q"] - goal).max()))
            for name, force_n in contacts.largest_n.items():
                touched[f"{name}, case {said.total()}, {force_n:.1f} N"] += 1
            largest_n = max([largest_n, *contacts.largest_n.values()])
            print(f"{said.total()} of {cases}", end="\r", file=sys.stderr, flush=True)
    print(json.dumps({
        "seed": seed, "postures": dict(said), "ended": dict(ended), "touched": dict(touched),
        "largest_contact_n": round(largest_n, 1), "largest_error_rad": round(largest_rad, 4),
    }, indent=1))  # fmt: skip


if __name__ == "__main__":
    program(main)
