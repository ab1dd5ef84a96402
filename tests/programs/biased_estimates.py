"""Trials on robots whose force estimate is biased: impacts missed and detected early, without and with a tare.

    .venv/bin/python -m tests.programs.biased_estimates [--bias 0 1 2 3 4 5 6 7 8] [--seeds 2] [--out TABLE.csv]

Both arms are biased, by what a constant force at the pad would be where the arm begins, in six directions. The
recording is a good robot's. A trial counts as missed where no impact was detected within 50 ms of the first touch, as
the plant knows it, and as early where one was detected before. The largest force is the estimate's, the bias taken
off, until half a second after the end.
"""

import argparse
import csv
import sys
from collections import Counter
from dataclasses import replace
from math import inf
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from rtstack.cells import default_cell_file, load_description, open_cell
from rtstack.control.parameters import DetectorParameters
from rtstack.log.reader import read_log
from rtstack.model.arm_model import ArmModel
from rtstack.model.cell_description import ArmMounting, CellDescription
from rtstack.references.demonstration import end_effector_pose
from rtstack.trials.assembly import cell_parameters
from rtstack.trials.demonstration import run_demonstration
from rtstack.trials.record import open_log
from rtstack.trials.run_context import RunContext
from rtstack.trials.specification import DemonstrationSpecification, TrialSpecification
from rtstack.trials.trial import prepare_trial, run_trial
from sim_robot.cell import SimulatedCell, simulated_cell
from sim_robot.faults.file import faults_in

OBJECT = "rice_box"
DIRECTIONS = np.vstack([np.eye(3), -np.eye(3)])
LAWS = {"paper": DetectorParameters(tare_n=inf), "tare": DetectorParameters()}


def bias_of(cell: CellDescription, mounting: ArmMounting, force_n: np.ndarray) -> list[float]:
    """Return what the joint sensors are off by, (7,) Nm, so that the pad seems to exert this force (3,) N."""
    model = ArmModel(mounting, cell.pad)
    place, _ = end_effector_pose(model, np.array(mounting.home))
    return ((model.J0[:3] + np.cross(model.J0[3:].T, place).T).T @ force_n).tolist()


class Truth:
    """Sees each millisecond of a plant. first: the one in which a pad first touches; largest: force on a pad, N."""

    def __init__(self, plant: SimulatedCell, force_n: np.ndarray) -> None:
        self._plant, self._force_n, self._advance = plant, force_n, plant.next_state
        self.tick, self.first, self.largest = 0, -1, 0.0
        plant.next_state = self._look  # type: ignore[method-assign]

    def _look(self) -> None:
        self._advance()
        assert self._plant.faults is not None
        if self.first < 0 and self._plant.faults.plant.pad_touches_object():
            self.first = self.tick
        forces = self._plant.states["O_F_ext_hat_K"][:, :3] - self._force_n  # the bases have the world's axes
        self.largest = max(self.largest, float(np.linalg.norm(forces, axis=1).max()))
        self.tick += 1


def one(cell: CellDescription, reference: Path, law: str, force_n: np.ndarray, seed: int) -> dict[str, object]:
    """Run a trial; return what became of it."""
    faults = [
        {"kind": "tau_sensor_bias", "arm": side, "at_s": 0.0, "bias_Nm": bias_of(cell, mounting, force_n)}
        for side, mounting in (("left", cell.left), ("right", cell.right))
    ]
    parameters = replace(cell_parameters(cell), detector=LAWS[law])
    prepared = prepare_trial(TrialSpecification(str(reference), seed=seed), cell, parameters)
    plant = simulated_cell(OBJECT, 0.0, seed, faults=faults_in({"fault": faults}, ""))
    truth = Truth(plant, force_n)
    result = run_trial(prepared, plant.as_cell("direct"), RunContext())
    for _ in range(500):
        plant.next_state()
    touch_s = truth.first * 1e-3 if truth.first >= 0 else inf
    detected = result.detected_impact_time_s
    late = detected is None or detected > touch_s + 0.05
    kind = "missed" if late else "early" if detected < touch_s - 0.002 else "in time"
    return {"law": law, "bias": float(np.linalg.norm(force_n)), "kind": kind, "success": result.success,
            "peak": truth.largest, "reason": result.failure_reason or ""}  # fmt: skip


def main() -> int:
    """Run all, print a table."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--bias", type=float, nargs="+", default=[float(n) for n in range(9)], help="N")
    parser.add_argument("--seeds", type=int, default=2)
    parser.add_argument("--out", type=Path)
    asked = parser.parse_args()
    cell, _ = load_description(None)
    rows = []
    with TemporaryDirectory() as folder:
        reference = Path(folder) / "reference.mcap"
        arms = open_cell("direct", OBJECT, 0.0, 0)
        log = open_log(reference, DemonstrationSpecification(), cell, "direct", default_cell_file())
        run_demonstration(DemonstrationSpecification(), cell, arms, RunContext(log))
        read_log(reference)
        for newtons in asked.bias:
            for direction in DIRECTIONS if newtons else DIRECTIONS[:1]:
                for seed in range(asked.seeds):
                    rows += [one(cell, reference, law, newtons * direction, seed) for law in LAWS]
            for law in LAWS:
                of = [row for row in rows if row["law"] == law and row["bias"] == newtons]
                kinds = Counter(row["kind"] for row in of)
                peak = max(float(str(row["peak"])) for row in of)
                good = sum(bool(row["success"]) for row in of)
                print(
                    f"{newtons:g} N, {law}: {dict(kinds)}, {good} of {len(of)} succeed, at most {peak:.0f} N",
                    flush=True,
                )
                print("  " + "; ".join(sorted({str(row["reason"]) for row in of if row["reason"]})))
    if asked.out is not None:
        with asked.out.open("w", newline="") as file:
            writer = csv.DictWriter(file, list(rows[0]))
            writer.writeheader()
            writer.writerows(rows)
    return 0


if __name__ == "__main__":
    sys.exit(main())
