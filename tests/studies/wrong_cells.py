"""How well points find a cell that was built wrong, and whether swapped sides and a bad point are named.

Each cell is built otherwise than its file says: bases by 50 mm and 6 degrees, the tracker by 0.5 m and any angle, pads
by 5 mm, each at most. A person touches twelve places with each pad, to the variant's accuracy along each axis.

Takes two minutes.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import ClassVar

import numpy as np

from rtstack.calibration.fit import SidesSwapped, calibrate
from rtstack.calibration.points import nominal_geometry
from rtstack.cells import load_description
from rtstack.experiments.experiment import Row
from rtstack.experiments.report import Table
from tests.studies.study import Case, Study
from tests.support.wrong_cell import SWAPS, Wrongness, accuracy, built, exchanged, measured, with_bad_point

FIGURES = {
    "base_m": "base, mm", "base_rad": "turn, deg", "place_m": "place, mm", "stated_m": "stated, mm",
    "covered": "covers", "spread": "rms covers", "none_wrong": "no false alarm", "named": "swaps and bad point named",
}  # fmt: skip
SCALE = {"base_m": 1e3, "base_rad": 180.0 / np.pi, "place_m": 1e3, "stated_m": 1e3}


class WrongCells(Study):
    """The study."""

    COLUMNS: ClassVar = {**dict.fromkeys(FIGURES, float)}
    unit = "cells"

    @staticmethod
    def run(out: Path, case: Case) -> Row:
        """Calibrate one cell, then with its sides swapped in each way, then with one bad point."""
        millimetres, _, markers = case.variant.partition(" mm")
        how, description = Wrongness(noise_m=1e-3 * float(millimetres)), load_description(None)[0]
        row = accuracy(case.seed, how, bool(markers))
        rng, file = np.random.default_rng(case.seed), nominal_geometry(description)
        points, named = measured(description, built(description, rng, how), rng, how, tracked=False), 0
        for swap in SWAPS:
            try:
                calibrate(exchanged(points, swap), file)
            except SidesSwapped:
                named += 1
        wrong, name = with_bad_point(points, rng)
        named += name in calibrate(wrong, file).wrong
        return row | {"named": named / (1 + len(SWAPS))}

    def tables(self, rows: Sequence[Row]) -> tuple[list[Table], list[str]]:
        """Return the median of the bases' errors, and the mean of everything else."""
        lines = []
        for variant in self.specification.variants:
            own = [row for row in rows if row["variant"] == variant]
            middle = {key: np.median if key.startswith("base") else np.mean for key in FIGURES}
            if own:
                values = (SCALE.get(key, 1.0) * middle[key]([row[key] for row in own]) for key in FIGURES)
                lines.append([variant, *(f"{value:.3f}" for value in values)])
        return [Table("Wrong cells", ("touched to", *FIGURES.values()), lines)], []
