"""A recording is the log of a teleoperated trial; from it come the signals that the references are made of."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rtstack.control.detector import ImpactDetector
from rtstack.control.parameters import DetectorParameters
from rtstack.control.records import POINT
from rtstack.control.tick import ArmController
from rtstack.log.errors import LogError
from rtstack.log.reader import read_log
from rtstack.samples import SIDES, Mode

Array = NDArray[np.float64]


class ReferenceError(Exception):
    """A recording from which no reference can be made. The message says why and what to do."""


@dataclass(frozen=True, slots=True)
class Recording:
    """The teleoperated part of a recording, one sample a tick.

    points (2, n) of POINT: measured pose, twist and posture, and the wrench and posture acceleration that the operator's
    controller wanted; impact: index of the nominal impact T_r; release: index at which the operator let go.
    """

    points: NDArray
    period_s: float
    impact: int
    release: int
    object: str

    @property
    def impact_s(self) -> float:
        """Nominal impact time T_r, s since the start of the recording."""
        return self.impact * self.period_s


def load_recording(
    path: Path, arms: tuple[ArmController, ArmController], detector: DetectorParameters, period_s: float
) -> Recording:
    """Read a recording and find its impact. Raises ReferenceError with one line."""
    try:
        log = read_log(path)
    except LogError as error:
        raise ReferenceError(str(error)) from None
    controls = [log.topic(f"/{side}/control") for side in SIDES]
    samples = [log.topic(f"/{side}/arm") for side in SIDES]
    taught = np.flatnonzero(controls[0]["mode"] == Mode.TELEOPERATION)
    if len(taught) == 0:
        raise ReferenceError(f"{path}: nothing in it was teleoperated: record a demonstration with `rtstack teach {path}`")
    part = slice(taught[0], taught[-1] + 1)
    n = part.stop - part.start
    if any(len(s) < part.stop for s in (*controls, *samples)) or np.any(
        np.diff(samples[0]["t_ns"][part]) != round(period_s * 1e9)
    ):
        raise ReferenceError(f"{path}: samples are missing in the demonstration: record it again")
    points = np.zeros((2, n), POINT)
    force = np.zeros((2, n))
    hits = [n, n]
    for arm, controller in enumerate(arms):
        finder = ImpactDetector(detector, period_s)
        for k in range(n):
            sample = samples[arm][part.start + k]
            point = points[arm, k]
            controller.sample["q"][0] = sample["q"]
            controller.sample["dq"][0] = sample["dq"]
            controller.sample["O_F_ext_hat_K"][0] = sample["O_F_ext_hat_K"]
            controller.observe()
            work = controller.workspace[0]
            point["position"] = work["position"]
            point["rotation"] = work["rotation"]
            point["twist"] = work["twist"]
            force[arm, k] = np.linalg.norm(work["force_world"])
            if finder.update(work["force_world"], work["twist"]) and hits[arm] == n:
                hits[arm] = k
        joint = controller.parameters.posture_joint
        points[arm]["xi"] = samples[arm]["q"][part, joint]
        points[arm]["dxi"] = samples[arm]["dq"][part, joint]
        points[arm]["wrench_ff"] = controls[arm]["wrench_desired"][part]
        points[arm]["beta"] = controls[arm]["beta"][part]
    impact = min(hits)
    if impact == n:
        raise ReferenceError(f"{path}: no impact was found in the demonstration: record one that hits the object")
    held = np.flatnonzero(np.min(force, axis=0)[impact:] > detector.force_high_n)
    release = impact + int(held[-1]) if len(held) else impact
    return Recording(
        points=points,
        period_s=period_s,
        impact=impact,
        release=release,
        object=_object_name(log.metadata),
    )


def _object_name(metadata: dict[str, dict[str, str]]) -> str:
    return metadata.get("trial", {}).get("object", "")
