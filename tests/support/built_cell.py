"""Simulated cells that were built otherwise than their file says, and arms that a person leads there."""

from importlib.resources import files
from pathlib import Path

import numpy as np

from hal.base.configuration import toml_text
from sim_robot.cell import SimulatedCell

WAY_MS = 900


def profile(path: Path, built: dict[str, object]) -> Path:
    """Write the ideal profile of a cell that was built so."""
    text = (files("sim_robot") / "parameters/profiles/ideal.toml").read_text(encoding="utf-8")
    path.write_text(text + toml_text({"built": built}), encoding="utf-8")
    return path


def led(cell: SimulatedCell, homes: np.ndarray, rng: np.random.Generator) -> None:
    """Lead both arms to a posture near home, and let them come to rest."""
    start = cell.states["q"].copy()
    goal = homes + rng.uniform(-0.4, 0.4, (2, 7))
    goal[:, 1] -= 0.3  # above the table
    for k in range(WAY_MS + 300):
        share = min(1.0, k / WAY_MS)
        for side in (0, 1):
            cell.plant.track(side, start[side] + share * (goal[side] - start[side]), np.zeros(7))
        cell.next_state()
