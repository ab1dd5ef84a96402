"""Cells that were built otherwise than their file says, and what a person who touches gauges measures there."""

from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from rtstack.calibration.fit import Geometry, Observation
from rtstack.calibration.points import Point, nominal_geometry
from rtstack.model.arm_model import flange_pose
from rtstack.model.cell_description import CellDescription


@dataclass(frozen=True, slots=True)
class Wrongness:
    """How wrong a cell is, at most, and how well a person touches (standard deviation, each axis). m, rad."""

    base_m: float = 0.05
    base_rad: float = 0.1
    tracker_m: float = 0.5
    tracker_rad: float = np.pi
    pad_m: float = 0.005
    marker_m: float = 0.05
    noise_m: float = 5e-4
    turn_rad: float = 0.45  # of each joint, either way, between two poses


def _moved(T: np.ndarray, rng: np.random.Generator, metres: float, radians: float) -> np.ndarray:
    T = T.copy()
    axis = rng.standard_normal(3)
    T[:3, :3] = Rotation.from_rotvec(axis / np.linalg.norm(axis) * rng.uniform(0.0, radians)).as_matrix() @ T[:3, :3]
    T[:3, 3] += rng.uniform(-metres, metres, 3)
    return T


def built(description: CellDescription, rng: np.random.Generator, how: Wrongness) -> Geometry:
    """Return where everything really is."""
    file = nominal_geometry(description)
    return Geometry(
        np.array([_moved(T, rng, how.base_m, how.base_rad) for T in file.bases]),
        _moved(file.tracker, rng, how.tracker_m, how.tracker_rad),
        file.faces + rng.uniform(-how.pad_m, how.pad_m, (2, 3)),
        rng.uniform(-how.marker_m, how.marker_m, (2, 3)) + (0.0, 0.0, 0.05),
    )


def measured(
    description: CellDescription, real: Geometry, rng: np.random.Generator, how: Wrongness, poses: int = 12,
    tracked: bool = True,
) -> list[Observation]:  # fmt: skip
    """Return what is measured there: `poses` places that each pad touches, and a marker on each flange meanwhile."""
    mountings = (description.left, description.right)
    points = []
    for k in range(poses):
        turns = rng.uniform(-how.turn_rad, how.turn_rad, (2, 7))
        flanges = np.array([flange_pose(m.robot, np.array(m.home) + q) for m, q in zip(mountings, turns, strict=True)])
        pads = real.pads(flanges[None])[0]
        markers = replace(real, faces=real.markers).pads(flanges[None])[0]
        seen = np.linalg.inv(real.tracker)
        for side, name in enumerate(("left", "right")):
            place = pads[side] + how.noise_m * rng.standard_normal(3)
            points.append(Observation(f"{name} {k + 1}", "touch", side, flanges, place))
            if tracked:
                place = seen[:3, :3] @ markers[side] + seen[:3, 3] + how.noise_m * rng.standard_normal(3)
                points.append(Observation(f"{name} marker {k + 1}", "see", side, flanges, place))
    return points


def touched_points(description: CellDescription, real: Geometry, noise_m: float) -> dict[str, Point]:
    """Return a file's points: twelve places that each pad touches in a cell that really is so."""
    rng, points = np.random.default_rng(0), {}
    mountings = (description.left, description.right)
    for k in range(12):
        q = np.array([arm.home for arm in mountings]) + rng.uniform(-0.45, 0.45, (2, 7))
        left, right = (tuple(row) for row in q.tolist())
        flanges = np.array([flange_pose(arm.robot, row) for arm, row in zip(mountings, q, strict=True)])
        pads = real.pads(flanges[None])[0] + noise_m * rng.standard_normal((2, 3))
        for side, place in zip(("left", "right"), pads.tolist(), strict=True):
            points[f"{side}-{k}"] = Point("touch", side, tuple(place), left, right)
    return points


def off(found: Geometry, real: Geometry, points: list[Observation]) -> tuple[np.ndarray, np.ndarray, float]:
    """Return how far each base is off, (2,) m, its turn, (2,) rad, and at most a pad or what is seen at a point, m."""
    base = np.linalg.norm(found.bases[:, :3, 3] - real.bases[:, :3, 3], axis=1)
    turns = Rotation.from_matrix(found.bases[:, :3, :3] @ real.bases[:, :3, :3].transpose(0, 2, 1)).magnitude()
    flanges = np.array([point.flanges for point in points])
    worst = np.linalg.norm(found.pads(flanges) - real.pads(flanges), axis=2).max()
    seen = np.array([(*point.place, 1.0) for point in points if point.what == "see"]).reshape(-1, 4)
    tracked = np.linalg.norm(seen @ (found.tracker - real.tracker).T, axis=1)
    return base, turns, float(max(worst, *tracked, 0.0))


def exchanged(points: list[Observation], how: str) -> list[Observation]:
    """Return the points as they are where the sides are swapped.

    labels: the left box is the right arm, and its points are the other one's too; joints: only the joints are the other
    arm's; led: the person led an arm whose joints came in as the other one's, which stood.
    """
    turned = [replace(p, flanges=p.flanges[::-1].copy()) for p in points]
    if how == "joints":
        return turned
    if how == "labels":
        return [replace(p, side=1 - p.side) for p in turned]
    first = points[0].flanges
    return [
        replace(p, flanges=np.array([first[k] if k == p.side else p.flanges[1 - k] for k in (0, 1)])) for p in points
    ]


def with_bad_point(points: list[Observation], rng: np.random.Generator) -> tuple[list[Observation], str]:
    """Return the points, one of them 6 to 60 mm off, and its name."""
    index, away = int(rng.integers(len(points))), rng.standard_normal(3)
    bad = points[index]
    place = bad.place + rng.uniform(0.006, 0.06) * away / np.linalg.norm(away)
    return [*points[:index], replace(bad, place=place), *points[index + 1 :]], bad.name
