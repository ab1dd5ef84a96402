"""Rigid impact maps of any scene: arms, free boxes, supports, unilateral contacts with Coulomb friction.

from rtstack.impact_map import impact_map, load_scene
result = impact_map(load_scene(path))
result.twist("left")            # the pad after the impact, contacts maintained
result.single_step.impulses     # what one step says
"""

from rtstack.impact_map.coulomb import ContactState, LawResiduals
from rtstack.impact_map.map import converged, impact_map, pressed, single_step
from rtstack.impact_map.problem import Problem, problem_of
from rtstack.impact_map.result import Impact, ImpactMap, MapKind, Status
from rtstack.impact_map.scene import Arm, Box, Contact, Plane, ReflectedInertia, Scene, SceneError, load_scene

__all__ = [
    "Arm", "Box", "Contact", "ContactState", "Impact", "ImpactMap", "LawResiduals", "MapKind", "Plane", "Problem",
    "ReflectedInertia", "Scene", "SceneError", "Status", "converged", "impact_map", "load_scene", "pressed",
    "problem_of", "single_step",
]  # fmt: skip
