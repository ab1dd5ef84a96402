"""Runs a teleoperation on a cell: the session of a demonstration, led by an operator instead of a script.

A policy may lead too. In a cell that waits it is asked between two ticks, while the cell's time stands still: a run is
the same on any machine. A policy that raises is not asked again: it ends as a quiet one.
"""

import os
import time
from collections import deque
from collections.abc import Callable
from contextlib import closing
from dataclasses import dataclass, replace
from itertools import count

import numpy as np
from numpy.typing import NDArray

from hal.cell import Cell
from hal.displacement import Displacement
from hal.extensions import PLUG_INS_RAISE, raised
from hal.tracker import ObjectTracker
from rtstack.cameras.newest import NewestPictures
from rtstack.cameras.start import Cameras
from rtstack.loop.end import End
from rtstack.loop.mailbox import TARGET, Mailbox
from rtstack.loop.plan import SessionPlan
from rtstack.loop.timeline import TICK_NS
from rtstack.model.arm_model import ArmModel
from rtstack.model.cell_description import CellDescription
from rtstack.model.rotation import quaternion_from_rotation
from rtstack.safety.limits import ForcePhase
from rtstack.samples import Level
from rtstack.teleoperation.policy import Observation, Policy, answer_of
from rtstack.teleoperation.reach import FASTEST_M_S, STIFFNESS_N_M, Reach
from rtstack.teleoperation.source import TeleoperationSource
from rtstack.trials.assembly import cell_parameters
from rtstack.trials.carry_out import PreparedRun
from rtstack.trials.errors import TrialError
from rtstack.trials.object import check_object
from rtstack.trials.result import TeleoperationResult
from rtstack.trials.run import Run
from rtstack.trials.run_context import NO_CONTEXT, RunContext, RunEvent
from rtstack.trials.specification import TeleoperationSpecification
from rtstack.trials.start_motion import StartMotion
from rtstack.trials.tightening import limits_of_arms

_AS_WANTED = (End.COMPLETED, End.RELEASED)
LEASE = 1  # of the one policy of a run


class PolicyHost:
    """Asks a policy `rate_hz` times a second of the robot's time, for `longest_s` at most, and gives it a lease.
    mailbox, job: where the answers go. delay_s: until an answer arrives, by the robot's time. speed_m_s: of the command
    at most, after the filter."""

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
        self._number, self._began_ns = 0, -1
        self._poses: NDArray[np.float64] | None = None  # of the last observation, whose quaternions' signs are kept
        self._dead = False
        self.problem = ""  # why its newest answer is none
        self._said: set[str] = set()

    def clock(self) -> int:
        """Return the robot's time, ns: a clock of the host's that is the same on any machine."""
        arm = self._source.arms[0]
        return 0 if arm is None else int(arm.sample["t_ns"][0])

    def serve(
        self, source: TeleoperationSource, tracker: ObjectTracker, cell: CellDescription,
        say: Callable[[RunEvent], None], cameras: Cameras | None = None,
    ) -> Callable[[int], None]:  # fmt: skip
        """Return what a run calls between two ticks. cameras: of the run, whose pictures the policy is shown."""
        self._pictures = NewestPictures({}) if cameras is None else cameras.newest()
        self._source, self._tracker, self._say = source, tracker, say
        self._models = {side: ArmModel(arm, cell.pad) for side, arm in cell.mountings.items()}
        self._mailbox.write_target(self._target)
        return self._between

    def _between(self, tick: int) -> None:
        if tick >= self.longest_ticks:
            self._waiting.appendleft((tick, None))
        elif tick % self._every == 0 and not self._dead and None not in self._source.arms and self._source.lead.lease:
            self._ask(tick)
        while self._waiting and self._waiting[0][0] <= tick:
            _, chunk = self._waiting.popleft()
            if chunk is None:
                self._target["finish"] = 1
                self._mailbox.write_target(self._target)
                return
            chunk["beat_ns"] = self.clock()
            self._mailbox.write_chunk(chunk)

    def _ask(self, tick: int) -> None:
        observation = self._observation()
        try:
            answer, problem = answer_of(self._policy, observation, len(self._models))
        except PLUG_INS_RAISE as error:
            self._dead = True
            self._tell(Level.ERROR, f"the policy has ended: {raised(error, self._policy.act)}")
            return
        self.problem, chunk = "", None
        if answer is None:
            return
        if problem:
            self._tell(Level.WARNING, f"answers are not followed: {problem}")
            return
        if not answer.finished:
            chunk = answer.record(self._models, self._posture_joint)
            chunk["job"], chunk["lease"], chunk["observed_ns"] = self._job, self._source.lead.lease, observation.t_ns
        self._waiting.append((tick + self._delay, chunk))

    def _observation(self) -> Observation:
        arms = [arm for arm in self._source.arms if arm is not None]
        self._number += 1
        t_ns = self.clock()
        self._began_ns = t_ns if self._began_ns < 0 else self._began_ns
        pose, pose_ref = self._poses = np.zeros((2, len(arms), 7)) if self._poses is None else self._poses.copy()
        self._posture_joint = arms[0].parameters.posture_joint
        for side, arm in enumerate(arms):
            work, point = arm.workspace[0], self._source.points[side, 0]
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

    def _tell(self, level: Level, text: str) -> None:
        self.problem = text
        if text not in self._said:  # each once: a policy may say the same for a minute
            self._said.add(text)
            self._say(RunEvent(level, "operator", text))


