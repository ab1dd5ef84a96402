"""Boxes that a real arm has hit and that slid until friction stopped them: how fast they left the hand.

The set's hitting flux is what a rigid impact map without restitution says of the box's velocity: m_arm / (m_arm +
m_box) times the hand's, with the arm's inertia felt at the hand. A box that leaves with (1 + e) times that slides
(1 + e)^2 flux^2 / (2 mu g): restitution e and friction mu make one number of it, fitted for each table and robot.
"""

import csv
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from hal.base.arrays import Array
from reality.comparison import Finding
from rtstack.trials.errors import TrialError

Mask = NDArray[np.bool_]

COLUMNS = ("IiwaNumber", "HittingFlux", "DistanceTraveled", "HittingInertia")
MOVED_M = 0.05  # below it the hand has missed the box
BOX_KG = {"D1": 0.4, "D2": 1.915, "D3": 0.4, "D4": 1.915, "D5": 0.392}  # object_mass of the sets' hitting_params.yaml
LIGHT, HEAVY, ROBOT = "D1", "D2", 7  # one table's number, judged on the other: boxes of other mass, the same robot
# of the joint positions of two recordings (D1, 8 May 2024, hits 107 and 100) and iiwa14.urdf of the GitHub repository
# epfl-lasa/iam_dual_arm_control: by how much the FR3's B_theta adds to the inertia at the hand (the iiwa's own is not
# published), and the inertia of the whole arm as one free rigid body, kg
REFLECTED = {7: 1.29, 14: 1.31}
COMPOSITE_KG = {7: 10.0, 14: 10.6}
RESTITUTION, FRICTION = 0.66, 0.206  # of the box's path in the first of these recordings: speed and deceleration
GRAVITY = 9.81


@dataclass(frozen=True, slots=True)
class Hits:
    """The hits (n,) that have moved the box. session: when it was recorded, "" where a table does not say.

    inertia: of the rigid links at the hand, kg; box: its mass, kg.
    """

    table: NDArray[np.str_]
    session: NDArray[np.str_]
    robot: Array
    flux: Array
    distance: Array
    inertia: Array
    box: Array


def compare(folder: Path) -> Finding:
    """Fit on every second hit, judge on the others: error of the box's speed after the hit, % of the speed."""
    hits = _hits(folder)
    speed = np.sqrt(hits.distance)  # of the box, but for sqrt(2 mu g), which the fit contains
    half = np.arange(len(speed)) % 2 == 0
    both = np.char.add(hits.table, hits.robot.astype(int).astype(str))
    its, days = ([names == name for name in np.unique(names)] for names in (both, np.char.add(both, hits.session)))
    light = (hits.table == LIGHT) & (hits.robot == ROBOT)
    heavy = (hits.table == HEAVY) & (hits.robot == ROBOT)
    hand = hits.flux * (hits.inertia + hits.box) / hits.inertia
    reflected, composite = (np.array([values.get(int(r), np.nan) for r in hits.robot])
                            for values in (REFLECTED, COMPOSITE_KG))  # fmt: skip
    quantities = {
        "impact map, rigid links": hits.flux,
        "impact map, with reflected inertia": hand / (1.0 + hits.box / (reflected * hits.inertia)),
        "impact map, arm as one rigid body": hand / (1.0 + hits.box / composite),
        "impact map, arm of infinite inertia": hand,
        "the mean speed, whatever the flux": np.ones_like(speed),
    }

    def row(predicted: Array, transferred: Array | None) -> list[float | None]:
        error = 100.0 * np.abs(predicted - speed)[~half] / speed[~half]
        other = None
        if transferred is not None and light.any() and heavy.any():
            other = float(np.median(100.0 * np.abs(transferred - speed)[heavy] / speed[heavy]))
        return [float(np.median(error)), float(error.mean()), float(np.quantile(error, 0.9)), other]

    lines = {name: row(_scaled(each, speed, its, half), _scaled(each, speed, [light | heavy], light))
             for name, each in quantities.items()}  # fmt: skip
    regression = "regression of the distance on the flux"
    lines[regression] = row(
        _regression(hits.flux, hits.distance, its, half), _regression(hits.flux, hits.distance, [light | heavy], light)
    )
    lines["impact map, rigid links, a number for each session"] = row(_scaled(hits.flux, speed, days, half), None)
    known = (1.0 + RESTITUTION) / np.sqrt(2.0 * FRICTION * GRAVITY) * hits.flux
    lines["impact map, rigid links, nothing fitted"] = row(known, known)
    return Finding(
        len(speed), int(np.sum(~half)), "% of the speed",
        ["median", "mean", "90 % of hits below", "heavy box by the light one's number, median"], lines,
        next(iter(quantities)), regression,
        "one number for each table and robot, (1 + e) / sqrt(2 mu g); the regression has two for each",
    )  # fmt: skip


def _scaled(quantity: Array, speed: Array, groups: list[Mask], fit: Mask) -> Array:
    """Return the quantity times one factor for each group: the median of the ratio on the hits of the fit."""
    out = np.full_like(speed, np.nan)
    for its in groups:
        if (its & fit).any():
            out[its] = quantity[its] * np.median(speed[its & fit] / quantity[its & fit])
    return out


def _regression(flux: Array, distance: Array, groups: list[Mask], fit: Mask) -> Array:
    """Return the square root of the distance as a straight line over the flux, one for each group."""
    out = np.full_like(distance, np.nan)
    for its in groups:
        if np.sum(its & fit) > 1:
            out[its] = np.polyval(np.polyfit(flux[its & fit], distance[its & fit], 1), flux[its])
    return np.sqrt(np.maximum(out, 0.0))


def _hits(folder: Path) -> Hits:
    rows = []
    for path in sorted(folder.glob("*.csv")):
        table = path.stem[:2]
        if table not in BOX_KG:
            raise TrialError(f"{path}: its name begins with none of {', '.join(BOX_KG)}: the mass of its box is open")
        with path.open(newline="", encoding="utf-8") as file:
            rows += [(table, row.get("RecSession", ""), *(float(row[name]) for name in COLUMNS))
                     for row in csv.DictReader(file)]  # fmt: skip
    rows = [row for row in rows if row[4] > MOVED_M]
    table, session, robot, flux, distance, inertia = (np.array(column) for column in zip(*rows, strict=True))
    return Hits(table, session, robot, flux, distance, inertia, np.array([BOX_KG[name] for name in table]))
