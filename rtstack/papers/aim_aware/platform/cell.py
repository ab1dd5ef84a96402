"""The simulated cell of the aim-aware arm study: one robot, and a platform that is set up not quite exactly."""

from dataclasses import replace
from functools import lru_cache

import numpy as np

from hal.arrays import Seven
from hal.cell import Cell
from rtstack.papers.aim_aware.platform.setup import Setup, platform_files
from sim_robot.cell import SimulatedCell
from sim_robot.plant import Plant
from sim_robot.plant_parameters import PlantParameters, load_plant_parameters
from sim_robot.scene import Scene, load_scene

PLATFORM_DRAW = 3  # beside 0 arms and placement, 1 sensors, 2 tracker (sim_robot)
NOTHING = "nothing"


@lru_cache(maxsize=1)
def _simulated() -> tuple[Scene, PlantParameters]:
    return load_scene(platform_files()[0]), load_plant_parameters()


def open_platform_cell(setup: Setup, home: Seven, inclination_deg: float, seed: int) -> Cell:
    """Open the cell in this process, in lockstep, the left arm at rest at home (7,). Raises HardwareError.

    The same robot whatever the seed, which draws noise, and how exactly the platform is set up.
    """
    scene, parameters = _simulated()
    assert scene.platform is not None
    draw = np.random.default_rng(np.random.SeedSequence([seed, PLATFORM_DRAW])).standard_normal(2)
    x, y, z = scene.platform.centre
    platform = replace(
        scene.platform,
        centre=(x, y, z + 1e-3 * setup.height_mm * float(draw[0])),
        inclination_deg=inclination_deg + setup.inclination_deg * float(draw[1]),
    )
    scene = replace(scene, platform=platform, left=replace(scene.left, home=home))
    plant = Plant(scene, parameters, NOTHING, 0.0, seed, arms_seed=setup.robot)
    return SimulatedCell(plant, scene, parameters, seed).as_cell("direct")
