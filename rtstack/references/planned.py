"""A planned motion as a file: a log of the arms' planned states, with /control in the modes of the plan. A trial reads
each arm's control topic (mode, pose_ref, twist_ref, wrench_ff, beta), its posture joint and the metadata record `plan`;
the monitor reads q, dq and O_F_ext_hat_K."""

import json

import numpy as np

from rtstack.control.records import POINT
from rtstack.log.reader import Log
from rtstack.model.rotation import rotation_from_quaternion
from rtstack.references.motion import Motion
from rtstack.references.recording import MEASURED, Recording, ReferenceError
from rtstack.references.spreading import ExtendedReference, spread
from rtstack.samples import Mode

PLAN = "plan"  # the metadata record that makes a log a plan
MONITOR = "monitor.toml"  # the attachment with the tuning of its monitor, where it has one


def planned_reference(recording: Recording) -> ExtendedReference:
    """Return the references of a planned motion: no interval is excluded, as nothing in it rings."""
    return spread(recording, recording.impact - 1, recording.impact)


def planned_recording(log: Log, posture_joint: int, period_s: float) -> Recording:
    """Return the motion in the log of a plan, of the arms that it has. Raises ReferenceError with one line."""
    metadata = log.metadata[PLAN]
    controls = [log.topic(f"/{side}/control") for side in log.sides]
    samples = [log.topic(f"/{side}/arm") for side in log.sides]
    t_ns = controls[0]["t_ns"]
    n = len(t_ns)
    if n < 2 or any(not np.array_equal(topic["t_ns"], t_ns) for topic in (*controls, *samples)):
        raise ReferenceError(f"{log.path}: the plan is incomplete: plan it again")
    if np.any(np.diff(t_ns) != round(period_s * 1e9)):
        raise ReferenceError(f"{log.path}: the plan has not one point every {period_s:g} s: plan it again")
    points, felt = np.zeros((len(controls), n), POINT), np.zeros((len(controls), n), MEASURED)
    for arm, (control, sample) in enumerate(zip(controls, samples, strict=True)):
        point, pose = points[arm], control["pose_ref"]
        point["position"], point["rotation"] = pose[:, :3], [rotation_from_quaternion(each[3:]) for each in pose]
        for name, values in (("twist", "twist_ref"), ("wrench_ff", "wrench_ff"), ("beta", "beta")):
            point[name] = control[values]
        point["xi"], point["dxi"] = sample["q"][:, posture_joint], sample["dq"][:, posture_joint]
        R_world_base = points[arm]["rotation"][0] @ sample["O_T_EE"][0, :3, :3].T
        felt[arm]["q"], felt[arm]["dq"] = sample["q"], sample["dq"]
        felt[arm]["force"] = -sample["O_F_ext_hat_K"][:, :3] @ R_world_base.T
    modes = controls[0]["mode"]
    after = np.flatnonzero(modes == Mode.POST_IMPACT)
    impact = int(after[0]) if len(after) else 0
    if impact < 1 or not np.all(modes[:impact] == Mode.ANTE_IMPACT):
        raise ReferenceError(f"{log.path}: the plan has no motion before and after an impact: plan it again")
    try:
        release, motion = round(float(metadata["release_s"]) / period_s), Motion(metadata["motion"])
        load = np.array(json.loads(metadata["load"]), dtype=float).reshape(len(controls), 6)
    except (KeyError, ValueError) as error:
        raise ReferenceError(f"{log.path}: its record of the plan is damaged ({error}): plan it again") from None
    measured = felt if felt["force"].any() else None  # plans of older versions do not say what they exert
    return Recording(points, period_s, impact, release, metadata.get("object", ""), motion, load, measured=measured)
