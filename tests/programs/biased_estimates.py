"""Trials on robots whose force estimate is biased, late and knows the wrong payload: impacts missed and detected early.

    .venv/bin/python -m tests.programs.biased_estimates [--bias 0 1 ... 8] [--delay-ms 0 1 ... 5]
        [--payload-kg -0.3 0 0.3] [--seeds 2] [--out TABLE.csv]

Each combination of the three and a seed is a case: both arms are biased by what a constant force at the pad would be
where the arm begins, each in a direction that bias and seed draw. The recording is a good robot's. A case is run by the
paper's law, and with the tare; whether the trial would be refused before it begins (rtstack.trials.estimate) is counted
beside, and it is run all the same. A trial counts as missed where no impact was detected within 50 ms of the first
touch, as the plant knows it, and as early where one was detected before. The largest force is a pad's on the object, of
the plant's contacts, until half a second after the end.
"""

import argparse
import csv
import sys
import time
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import product
from math import inf
from pathlib import Path
from tempfile import TemporaryDirectory

import mujoco
import numpy as np

from rtstack.cells import default_cell_file, load_description, open_cell
from rtstack.control.parameters import DetectorParameters
from rtstack.model.arm_model import ArmModel
from rtstack.model.cell_description import ArmMounting, CellDescription
from rtstack.references.demonstration import end_effector_pose
from rtstack.trials.assembly import cell_parameters
from rtstack.trials.demonstration import run_demonstration
from rtstack.trials.errors import TrialError
from rtstack.trials.estimate import check_estimate
from rtstack.trials.record import open_log
from rtstack.trials.run_context import RunContext
from rtstack.trials.specification import DemonstrationSpecification, TrialSpecification
from rtstack.trials.trial import PreparedTrial, prepare_trial, run_trial
from sim_robot.cell import SimulatedCell, simulated_cell
from sim_robot.faults.file import faults_in

OBJECT = "rice_box"
LAWS = {"paper": DetectorParameters(tare_n=inf), "tare": DetectorParameters()}
SETTLED_MS = 200  # until the filter of the estimate shows the payload


@dataclass(frozen=True, slots=True)
class Case:
    """What is wrong with both arms' estimates."""

    bias: float
    delay_ms: int
    payload_kg: float
    seed: int

    @property
    def forces(self) -> np.ndarray:
        """What each pad seems to exert where its arm begins, (2, 3) N."""
        directions = np.random.default_rng(self.seed * 1000 + round(self.bias * 10)).normal(size=(2, 3))
        return self.bias * directions / np.linalg.norm(directions, axis=1)[:, None]

    def plant(self, cell: CellDescription) -> SimulatedCell:
        """Return the cell with it. The bias begins with the first motion, as faults do."""
        faults = [
            {"kind": "tau_sensor_bias", "arm": side, "at_s": 0.0, "bias_Nm": bias_of(cell, mounting, force)}
            for side, mounting, force in zip(("left", "right"), (cell.left, cell.right), self.forces, strict=True)
        ]
        plant = simulated_cell(OBJECT, 0.0, self.seed, faults=faults_in({"fault": faults}, ""))
        plant.plant.joints["payload_error"] = self.payload_kg
        plant.sensors._records["delay"] = self.delay_ms
        return plant


def bias_of(cell: CellDescription, mounting: ArmMounting, force_n: np.ndarray) -> list[float]:
    """Return what the joint sensors are off by, (7,) Nm, so that the pad seems to exert this force (3,) N."""
    model = ArmModel(mounting, cell.pad)
    place, _ = end_effector_pose(model, np.array(mounting.home))
    return ((model.J0[:3] + np.cross(model.J0[3:].T, place).T).T @ force_n).tolist()


class Truth:
    """Sees each millisecond of a plant. first: the one in which a pad first touches; largest: force on a pad, N."""

    def __init__(self, cell: SimulatedCell) -> None:
        plant = cell.plant
        self._model, self._data, self._advance = plant.model, plant.data, cell.next_state
        # of each geom: 1 the object's, 2 and 4 the pads'; a contact of both has the sum
        bodies = (plant._object_body, *plant.pad_bodies)
        self._kind = sum(2**k * (plant.model.geom_bodyid == body) for k, body in enumerate(bodies))
        self._wrench = np.zeros(6)
        self.tick, self.first, self.largest = 0, -1, 0.0
        cell.next_state = self._look  # type: ignore[method-assign]

    def _look(self) -> None:
        self._advance()
        kinds = self._kind[self._data.contact.geom].sum(axis=1)
        for pad in (3, 5):
            push = 0.0
            for index in np.flatnonzero(kinds == pad):
                self.first = self.tick if self.first < 0 else self.first
                mujoco.mj_contactForce(self._model, self._data, int(index), self._wrench)
                push += self._wrench[0]  # along the normal: the contacts of one face have the same
            self.largest = max(self.largest, push)
        self.tick += 1


