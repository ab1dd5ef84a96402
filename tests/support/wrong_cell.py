"""Cells that were built otherwise than their file says, and what a person who touches gauges measures there."""

from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from rtstack.calibration.fit import Geometry, Observation, calibrate
from rtstack.calibration.points import Point, nominal_geometry
from rtstack.cells import load_description
from rtstack.model.arm_model import flange_pose
from rtstack.model.cell_description import CellDescription

SWAPS = ("labels", "joints", "led")


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
        file.faces + rng.uniform(-how.pad_m, how.pad_m, file.faces.shape),
        rng.uniform(-how.marker_m, how.marker_m, file.faces.shape) + (0.0, 0.0, 0.05),
        file.sides,
    )


def measured(
    description: CellDescription, real: Geometry, rng: np.random.Generator, how: Wrongness, poses: int = 12,
    tracked: bool = True,
) -> list[Observation]:  # fmt: skip
    """Return what is measured there: `poses` places that each pad touches, and a marker on each flange meanwhile."""
    mountings = description.arms
    points = []
    for k in range(poses):
        turns = rng.uniform(-how.turn_rad, how.turn_rad, description.home.shape)
        flanges = np.array([flange_pose(m.robot, np.array(m.home) + q) for m, q in zip(mountings, turns, strict=True)])
        pads = real.pads(flanges[None])[0]
        markers = replace(real, faces=real.markers).pads(flanges[None])[0]
        seen = np.linalg.inv(real.tracker)
        for side, name in enumerate(description.sides):
            place = pads[side] + how.noise_m * rng.standard_normal(3)
            points.append(Observation(f"{name} {k + 1}", "touch", side, flanges, place))
            if tracked:
                place = seen[:3, :3] @ markers[side] + seen[:3, 3] + how.noise_m * rng.standard_normal(3)
                points.append(Observation(f"{name} marker {k + 1}", "see", side, flanges, place))
    return points


def touched_points(description: CellDescription, real: Geometry, noise_m: float) -> dict[str, Point]:
    """Return a file's points: twelve places that each pad touches in a cell that really is so."""
    rng, points = np.random.default_rng(0), {}
    mountings = description.arms
    for k in range(12):
        q = description.home + rng.uniform(-0.45, 0.45, description.home.shape)
        joints = {f"q_{side}": tuple(row) for side, row in zip(description.sides, q.tolist(), strict=True)}
        flanges = np.array([flange_pose(arm.robot, row) for arm, row in zip(mountings, q, strict=True)])
        pads = real.pads(flanges[None])[0] + noise_m * rng.standard_normal((len(mountings), 3))
        for side, place in zip(description.sides, pads.tolist(), strict=True):
            points[f"{side}-{k}"] = Point("touch", side, tuple(place), **joints)  # pyright: ignore[reportArgumentType]
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


def accuracy(seed: int, how: Wrongness, tracked: bool) -> dict[str, float]:
    """Calibrate the cell of a seed. Return its errors, and whether (0 or 1) what was stated covers the truth."""
    description, rng = load_description(None)[0], np.random.default_rng(seed)
    real = built(description, rng, how)
    points = measured(description, real, rng, how, tracked=tracked)
    fit = calibrate(points, nominal_geometry(description))
    at, turn, place = off(fit.geometry, real, points)
    low, high = fit.rms_interval_m
    return {
        "base_m": float(np.median(at)), "base_rad": float(np.median(turn)), "place_m": place,
        "stated_m": fit.place_m, "covered": float(place <= fit.place_m),
        "spread": float(low <= np.sqrt(3.0) * how.noise_m <= high), "none_wrong": float(not fit.wrong),
    }  # fmt: skip
