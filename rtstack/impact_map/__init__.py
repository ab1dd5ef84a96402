"""Rigid impact maps of any scene, model or arrays: bodies, supports, unilateral contacts with Coulomb friction.

from rtstack.impact_map import impact_map, load_scene, problem_from_arrays, single_step
result = impact_map(load_scene(path))
result.twist("left")            # the pad after the impact, contacts maintained
result.single_step.impulses     # what one step says
single_step(problem_from_arrays(M, J, velocity, friction)).velocity     # of any bodies
"""

from rtstack.impact_map.arrays import problem_from_arrays
from rtstack.impact_map.coulomb import ContactState, LawResiduals
from rtstack.impact_map.map import converged, impact_map, pressed, single_step
from rtstack.impact_map.models import problem_from_mujoco, problem_from_urdf
from rtstack.impact_map.patch import frame_of
from rtstack.impact_map.problem import Problem, problem_of
from rtstack.impact_map.result import Impact, ImpactMap, MapKind, Status
from rtstack.impact_map.scene import Arm, Box, Contact, Plane, ReflectedInertia, Scene, SceneError, load_scene

__all__ = [
    "Arm", "Box", "Contact", "ContactState", "Impact", "ImpactMap", "LawResiduals", "MapKind", "Plane", "Problem",
    "ReflectedInertia", "Scene", "SceneError", "Status", "converged", "frame_of", "impact_map", "load_scene", "pressed",
    "problem_from_arrays", "problem_from_mujoco", "problem_from_urdf", "problem_of", "single_step",
]  # fmt: skip
