"""`python -m tests.programs.wrong_cells [--cells 200]`: how well points find a cell that was built wrong; a table.

Each cell is built otherwise than its file says: bases by 50 mm and 6 degrees, the tracker by 0.5 m and any angle, pads
by 5 mm, each at most. A person touches twelve places with each pad.
"""

import argparse

import numpy as np

from rtstack.calibration.fit import SidesSwapped, calibrate
from rtstack.calibration.points import nominal_geometry
from rtstack.cells import load_description
from tests.support.wrong_cell import Wrongness, built, exchanged, measured, off, with_bad_point

CASES = {
    "touched to 0.3 mm": (Wrongness(noise_m=3e-4), False),
    "touched to 0.5 mm": (Wrongness(), False),
    "touched, and markers seen, to 0.5 mm": (Wrongness(), True),
    "touched to 1 mm": (Wrongness(noise_m=1e-3), False),
}
SWAPS = ("labels", "joints", "led")


def accuracy(cells: int, how: Wrongness, tracked: bool) -> dict[str, float]:
    """Return medians over cells and bases, and shares of the cells in which what was stated covers the truth."""
    description, rows, bases = load_description(None)[0], [], []
    for seed in range(cells):
        rng = np.random.default_rng(seed)
        real = built(description, rng, how)
        points = measured(description, real, rng, how, tracked=tracked)
        fit = calibrate(points, nominal_geometry(description))
        at, turn, place = off(fit.geometry, real, points)
        bases.append((at, turn))
        low, high = fit.rms_interval_m
        rows.append(
            (place, fit.place_m, place <= fit.place_m, low <= np.sqrt(3.0) * how.noise_m <= high, len(fit.wrong) == 0)
        )
    metres, radians = np.median(np.array(bases).transpose(0, 2, 1).reshape(-1, 2), axis=0)
    place, stated, covered, spread, none_wrong = np.mean(np.array(rows, dtype=float), axis=0)
    return {
        "base, mm": 1e3 * metres, "base, deg": np.degrees(radians), "place, mm": 1e3 * place,
        "stated, mm": 1e3 * stated, "covers": covered, "rms covers": spread, "no false alarm": none_wrong,
    }  # fmt: skip


def named(cells: int) -> dict[str, float]:
    """Return the shares of the cells in which swapped sides, and a bad point, were named."""
    description, how = load_description(None)[0], Wrongness()
    found = dict.fromkeys([*(f"sides swapped: {swap}" for swap in SWAPS), "one bad point"], 0.0)
    for seed in range(cells):
        rng = np.random.default_rng(seed)
        points = measured(description, built(description, rng, how), rng, how, tracked=False)
        file = nominal_geometry(description)
        for swap in SWAPS:
            try:
                calibrate(exchanged(points, swap), file)
            except SidesSwapped:
                found[f"sides swapped: {swap}"] += 1.0 / cells
        wrong, name = with_bad_point(points, rng)
        found["one bad point"] += (name in calibrate(wrong, file).wrong) / cells
    return found


def main() -> None:
    """Print both tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--cells", type=int, default=200)
    cells = parser.parse_args().cells
    for case, (how, tracked) in CASES.items():
        row = accuracy(cells, how, tracked)
        print(f"{case:<38}" + "  ".join(f"{name} {value:.3f}" for name, value in row.items()))
    for what, share in named(cells).items():
        print(f"{what:<38}named in {100 * share:.1f} % of {cells}")


if __name__ == "__main__":
    main()
