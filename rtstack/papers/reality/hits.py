"""Boxes that a real arm has hit and that slid until friction stopped them: how fast they left the hand.

The set's hitting flux is what a rigid impact map without restitution says of the box's velocity: m_arm / (m_arm +
m_box) times the hand's, with the arm's inertia felt at the hand. A box that leaves with (1 + e) times that slides
(1 + e)^2 flux^2 / (2 mu g): restitution e and friction mu make one number of it, fitted for each of the two robots.
"""

import csv
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rtstack.papers.reality.comparison import Finding

Array = NDArray[np.float64]

MOVED_M = 0.05  # below it the hand has missed the box
BOX_KG = 0.4  # not in the set: of the order of the papers'; "inertia left out" alone depends on it, by a few percent


def compare(folder: Path) -> Finding:
    """Fit on every second hit, judge on the others: error of the box's speed after the hit, % of the speed."""
    robot, flux, distance, inertia = _hits(folder)
    speed = np.sqrt(distance)  # of the box, but for sqrt(2 mu g), which the fit contains
    fit = np.arange(len(speed)) % 2 == 0
    hand = flux * (inertia + BOX_KG) / inertia
    predicted = {
        "impact map, arm's inertia": _scaled(flux, speed, robot, fit),
        "impact map, arm of infinite inertia": _scaled(hand, speed, robot, fit),
        "regression of the distance on the flux": np.sqrt(np.maximum(_regression(flux, distance, robot, fit), 0.0)),
        "the mean speed, whatever the flux": _scaled(np.ones_like(speed), speed, robot, fit),
    }
    error = {name: 100.0 * np.abs(each - speed)[~fit] / speed[~fit] for name, each in predicted.items()}
    headings = ["median", "mean", "90 % of hits below"]
    first, _, regression, _ = predicted
    return Finding(
        len(speed), int(np.sum(~fit)), "% of the speed", headings,
        {name: [float(np.median(e)), float(e.mean()), float(np.quantile(e, 0.9))] for name, e in error.items()},
        first, regression, "one number for each robot, (1 + e) / sqrt(2 mu g); the regression has two for each",
    )  # fmt: skip


def _scaled(quantity: Array, speed: Array, robot: Array, fit: NDArray[np.bool_]) -> Array:
    """Return the quantity times one factor for each robot: the median of the ratio on the hits of the fit."""
    out = np.empty_like(speed)
    for name in np.unique(robot):
        its = robot == name
        out[its] = quantity[its] * np.median(speed[its & fit] / quantity[its & fit])
    return out


def _regression(flux: Array, distance: Array, robot: Array, fit: NDArray[np.bool_]) -> Array:
    """Return the distance as a straight line over the flux, one for each robot."""
    out = np.empty_like(distance)
    for name in np.unique(robot):
        its = robot == name
        out[its] = np.polyval(np.polyfit(flux[its & fit], distance[its & fit], 1), flux[its])
    return out


def _hits(folder: Path) -> tuple[Array, Array, Array, Array]:
    rows = []
    for path in sorted(folder.glob("*.csv")):
        with path.open(newline="", encoding="utf-8") as file:
            rows += [
                [float(row[name]) for name in ("IiwaNumber", "HittingFlux", "DistanceTraveled", "HittingInertia")]
                for row in csv.DictReader(file)
            ]
    hits = np.array([row for row in rows if row[2] > MOVED_M])
    return hits[:, 0], hits[:, 1], hits[:, 2], hits[:, 3]
