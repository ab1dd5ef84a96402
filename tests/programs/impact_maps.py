"""How long the impact map of a dual-arm grab takes: two pads and a table, four corners each, set-up included.

`python -m tests.programs.impact_maps [--maps 500] [--json]`: every map is of another configuration, from the scene
to the result; only the arms' model is kept, as it is between any two maps. Beside it, turn by turn, the yardstick: one
LAPACK solve of 36 equations. Nothing else should compute meanwhile; a map is to take at most 1.5 ms.

setup_us: from the scene to matrices. converged_us, single_step_us: one of both maps, set-up included. both_us: both.
confirmed_us: both, with PGS as second opinion. ratio: both_us over the yardstick. All are medians.
"""

import argparse
import json
import time
from dataclasses import replace
from pathlib import Path

import numpy as np

from rtstack.impact_map import converged, impact_map, load_scene, problem_of, single_step

EQUATIONS = 36
WARM_UP = 20


def measured(maps: int) -> dict[str, float]:
    """Return the medians, us, and the ratio."""
    scene = load_scene(Path("deploy/impacts/grab.toml"))
    rng = np.random.default_rng(0)
    matrix = rng.normal(size=(EQUATIONS, EQUATIONS)) + EQUATIONS * np.eye(EQUATIONS)
    right = rng.normal(size=EQUATIONS)
    work = {
        "setup_us": lambda: problem_of(scene),
        "converged_us": lambda: converged(problem_of(scene), second_opinion=False),
        "single_step_us": lambda: single_step(problem_of(scene), second_opinion=False),
        "both_us": lambda: impact_map(scene, second_opinion=False),
        "confirmed_us": lambda: impact_map(scene),
        "yardstick_us": lambda: np.linalg.solve(matrix, right),
    }
    times = {name: np.empty(maps) for name in work}
    for k in range(-WARM_UP, maps):
        arms = {}
        for name, arm in scene.arms.items():
            arms[name] = replace(arm, q=tuple(np.array(arm.q) + rng.normal(0.0, 1e-4, 7)))
        scene = replace(scene, arms=arms)
        for name, call in work.items():
            begin = time.perf_counter_ns()
            call()
            if k >= 0:
                times[name][k] = (time.perf_counter_ns() - begin) * 1e-3
    medians = {name: float(np.median(values)) for name, values in times.items()}
    return {"maps": maps, **medians, "ratio": medians["both_us"] / medians["yardstick_us"]}


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--maps", type=int, default=500)
    parser.add_argument("--json", action="store_true")
    options = parser.parse_args()
    figures = measured(options.maps)
    if options.json:
        print(json.dumps(figures))
        return
    for name, value in figures.items():
        print(f"{name:<16} {value:10.1f}")


if __name__ == "__main__":
    main()
