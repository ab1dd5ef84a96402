"""What a policy sees over its socket, and its answers on their way into the mailbox. May be called from any thread."""

import time
from collections.abc import Callable, Mapping
from functools import cached_property

import numpy as np

from console.arm_watch import in_world
from console.teleoperation.teleop_input import TeleopInput
from rtstack.cameras.newest import NewestPictures
from rtstack.log.ring import Rings
from rtstack.loop.mailbox import Mailbox
from rtstack.model.arm_model import ArmModel
from rtstack.model.cell_description import CellDescription, base_frame
from rtstack.samples import SIDES, Mode
from rtstack.teleoperation.policy import Chunk, Observation
from rtstack.trials.assembly import cell_parameters


class PolicyInput:
    """One connection of a policy. cameras: gives the rings of the run's cameras (rtstack.live.protocol.Job). clock: the
    host's monotonic time, ns."""

    def __init__(
        self, name: str, teleop: TeleopInput, mailbox: Mailbox, rings: Rings, cell: CellDescription,
        cameras: Callable[[], Mapping[str, str]] = dict, clock: Callable[[], int] = time.monotonic_ns,
    ) -> None:  # fmt: skip
        self._name, self._teleop, self._mailbox, self._cell, self._clock = name, teleop, mailbox, cell, clock
        self._bases = base_frame(cell.left), base_frame(cell.right)
        self._arms = [rings.reader(f"/{side}/arm") for side in SIDES]
        self._controls = [rings.reader(f"/{side}/control") for side in SIDES]
        self._object = rings.reader("/object/pose")
        self._cameras, self._pictures = cameras, NewestPictures({})
        self._lease: tuple[int, int] | None = None
        self._number, self._began_ns = 0, 0
        self._shown: Observation | None = None

    @property
    def leads(self) -> bool:
        """Whether the policy has a lease."""
        return self._teleop.lease(self._name) is not None

    def observe(self) -> Observation | None:
        """Return what the arms say now, None without a lease or before the teleoperation says where they are to be."""
        lease = self._teleop.lease(self._name)
        arms, controls = ([reader.latest() for reader in readers] for readers in (self._arms, self._controls))
        thing = self._object.latest()
        self._shown = None
        if lease is None or any(record is None for record in (*arms, *controls)):
            return None
        arms, controls = ([record[0] for record in records if record is not None] for records in (arms, controls))
        if any(control["mode"] != Mode.TELEOPERATION for control in controls):
            return None  # what an idle cell says has no reference
        t_ns = int(arms[0]["t_ns"])
        if lease != self._lease:
            self._lease, self._began_ns = lease, t_ns
            self._look()
        self._number += 1
        pads = [in_world(base, arm) for base, arm in zip(self._bases, arms, strict=True)]
        pose = None
        if thing is not None and thing["seen"][0]:
            pose = np.concatenate([thing["position"][0], thing["orientation_wxyz"][0]])
        self._shown = Observation(
            self._number, t_ns, (t_ns - self._began_ns) * 1e-9,
            np.stack([arm["q"] for arm in arms]), np.stack([arm["dq"] for arm in arms]),
            np.stack([pad[0] for pad in pads]), np.stack([control["pose_ref"] for control in controls]),
            np.stack([pad[1] for pad in pads]), pose, self._pictures.at(t_ns),
        )  # fmt: skip
        return self._shown

    def _look(self) -> None:
        self._pictures.close()
        try:
            self._pictures = NewestPictures(self._cameras())
        except OSError:  # the run has just ended, and its pictures with it
            self._pictures = NewestPictures({})

    def answer(self, number: int, chunk: Chunk) -> str | None:
        """Take the answer to an observation. Returns in one line why it is not followed, None where it is."""
        lease, shown = self._lease, self._shown
        if shown is None or number != shown.number:
            return f"it answers observation {number}, and the newest is {self._number}"
        self._shown = None  # one answer each
        if lease is None or lease != self._teleop.lease(self._name):
            return "the lease is over"
        problem = chunk.problem()
        if problem is not None:
            return problem
        record = chunk.record(self._models, self._posture_joint)
        record["job"], record["lease"] = lease
        record["observed_ns"], record["beat_ns"] = shown.t_ns, self._clock()
        self._mailbox.write_chunk(record)
        return None

    @cached_property
    def _models(self) -> tuple[ArmModel, ArmModel]:
        return ArmModel(self._cell.left, self._cell.pad), ArmModel(self._cell.right, self._cell.pad)

    @cached_property
    def _posture_joint(self) -> int:
        return cell_parameters(self._cell).control.posture_joint
