"""How far good trials stay inside each limit of the judge: what a cell's [safety] table may be tightened to.

    .venv/bin/python tests/safety/good_trials.py [--trials 30]

Grabs of the cell's objects in the direct cell: all controllers at three displacements with the first object, then the
other objects with the controllers in turn. Prints what came closest to each limit, over all ticks before the stop, and
the interventions; exit status 1 where there was one.
"""

import argparse
import sys
import tempfile
from collections.abc import Iterator
from itertools import cycle
from pathlib import Path

import numpy as np

from rtstack.cli.cells import default_cell_file, open_cell
from rtstack.model.cell_description import CellDescription, load_cell_description
from rtstack.safety.geometry import arm_distance
from rtstack.safety.judge import SafetyJudge, Verdict
from rtstack.trials.record import open_log
from rtstack.trials.run import prepare_trial, run_demonstration, run_trial
from rtstack.trials.specification import Controller, DemonstrationSpecification, TrialSpecification

DISPLACEMENTS_MM = (-30.0, 0.0, 30.0)


class Witness:
    """Sees what every judge sees, and keeps the extremes."""

    def __init__(self) -> None:
        self.lowest: dict[str, np.ndarray] = {}
        self.highest: dict[str, np.ndarray] = {}
        self._judge = SafetyJudge.judge

    def watch(self) -> None:
        """Stand between the session and every judge from now on."""
        witness = self

        def judge(self: SafetyJudge, sample, demand=0, residual=None) -> Verdict:
            verdict = witness._judge(self, sample, demand, residual)
            if not self.stopping:
                witness._see(self, sample[0], residual)
            return verdict

        SafetyJudge.judge = judge

    def _see(self, judge: SafetyJudge, sample: np.void, residual: np.ndarray | None) -> None:
        memory, other = judge.memory[0], judge._other[0]
        self._keep("q", sample["q"])
        self._keep("dq", np.abs(sample["dq"]))
        self._keep("tau_J", np.abs(sample["tau_J"]))
        self._keep("tau_ext", np.abs(sample["tau_ext_hat_filtered"]))
        self._keep("residual", np.abs(residual if residual is not None else np.zeros(7)))
        self._keep("face", memory["face_world"])
        self._keep("speed", np.linalg.norm(memory["face_velocity"]))
        self._keep("power", np.abs(sample["tau_J"] @ sample["dq"]))
        if other["placed"]:
            self._keep("distance of the arms", np.float64(arm_distance(memory, other, judge._rules[0], 9.0)))

    def _keep(self, name: str, value: np.ndarray) -> None:
        self.lowest[name] = np.minimum(self.lowest.get(name, np.inf), value)
        self.highest[name] = np.maximum(self.highest.get(name, -np.inf), value)


def grabs(cell: CellDescription) -> Iterator[tuple[str, Controller, float]]:
    """Yield object, controller and displacement: 12 with the first object, 3 with each other one."""
    first, *others = cell.objects
    controllers = cycle(Controller)
    for controller in Controller:
        yield from ((first, controller, d) for d in DISPLACEMENTS_MM)
    for name in others:
        yield from ((name, next(controllers), d) for d in DISPLACEMENTS_MM)


def record(cell: CellDescription, name: str, path: Path) -> int:
    """Record a demonstration with the object; return its interventions."""
    specification = DemonstrationSpecification(name)
    simulated = open_cell("direct", name, 0.0, 0)
    log = open_log(path, specification, cell, "direct", default_cell_file())
    try:
        return run_demonstration(specification, cell, simulated, log=log).safety_interventions
    finally:
        simulated.close()


def main() -> int:
    """Run the grabs; return the exit status."""
    arguments = argparse.ArgumentParser(description="How far good trials stay inside the judge's limits.")
    arguments.add_argument("--trials", type=int, default=30)
    options = arguments.parse_args()
    cell, witness = load_cell_description(default_cell_file()), Witness()
    witness.watch()
    interventions = good = 0
    with tempfile.TemporaryDirectory() as folder:
        for seed, (name, controller, displacement_mm) in zip(range(options.trials), grabs(cell), strict=False):
            reference = Path(folder) / f"{name}.mcap"
            if not reference.exists():
                interventions += record(cell, name, reference)
            prepared = prepare_trial(TrialSpecification(str(reference), controller, name, displacement_mm, seed), cell)
            simulated = open_cell("direct", name, displacement_mm * 1e-3, seed)
            try:
                result = run_trial(prepared, simulated, log=None)
            finally:
                simulated.close()
            interventions += result.safety_interventions
            good += result.success
            print(f"{name} {controller} {displacement_mm:+.0f} mm: {result.failure_reason or 'good'}", flush=True)
    for name, lowest in witness.lowest.items():
        low, high = (np.array2string(v, precision=3, suppress_small=True) for v in (lowest, witness.highest[name]))
        print(f"{name:<22}{low} to {high}")
    print(f"{interventions} interventions; {good} of {options.trials} trials good")
    return 1 if interventions else 0


if __name__ == "__main__":
    sys.exit(main())
