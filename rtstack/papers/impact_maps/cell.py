"""The simulated cell of a validation: one robot in all trials, another contact in each."""

from dataclasses import replace

import numpy as np

from hal.cell import Cell
from rtstack.papers.impact_maps.plan import Conditions
from rtstack.papers.simulated_cell import FRICTION_DRAW, SMALLEST_FACTOR, simulated_files
from sim_robot.cell import SimulatedCell
from sim_robot.plant import Plant
from sim_robot.scene import PlacementScatter


def open_validation_cell(object_name: str, seed: int, robot: int, conditions: Conditions) -> Cell:
    """Open the simulated cell of a trial: the arms of seed `robot`, everything else of `seed`. Raises HardwareError.

    object_name: empty for a cell without an object.
    """
    nominal, parameters = simulated_files()
    draws = np.random.default_rng(np.random.SeedSequence([seed, FRICTION_DRAW])).standard_normal(2)
    pad, table = np.maximum(1.0 + conditions.friction_scatter * draws, SMALLEST_FACTOR).tolist()
    empty = not object_name
    object_name = object_name or next(iter(nominal.objects))
    thing = nominal.find(object_name)
    if conditions.damping_ratio is not None:
        thing = replace(thing, damping_ratio=conditions.damping_ratio)
    scene = replace(
        nominal,
        pad=replace(nominal.pad, friction=conditions.pad_friction * pad),
        table=replace(nominal.table, friction=conditions.table_friction * table),
        placement_scatter=PlacementScatter(conditions.placement_mm, conditions.placement_yaw_deg),
        objects={**nominal.objects, object_name: thing},
    )
    joints = parameters.joints
    B_theta = tuple(conditions.B_theta_factor * inertia for inertia in joints.B_theta)
    parameters = replace(parameters, joints=replace(joints, B_theta=B_theta))
    plant = Plant(scene, parameters, object_name, 0.0, seed, robot)
    return SimulatedCell(plant, scene, parameters, seed, empty=empty).as_cell("direct")
