"""A simulated cell of which everything is known exactly, and a tracker that sees nothing."""

from dataclasses import replace

from sim_robot.cell import SimulatedCell
from sim_robot.plant import Plant
from sim_robot.plant_parameters import ZEROS, PlantParameters, load_plant_parameters
from sim_robot.scene import load_scene


def nominal_cell(object_name: str) -> SimulatedCell:
    """Return a cell without scatter, noise or quantisation, in lockstep."""
    layout, parameters = load_scene(), load_plant_parameters().nominal()
    return SimulatedCell(Plant.nominal(layout, parameters, object_name, 0.0), layout, parameters, seed=0)


def frictionless(parameters: PlantParameters) -> PlantParameters:
    """Return the same plant without joint friction."""
    return replace(parameters, joints=replace(parameters.joints, friction_p1=ZEROS))
