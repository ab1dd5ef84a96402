"""What a worker does: a grab by one of the methods, at one place. One row of plain values comes back."""

from math import degrees
from pathlib import Path

import numpy as np

from hal.displacement import Displacement
from learned_grab.demonstrations import NETWORK, RECORDING, demonstrations, place, run_watched
from learned_grab.network import LearnedGrab, Network
from learned_grab.plan import Case
from learned_grab.scripted import OBJECT, POSES, STEP_S, Way
from rtstack.cells import load_description, open_cell
from rtstack.experiments.experiment import Row
from rtstack.experiments.seeds import seed_of
from rtstack.teleoperation.policy import Policy
from rtstack.trials.specification import TrialSpecification
from rtstack.trials.trial import prepare_trial, run_trial


def run(out: Path, seed: int, yaw_deg: float, case: Case) -> list[Row]:
    """Run a trial. Returns its row. The place and the seed are the same for all methods."""
    displacement = place(seed, case.radius_mm, yaw_deg, "trial", case.radius_mm, case.repetition)
    of_plant = seed_of(seed, "trial", case.radius_mm, case.repetition)
    if case.method == "reference_spreading":
        success, reason, lift_mm, ticks = _reference_spreading(out, displacement, of_plant)
    else:
        policy = _replay(out) if case.method == "replay" else LearnedGrab(Network.load(out / NETWORK))
        result, values, reason = run_watched(policy, displacement, of_plant)
        success, lift_mm, ticks = reason is None, values.max_lift_mm, round(1e3 * result.duration_s)
    row = {"id": case.id, "method": case.method, "radius_mm": case.radius_mm, "repetition": case.repetition}
    return [row | {
        "displacement_mm": 1e3 * displacement.y_m, "displacement_x_mm": 1e3 * displacement.x_m,
        "yaw_deg": degrees(displacement.yaw_rad), "success": success, "reason": reason or "",
        "max_lift_mm": lift_mm or 0.0, "ticks": ticks,
    }]  # fmt: skip


def _reference_spreading(
    out: Path, displacement: Displacement, seed: int
) -> tuple[bool, str | None, float | None, int]:
    description, _ = load_description(None)
    asked = TrialSpecification(
        str(out / RECORDING), "proposed", OBJECT, 1e3 * displacement.y_m, seed,
        displacement_x_mm=1e3 * displacement.x_m, yaw_deg=degrees(displacement.yaw_rad),
    )  # fmt: skip
    cell = open_cell("direct", OBJECT, displacement, seed, description)
    try:
        result = run_trial(prepare_trial(asked, description), cell)
    finally:
        cell.close()
    return result.success, result.failure_reason, result.max_lift_mm, result.ticks


def _replay(out: Path) -> Policy:
    """Return the best demonstration as it was asked for: the successful one whose object stood nearest to its place."""
    best = min(demonstrations(out), key=lambda each: float(np.linalg.norm(each["place"][:2])))
    ends = STEP_S * (1.0 + np.arange(len(best["t_s"]) + POSES - 1))
    poses = np.concatenate([best["said"][:, 0], best["said"][-1, 1:]])
    at = np.searchsorted(ends, 1e-3 * np.arange(round(1e3 * ends[-1])))  # the next pose of those every STEP_S
    return Way(poses[np.minimum(at, len(poses) - 1)])
