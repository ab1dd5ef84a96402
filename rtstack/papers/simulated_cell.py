"""The simulated cell of a campaign: its scene as the campaign has fixed it, scattered by the seed."""

from collections.abc import Iterable, Sequence
from dataclasses import replace
from functools import lru_cache
from importlib.resources import as_file, files
from pathlib import Path
from typing import Any

import numpy as np

from hal.cell import Cell
from hal.displacement import Displacement
from rtstack.cells import IDEAL, with_profile
from rtstack.papers.conditions import Conditions
from sim_robot.cell import SimulatedCell
from sim_robot.faults.file import faults_in, tilt_of
from sim_robot.lab_objects import with_lab_objects
from sim_robot.plant import Plant
from sim_robot.plant_parameters import PlantParameters, load_plant_parameters
from sim_robot.profile import load_profile
from sim_robot.scene import PlacementScatter, Scene, load_scene

SMALLEST_FACTOR = 0.2  # of friction, however large the scatter
FRICTION_DRAW = 3  # beside 0 arms and placement, 1 sensors, 2 tracker (sim_robot)


def open_conditioned_cell(
    object_name: str, displacement: Displacement | float, seed: int, conditions: Conditions,
    script: Sequence[dict[str, Any]] = (), wider_mm: float = 0.0, *, cell_file: Path | None = None,
) -> Cell:  # fmt: skip
    """Open the cell in this process, in lockstep, with the object in its place. Raises HardwareError.

    script: what goes wrong, tables as in a faults file (sim_robot/faults/kinds.py). wider_mm: the object along y.
    cell_file: a lab's own, for the objects that it adds.
    """
    faults = faults_in({"fault": list(script)}, "the campaign's script")
    nominal, parameters = simulated_files(cell_file)
    scene = conditioned(nominal, conditions, seed)
    if wider_mm:
        thing = scene.find(object_name)
        x, y, z = thing.size
        scene = replace(scene, objects={object_name: replace(thing, size=(x, y + 1e-3 * wider_mm, z))})
    sensors = replace(parameters.sensors, tau_ext_cutoff_hz=conditions.tau_ext_cutoff_hz)
    parameters = replace(parameters, sensors=sensors)
    profile = load_profile(conditions.profile)
    plant = Plant(scene, parameters, object_name, displacement, seed, tilt_deg=tilt_of(faults), profile=profile)
    name = with_profile("direct", conditions.profile)
    return SimulatedCell(plant, scene, parameters, seed, faults=faults).as_cell(name)


def plant_files(conditions: Iterable[Conditions] = ()) -> list[Path]:
    """Return the files of the simulated cell: contact and scatter of a result come from them too.

    conditions: those of the plan, for the files of their profiles; that of the ideal one says nothing. Raises
    ConfigurationError for an unknown profile.
    """
    profiles = sorted({each.profile for each in conditions} - {IDEAL})
    for profile in profiles:
        load_profile(profile)
    paths = [Path(profile) for profile in profiles if profile.endswith(".toml")]
    wanted = [("sim_robot.scenes", "grab.toml"), ("sim_robot.parameters", "plant.toml")]
    wanted += [("sim_robot.parameters", f"profiles/{each}.toml") for each in profiles if not each.endswith(".toml")]
    for package, name in wanted:
        with as_file(files(package) / name) as path:
            paths.append(path)
    return paths


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
