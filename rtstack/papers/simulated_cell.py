"""The simulated cell of a campaign: its scene as the campaign has fixed it, scattered by the seed."""

from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass, replace
from functools import lru_cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from hal.base.configuration import toml_text
from hal.cell import Cell
from hal.displacement import Displacement
from rtstack.cells import IDEAL, with_profile
from rtstack.cells.simulated import served_cell
from rtstack.cells.simulator import Simulator
from rtstack.experiments.experiment import DIRECT
from rtstack.experiments.simulation import WorkerHost
from rtstack.model.cell_description import CellDescription
from rtstack.papers.conditions import Conditions, files_of_plant
from rtstack.trials.record import RunLog
from sim_robot.cell import SimulatedCell
from sim_robot.faults.file import faults_in, tilt_of
from sim_robot.lab_objects import with_lab_objects
from sim_robot.plant import Plant
from sim_robot.plant_parameters import PlantParameters, load_plant_parameters
from sim_robot.profile import load_profile
from sim_robot.scene import NO_OBJECT, PlacementScatter, Scene, load_scene

SMALLEST_FACTOR = 0.2  # of friction, however large the scatter
FRICTION_DRAW = 3  # beside 0 arms and placement, 1 sensors, 2 tracker (sim_robot)


@dataclass(frozen=True, slots=True)
class BuiltCell:
    """A simulated cell as a campaign builds it for one run.

    object_name: NO_OBJECT for none. seed: of placement and noise, and of the arms where arms_seed is None. profile: its
    name. script: what goes wrong, tables as in a faults file (sim_robot/faults/kinds.py).
    """

    scene: Scene
    parameters: PlantParameters
    object_name: str
    seed: int
    displacement: Displacement | float = 0.0
    arms_seed: int | None = None
    profile: str = IDEAL
    script: Sequence[dict[str, Any]] = ()

    def open(self, kind: str, description: CellDescription) -> Cell:
        """Open it. kind: direct, the plant in this process; lockstep, a simulated robot of its own behind the wire.

        Rows are the same. description: of the cell as its user knows it. Raises HardwareError.
        """
        name = with_profile(kind, self.profile)
        return self._direct(name) if kind == DIRECT else self._served(name, description)

    def host(self, kind: str, kept: RunLog | None = None) -> WorkerHost:
        return WorkerHost(lambda run: self.open(kind, run.description), lambda run, cell: kept)

    def _direct(self, name: str) -> Cell:
        faults = faults_in({"fault": list(self.script)}, "the campaign's script")
        empty = self.object_name == NO_OBJECT
        plant = Plant(
            self.scene, self.parameters, next(iter(self.scene.objects)) if empty else self.object_name,
            self.displacement, self.seed, self.arms_seed, tilt_of(faults), load_profile(self.profile),
        )  # fmt: skip
        return SimulatedCell(plant, self.scene, self.parameters, self.seed, faults=faults, empty=empty).as_cell(name)

    def _served(self, name: str, description: CellDescription) -> Cell:
        with TemporaryDirectory() as folder:
            scene, parameters, faults = (Path(folder) / f"{each}.toml" for each in ("scene", "parameters", "faults"))
            scene.write_text(toml_text(asdict(self.scene)), encoding="utf-8")
            parameters.write_text(toml_text(asdict(self.parameters)), encoding="utf-8")
            faults.write_text("".join(f"[[fault]]\n{toml_text(each)}" for each in self.script), encoding="utf-8")
            more = ["--scene", str(scene), "--parameters", str(parameters)]
            more += [] if self.arms_seed is None else ["--arms-seed", str(self.arms_seed)]
            simulator = Simulator(
                self.object_name, self.displacement, self.seed, lockstep=True, more=more, profile=self.profile,
                faults=faults if self.script else None, sides=self.scene.sides,
            )  # fmt: skip
        return served_cell(name, simulator, description, lockstep=True)


def conditioned_cell(
    object_name: str, displacement: Displacement | float, seed: int, conditions: Conditions,
    script: Sequence[dict[str, Any]] = (), wider_mm: float = 0.0, *, cell_file: Path | None = None,
) -> BuiltCell:  # fmt: skip
    """Return the cell of a trial, its object in place. wider_mm: the object along y. cell_file: a lab's own objects."""
    nominal, parameters = simulated_files(cell_file)
    scene = conditioned(nominal, conditions, seed)
    if wider_mm:
        thing = scene.find(object_name)
        x, y, z = thing.size
        scene = replace(scene, objects={object_name: replace(thing, size=(x, y + 1e-3 * wider_mm, z))})
    sensors = replace(parameters.sensors, tau_ext_cutoff_hz=conditions.tau_ext_cutoff_hz)
    return BuiltCell(
        scene, replace(parameters, sensors=sensors), object_name, seed, displacement,
        profile=conditions.profile, script=script,
    )  # fmt: skip


def plant_files(conditions: Iterable[Conditions] = ()) -> list[Path]:
    """Return the files of the simulated cell and of the conditions' profiles. Raises ConfigurationError: no such
    profile.
    """
    profiles = sorted({each.profile for each in conditions} - {IDEAL})
    for profile in profiles:
        load_profile(profile)
    wanted = [f"parameters/profiles/{each}.toml" for each in profiles if not each.endswith(".toml")]
    own = [Path(profile) for profile in profiles if profile.endswith(".toml")]
    return own + files_of_plant("scenes/grab.toml", "parameters/plant.toml", *wanted)


@lru_cache(maxsize=1)
def simulated_files(cell_file: Path | None = None) -> tuple[Scene, PlantParameters]:
    """The simulated cell's files: read once, whatever the number of trials. cell_file: with a lab's own objects."""
    scene = load_scene()
    return scene if cell_file is None else with_lab_objects(scene, cell_file), load_plant_parameters()


def conditioned(scene: Scene, conditions: Conditions, seed: int) -> Scene:
    """Return the scene under these conditions; this seed's draw of both frictions, an object's own included."""
    draws = np.random.default_rng(np.random.SeedSequence([seed, FRICTION_DRAW])).standard_normal(2)
    pad, table = np.maximum(1.0 + conditions.friction_scatter * draws, SMALLEST_FACTOR).tolist()
    objects = {
        name: replace(
            thing,
            pad_friction=None if thing.pad_friction is None else thing.pad_friction * pad,
            table_friction=None if thing.table_friction is None else thing.table_friction * table,
        )
        for name, thing in scene.objects.items()
    }
    return replace(
        scene,
        objects=objects,
        pad=replace(scene.pad, stiffness=conditions.pad_stiffness, friction=conditions.pad_friction * pad),
        table=replace(scene.table, friction=conditions.table_friction * table),
        placement_scatter=PlacementScatter(conditions.placement_mm, conditions.placement_yaw_deg),
    )