class Still:
    """A link, for arms that are asked for their states and do not move."""


def refused(case: Case, cell: CellDescription) -> bool:
    """Return whether a trial would be refused before it begins."""
    plant = case.plant(cell)
    for _ in range(SETTLED_MS):
        plant.next_state()
    plant.sensors.sense = lambda: None  # type: ignore[method-assign]
    plant.states["O_F_ext_hat_K"][:, :3] += case.forces  # the bases have the world's axes
    try:
        check_estimate(replace(plant.as_cell("direct"), link=Still()), cell, LAWS["tare"])  # type: ignore[arg-type]
    except TrialError:
        return True
    return False


def one(cell: CellDescription, prepared: PreparedTrial, law: str, case: Case) -> dict[str, object]:
    """Run a trial; return what became of it."""
    row: dict[str, object] = {name: getattr(case, name) for name in case.__slots__} | {"law": law}
    row["refused"] = law == "tare" and refused(case, cell)
    prepared = replace(prepared, specification=replace(prepared.specification, seed=case.seed))
    plant = case.plant(cell)
    truth = Truth(plant)
    result = run_trial(prepared, plant.as_cell("direct"), RunContext())
    for _ in range(500):
        plant.next_state()
    touch_s = truth.first * 1e-3 if truth.first >= 0 else inf
    detected = result.detected_impact_time_s
    late_ms = None if detected is None else round(1e3 * (detected - touch_s), 1)
    kind = "missed" if late_ms is None or late_ms > 50.0 else "early" if late_ms < -2.0 else "in time"
    return row | {"kind": kind, "success": result.success, "peak": round(truth.largest, 1), "late_ms": late_ms,
                  "reason": result.failure_reason or ""}  # fmt: skip


def said(rows: Sequence[dict[str, object]]) -> str:
    """Return a line of the table."""
    kinds = Counter(str(row["kind"]) for row in rows)
    peaks = {kind: max((float(str(row["peak"])) for row in rows if row["kind"] == kind), default=0.0) for kind in kinds}
    words = [f"{kinds[kind]} {kind} (at most {peaks[kind]:.0f} N)" for kind in sorted(kinds)]
    missed = sum(row["kind"] == "missed" and not row["refused"] for row in rows)
    succeed, refused_before = (sum(bool(row[name]) for row in rows) for name in ("success", "refused"))
    words.append(f"{succeed} succeed; {refused_before} refused before, {missed} missed of the others")
    return f"{len(rows)} cases: {', '.join(words)}"


def main() -> int:
    """Run all, print a table."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--bias", type=float, nargs="+", default=[float(n) for n in range(9)], help="N")
    parser.add_argument("--delay-ms", type=int, nargs="+", default=list(range(6)))
    parser.add_argument("--payload-kg", type=float, nargs="+", default=[-0.3, 0.0, 0.3])
    parser.add_argument("--seeds", type=int, default=2)
    parser.add_argument("--out", type=Path)
    asked = parser.parse_args()
    cell, _ = load_description(None)
    rows: list[dict[str, object]] = []
    began_s, each = time.monotonic(), list(product(asked.delay_ms, asked.payload_kg, range(asked.seeds)))
    with TemporaryDirectory() as folder:
        reference = Path(folder) / "reference.mcap"
        arms = open_cell("direct", OBJECT, 0.0, 0)
        log = open_log(reference, DemonstrationSpecification(), cell, "direct", default_cell_file())
        run_demonstration(DemonstrationSpecification(), cell, arms, RunContext(log))
        prepared = {
            law: prepare_trial(
                TrialSpecification(str(reference)), cell, replace(cell_parameters(cell), detector=detector)
            )
            for law, detector in LAWS.items()
        }
        for number, newtons in enumerate(asked.bias, 1):
            cases = [Case(newtons, *more) for more in each]
            for law in LAWS:
                of = [one(cell, prepared[law], law, case) for case in cases]
                rows += of
                left_s = (time.monotonic() - began_s) / number * (len(asked.bias) - number)
                print(f"{newtons:g} N, {law}: {said(of)} ({left_s / 60:.0f} min left)", flush=True)
    for law in LAWS:
        of = [row for row in rows if row["law"] == law]
        print(f"all, {law}: {said(of)}")
        for kind in ("missed", "early"):
            reasons = Counter(str(row["reason"]).partition(" (")[0] for row in of if row["kind"] == kind)
            print(*(f"  {kind}, {count}: {reason or 'a success'}" for reason, count in reasons.items()), sep="\n")
    if asked.out is not None:
        with asked.out.open("w", newline="") as file:
            writer = csv.DictWriter(file, list(rows[0]))
            writer.writeheader()
            writer.writerows(rows)
    return 0


if __name__ == "__main__":
    sys.exit(main())
