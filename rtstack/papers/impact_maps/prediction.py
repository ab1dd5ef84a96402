"""What both rigid impact maps predict for a planned motion, with each inertia of the motors."""

import json
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from rtstack.impact_map import MapKind, ReflectedInertia, Status, converged, single_step
from rtstack.impact_map.problem import Problem
from rtstack.impact_map.scene import joint_inertia
from rtstack.papers.impact_maps.feedback import Direction
from rtstack.planning import PlanError, PlannedMotion
from rtstack.samples import SIDES

_MAPS = {MapKind.SINGLE_STEP: single_step, MapKind.CONVERGED: converged}


@dataclass(frozen=True, slots=True)
class Prediction:
    """Velocities of the pads after the impact, m/s: planned (scaled), and by each map and inertia of the motors."""

    planned: float
    by_map: Mapping[MapKind, Mapping[ReflectedInertia, float]]

    def write(self, path: Path) -> None:
        path.write_text(json.dumps({"planned": self.planned, **self.by_map}), encoding="utf-8")


def read_prediction(path: Path) -> Prediction:
    values = json.loads(path.read_text(encoding="utf-8"))
    by_map = {which: {kind: values[which][kind] for kind in ReflectedInertia} for which in MapKind}
    return Prediction(values["planned"], by_map)


def predict(planned: PlannedMotion, direction: Direction) -> Prediction:
    """Return the predictions of a plan, by map and inertia of the motors. Raises PlanError without a solution."""
    by_map = {
        which: {kind: _predicted(planned, direction, which, kind) for kind in ReflectedInertia} for which in MapKind
    }
    velocities = planned.velocities[list(direction.arms), direction.axis]
    return Prediction(direction.sign * float(velocities.mean()), by_map)


def _predicted(planned: PlannedMotion, direction: Direction, which: MapKind, kind: ReflectedInertia) -> float:
    problem = planned.map.problem
    impact = _MAPS[which](with_inertia(problem, planned.request.inertia, kind), second_opinion=False)
    if impact.status in (Status.INFEASIBLE, Status.UNSOLVED):
        raise PlanError(
            f"impact map {which} with {kind}: {impact.status}, {impact.detail}; plan another height or speed"
        )
    speeds = []
    for arm in direction.arms:
        k = problem.names.index(SIDES[arm])
        twist = problem.bodies[k].twist(impact.velocity[problem.slices[k]])
        speeds.append(direction.sign * float(twist[direction.axis]))
    return float(np.mean(speeds))


def with_inertia(problem: Problem, was: ReflectedInertia, kind: ReflectedInertia) -> Problem:
    """Return the problem with another inertia of the arms' motors: velocities before the impact stay."""
    M = problem.M.copy()
    for body, where in zip(problem.bodies, problem.slices, strict=True):
        if body.robot is not None:
            M[where, where] += np.diag(joint_inertia(kind, body.robot) - joint_inertia(was, body.robot))
    return replace(problem, M=M)
