"""The log of one trial: rings, log process, and what is written about the trial besides its samples."""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from hal.description import fr3_urdf
from hal.realtime import obtainable
from rtstack.log.errors import LogError
from rtstack.log.ring import Rings
from rtstack.log.writer import Attachment, CellFrames, LogProcess
from rtstack.model.cell_description import CellDescription, base_frame
from rtstack.references.spreading import ExtendedReference
from rtstack.trials.provenance import git_commit, host_report, package_versions
from rtstack.trials.specification import DemonstrationSpecification, TrialSpecification

LOCKSTEP_KINDS = ("direct", "lockstep")  # cells whose robot waits for its answer
ROOM = 64  # records: below it a run that is faster than the log waits between two ticks


class TrialLog:
    """An open log. `lockstep`: the robot waits for its answer, so that the run may wait for the log."""

    def __init__(self, path: Path, rings: Rings, process: LogProcess, lockstep: bool) -> None:
        self.path = path
        self.rings = rings
        self._process = process
        self._lockstep = lockstep

    def wait_ready(self) -> None:
        """Wait until the log is being written: no arm moves before that. Raises LogError."""
        self._process.wait_ready()

    def wait_for_room(self) -> None:
        """Between two ticks of a lockstep run: let the log catch up. In real time, or without a log: return at once."""
        if not self._lockstep or self.rings.room() >= ROOM:
            return
        try:
            self._process.wait_room(ROOM)
        except LogError:
            # the trial goes on without its log; `close` will say so
            self._lockstep = False

    def close(self, result: dict[str, Any]) -> str | None:
        """Write the result and finish the file. Returns None, or in one line why the log is not complete."""
        try:
            values = {key: value if isinstance(value, str) else json.dumps(value) for key, value in result.items()}
            self._process.close(values)
        except LogError as error:
            return str(error)
        finally:
            self.rings.close()
        return None

    def abandon(self) -> None:
        """Finish the file without a result, when something worse has happened. Never raises."""
        self._process.abandon()
        self.rings.close()


def open_log(
    path: Path,
    specification: TrialSpecification | DemonstrationSpecification,
    description: CellDescription,
    cell_kind: str,
    cell_file: Path,
    attachments: Sequence[Attachment] = (),
    *,
    reference: ExtendedReference | None = None,
    overwrite: bool = False,
) -> TrialLog:
    """Start the log of a trial, with its reference's times if it has one. Raises LogError."""
    lockstep = cell_kind in LOCKSTEP_KINDS
    rings = Rings.create()
    try:
        process = LogProcess.start(
            path,
            rings,
            {"trial": trial_metadata(specification, cell_kind, reference)},
            [
                Attachment("cell.toml", "application/toml", cell_file.read_bytes()),
                Attachment("fr3.urdf", "application/xml", fr3_urdf().encode()),
                *attachments,
            ],
            frames(description, specification.object),
            overwrite=overwrite,
        )
    except BaseException:
        rings.close()
        raise
    return TrialLog(path, rings, process, lockstep)


def trial_metadata(
    specification: TrialSpecification | DemonstrationSpecification,
    cell_kind: str,
    reference: ExtendedReference | None,
) -> dict[str, str]:
    """Return the metadata record `trial`: nested values are JSON."""
    kind = "trial" if isinstance(specification, TrialSpecification) else "demonstration"
    realtime = {} if cell_kind in LOCKSTEP_KINDS else {f"loop_{k}": v for k, v in obtainable().as_dict().items()}
    times = {}
    if reference is not None:
        times = {"nominal_impact_s": repr(reference.nominal_impact_s), "release_s": repr(reference.release_s)}
    return {
        "kind": kind,
        "specification": json.dumps(specification.as_dict()),
        "object": specification.object,
        "seed": str(specification.seed),
        "cell": cell_kind,
        "versions": json.dumps(package_versions()),
        "git_commit": git_commit(),
        "host": json.dumps(host_report() | realtime),
        **times,
    }


def frames(description: CellDescription, object_name: str) -> CellFrames:
    """Return where the arms stand and how large pads and object are, for /tf and for who draws the log."""
    mounts = []
    for mounting in (description.left, description.right):
        T = np.eye(4)
        frame = base_frame(mounting)
        T[:3, :3] = frame.rotation
        T[:3, 3] = frame.translation
        mounts.append(T)
    thing = description.objects.get(object_name)
    return CellFrames(mounts[0], mounts[1], description.pad.size, thing.size if thing else (0.0, 0.0, 0.0))
