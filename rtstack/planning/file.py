"""Writes a plan as a log (rtstack.references.planned reads it): arms, references, the object's way, predictions."""

import json
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from hal.base.files import replacing
from hal.tracker import OBJECT_POSE
from rtstack.log.errors import LogError
from rtstack.log.viewers.frames import quaternions_of
from rtstack.log.viewers.scenery import Scenery
from rtstack.log.writing.job import Attachment, texts
from rtstack.log.writing.mcap_writer import McapWriter
from rtstack.model.cell_description import CellDescription
from rtstack.planning.planned import PlannedMotion
from rtstack.references.planned import MONITOR, PLAN
from rtstack.samples import ARM_SAMPLE, CONTROL_SAMPLE, EVENT, TIMING_SAMPLE, Level, Mode
from rtstack.topics import EVENT_TOPIC, OBJECT_TOPIC, TIMING_TOPIC
from rtstack.trials.provenance import git_commit, package_versions
from rtstack.trials.record import cell_attachments, frames


def write_plan(
    path: Path, planned: PlannedMotion, description: CellDescription, cell_file: Path, tuning: str | None = None
) -> None:
    """Write the plan to `path`, which gets its name when complete. tuning: of its monitor, TOML. Raises LogError."""
    load = planned.recording.load
    values = texts(planned.as_dict() | {"load": [] if load is None else load.tolist()})
    trial = {
        "kind": "plan", "object": planned.recording.object, "versions": json.dumps(package_versions()),
        "git_commit": git_commit(),
    }  # fmt: skip
    attachments = cell_attachments(cell_file, description)
    if tuning is not None:
        attachments.append(Attachment(MONITOR, "application/toml", tuning.encode()))
    try:
        with replacing(path) as partial, open(partial, "wb") as file:
            writer = McapWriter(file, scenery=Scenery(frames(description, planned.recording.object)))
            writer.begin([("trial", trial), (PLAN, values)], attachments)
            writer.write(_records(planned))
            writer.close()
    except OSError as error:
        raise LogError(f"cannot write {path}: {error.strerror or error}") from None


def _records(planned: PlannedMotion) -> dict[str, NDArray]:
    recording = planned.recording
    n = recording.points.shape[1]
    t_ns = np.arange(n) * round(recording.period_s * 1e9)
    batches: dict[str, NDArray] = {}
    for arm, side in enumerate(planned.sides):
        points, motion = recording.points[arm], planned.joints[arm]
        sample, control = np.zeros(n, ARM_SAMPLE), np.zeros(n, CONTROL_SAMPLE)
        sample["t_ns"] = control["t_ns"] = t_ns
        sample["q"], sample["dq"], sample["O_T_EE"] = motion.q, motion.dq, motion.T_base_ee
        R_base_world = motion.T_base_ee[0, :3, :3] @ points["rotation"][0].T
        sample["O_F_ext_hat_K"][:, :3] = planned.force[arm] @ R_base_world.T
        control["mode"] = np.where(np.arange(n) < recording.impact, Mode.ANTE_IMPACT, Mode.POST_IMPACT)
        control["pose_ref"][:, :3] = points["position"]
        control["pose_ref"][:, 3:] = quaternions_of(points["rotation"])
        control["twist_ref"], control["beta"] = points["twist"], points["beta"]
        control["wrench_ff"] = control["wrench_desired"] = points["wrench_ff"]
        batches[f"/{side}/arm"], batches[f"/{side}/control"] = sample, control
    timing, pose, event = np.zeros(n, TIMING_SAMPLE), np.zeros(n, OBJECT_POSE), np.zeros(2, EVENT)
    timing["t_ns"] = pose["t_ns"] = t_ns
    pose["position"], pose["orientation_wxyz"], pose["seen"] = planned.object_position, (1.0, 0.0, 0.0, 0.0), 1
    for record, tick, text in zip(
        event, (recording.impact, recording.release), ("nominal impact, planned", "release, planned"), strict=True
    ):
        record["t_ns"], record["level"], record["name"], record["text"] = t_ns[tick], Level.INFO, PLAN, text
    return batches | {TIMING_TOPIC: timing, OBJECT_TOPIC: pose, EVENT_TOPIC: event}
