"""Hosts a policy in the process of a cell that waits: it is asked between two ticks, and answers through the mailbox.

The cell's time stands still while the policy computes, so that a run is the same on any machine. `delay_s` is the
robot's time that an answer takes. A policy that raises is not asked again, which ends the run as a quiet policy does.
"""

from collections import deque
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from hal.tracker import ObjectTracker
from rtstack.cameras.newest import NewestPictures
from rtstack.cameras.start import Cameras
from rtstack.loop.mailbox import Mailbox
from rtstack.loop.target import TARGET
from rtstack.loop.timeline import TICK_NS
from rtstack.model.arm_model import ArmModel
from rtstack.model.cell_description import CellDescription
from rtstack.model.rotation import quaternion_from_rotation
from rtstack.samples import Level
from rtstack.teleoperation.guide import TeleoperationGuide
from rtstack.teleoperation.policy import Chunk, Observation, Policy
from rtstack.teleoperation.reach import FASTEST_M_S, STIFFNESS_N_M
from rtstack.trials.run_observer import RunEvent

LEASE = 1  # of the one policy of a run


class PolicyHost:
    """Asks a policy `rate_hz` times a second of the robot's time, for `longest_s` at most, and gives it a lease.

    mailbox, job: where the answers go. delay_s: until an answer arrives. speed_m_s: of the filtered command at most.
    """

    def __init__(
        self, policy: Policy, mailbox: Mailbox, job: int, rate_hz: float = 20.0, longest_s: float = 60.0,
        delay_s: float = 0.0, speed_m_s: float = FASTEST_M_S,
    ) -> None:  # fmt: skip
        self.longest_ticks = round(longest_s * 1e9 / TICK_NS)
        self._policy, self._mailbox, self._job = policy, mailbox, job
        self._every, self._delay = round(1e9 / rate_hz / TICK_NS), round(delay_s * 1e9 / TICK_NS)
        self._target = np.zeros(1, TARGET)
        self._target["job"], self._target["policy"] = job, LEASE
        self._target["speed"], self._target["stiffness"] = speed_m_s, STIFFNESS_N_M
        self._waiting: deque[tuple[int, NDArray[np.void] | None]] = deque()  # when an answer arrives, None: finished
        self._number = 0
        self._began_ns: int | None = None
        self._dead = False
        self._said: set[str] = set()

    def clock(self) -> int:
        """Return the robot's time, ns: a clock of the host's that is the same on any machine."""
        arm = self._guide.arms[0]
        return 0 if arm is None else int(arm.sample["t_ns"][0])

    def serve(
        self, guide: TeleoperationGuide, tracker: ObjectTracker, cell: CellDescription,
        say: Callable[[RunEvent], None], cameras: Cameras | None = None,
    ) -> Callable[[int], None]:  # fmt: skip
        """Return what a run calls between two ticks. cameras: of the run, whose pictures the policy is shown."""
        self._pictures = NewestPictures({}) if cameras is None else cameras.newest()
        self._guide, self._tracker, self._say = guide, tracker, say
        self._models = ArmModel(cell.left, cell.pad), ArmModel(cell.right, cell.pad)
        self._mailbox.write_target(self._target)
        return self._between

    def _between(self, tick: int) -> None:
        if tick >= self.longest_ticks:
            self._finish()
            return
        if tick % self._every == 0 and not self._dead and None not in self._guide.arms and self._guide.lead.lease:
            self._ask(tick)
        while self._waiting and self._waiting[0][0] <= tick:
            _, chunk = self._waiting.popleft()
            if chunk is None:
                self._finish()
                return
            chunk["beat_ns"] = self.clock()
            self._mailbox.write_chunk(chunk)

    def _ask(self, tick: int) -> None:
        observation = self._observation()
        try:
            answer = self._policy.act(observation)
        except Exception as error:  # whatever the code of another author raises
            self._dead = True
            self._tell(Level.ERROR, f"the policy has ended: {type(error).__name__}: {error}")
            return
        if answer is None:
            return
        if answer.finished:
            self._waiting.append((tick + self._delay, None))
            return
        problem = answer.problem()
        if problem is not None:
            self._tell(Level.WARNING, f"answers are not followed: {problem}")
            return
        self._waiting.append((tick + self._delay, self._record(answer, observation)))

    def _record(self, answer: Chunk, observation: Observation) -> NDArray[np.void]:
        chunk = answer.record(self._models, self._posture_joint)
        chunk["job"], chunk["lease"], chunk["observed_ns"] = self._job, self._guide.lead.lease, observation.t_ns
        return chunk

    def _observation(self) -> Observation:
        arms = [arm for arm in self._guide.arms if arm is not None]
        self._number += 1
        t_ns = self.clock()
        self._began_ns = t_ns if self._began_ns is None else self._began_ns
        pose, pose_ref = np.zeros((2, 7)), np.zeros((2, 7))
        self._posture_joint = arms[0].parameters.posture_joint
        for side, arm in enumerate(arms):
            work, point = arm.workspace[0], self._guide.points[side, 0]
            for out, place, rotation in (
                (pose, work["position"], work["rotation"]), (pose_ref, point["position"], point["rotation"]),
            ):  # fmt: skip
                out[side, :3] = place
                quaternion_from_rotation(np.ascontiguousarray(rotation), out[side, 3:])
        seen = self._tracker.latest().record
        known = np.concatenate([seen["position"][0], seen["orientation_wxyz"][0]]) if seen["seen"][0] else None
        return Observation(
            self._number, t_ns, (t_ns - self._began_ns) * 1e-9,
            np.stack([arm.sample["q"][0] for arm in arms]), np.stack([arm.sample["dq"][0] for arm in arms]),
            pose, pose_ref, np.stack([arm.workspace["force_world"][0] for arm in arms]), known,
            self._pictures.at(t_ns),
        )  # fmt: skip

    def _finish(self) -> None:
        self._target["finish"] = 1
        self._mailbox.write_target(self._target)

    def _tell(self, level: Level, text: str) -> None:
        if text not in self._said:  # each once: a policy may say the same for a minute
            self._said.add(text)
            self._say(RunEvent(level, "operator", text))