@dataclass(frozen=True, slots=True)
class PreparedTeleoperation(PreparedRun[TeleoperationResult]):
    """A teleoperation with an object that the cell has. The context brings the mailbox."""

    specification: TeleoperationSpecification

    def start_motion(self, cell: Cell) -> StartMotion | None:
        """See PreparedRun: a recording begins at home, practice where the arms are."""
        return PreparedRun.start_motion(self, cell) if self.specification.recorded else None

    def run(self, cell: Cell, context: RunContext, way: StartMotion | None) -> TeleoperationResult:
        assert context.mailbox is not None  # every host of a teleoperation has one
        return run_teleoperation(self.specification, self.description, cell, context.mailbox, context, way=way)


def prepare_teleoperation(
    specification: TeleoperationSpecification, description: CellDescription
) -> PreparedTeleoperation:
    """Check the object. Raises TrialError with one line."""
    check_object(specification.object, description)
    return PreparedTeleoperation(specification, description)


def run_teleoperation(
    specification: TeleoperationSpecification,
    description: CellDescription,
    cell: Cell,
    mailbox: Mailbox,
    context: RunContext = NO_CONTEXT,
    *,
    way: StartMotion | None = None,
    clock: Callable[[], int] = time.monotonic_ns,
    host: PolicyHost | None = None,
) -> TeleoperationResult:
    """Follow the mailbox's targets of this job on an open cell until the operator ends it. The log is closed here.

    Before the first target the arms hold where they are. clock: the host's monotonic time, ns, that the clutch's signs
    of life carry. way: gone before the first tick. host: of a policy in this process, which leads from the beginning.
    """
    parameters = cell_parameters(description)
    check_object(specification.object, description)
    limits = limits_of_arms(description)
    reach = Reach.within(limits[0])
    source = TeleoperationSource(
        mailbox, specification.job, reach, specification.stop_on_release, clock, description.sides
    )
    control = parameters.control
    plan = SessionPlan.from_source(source, control.stiffness_teleoperation, control.period_s, ForcePhase.CONTACT)
    longest = 0 if host is None else host.longest_ticks
    with Run(description, parameters, plan, limits, context.with_watchdog(source), way, longest, [source]) as run:
        source.tell = lambda text: run.run_event(RunEvent(Level.INFO, "operator", text))
        if host is not None:
            cameras = None if context.log is None else context.log.cameras
            run.between = host.serve(source, cell.tracker, description, run.run_event, cameras)
        outcome = run.follow(cell)
        cut_off = specification.recorded and source.lost  # the operator did not end this recording
        end = End.COMPLETED if outcome.end in _AS_WANTED and not cut_off else outcome.end
        detail = host.problem if host is not None and host.problem and end is End.POLICY_QUIET else outcome.detail
        return run.finished(
            TeleoperationResult, replace(outcome, end=end, detail=detail).problem or run.failed, specification, outcome,
            moved=source.moved, detected_impact_time_s=run.first_impact_s,
            duration_s=run.history.ticks * TICK_NS * 1e-9,
        )  # fmt: skip


RATE_HZ = 20.0
LONGEST_S = 60.0
_NUMBERS = count()


@dataclass(frozen=True, slots=True)
class PreparedPolicy(PreparedTeleoperation):
    """A teleoperation that a policy leads. put: where the object stands."""

    policy: Policy
    rate_hz: float
    put: Displacement

    @property
    def displacement(self) -> Displacement:
        return self.put

    def run(self, cell: Cell, context: RunContext, way: StartMotion | None) -> TeleoperationResult:
        return run_policy(self.policy, self.specification, self.description, cell, context, rate_hz=self.rate_hz)


def run_policy(
    policy: Policy, specification: TeleoperationSpecification, description: CellDescription, cell: Cell,
    context: RunContext = NO_CONTEXT, *, rate_hz: float = RATE_HZ, longest_s: float = LONGEST_S, delay_s: float = 0.0,
) -> TeleoperationResult:  # fmt: skip
    """Let a policy lead the arms of an open cell until it has finished; see PolicyHost. Closes the log, not the cell.
    Raises TrialError for a cell that does not wait: there `rtstack policy --console` lets a policy lead."""
    if cell.own_clocks:
        raise TrialError(f"the cell {cell.name} does not wait for a policy: start rtstack up, and give --console")
    with closing(Mailbox.create(f"rtstack-policy-{os.getpid()}-{next(_NUMBERS)}")) as mailbox:
        host = PolicyHost(policy, mailbox, specification.job, rate_hz, longest_s, delay_s)
        return run_teleoperation(specification, description, cell, mailbox, context, clock=host.clock, host=host)
