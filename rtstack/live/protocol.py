"""What is said over the robot process's socket: one JSON object a line, one answer a request, in order.

Requests and answers are frozen dataclasses, checked on arrival; what does not fit is refused with one line that
names the key. The socket carries intentions and status, never samples (rings) and never the stop's fast path (mailbox).
"""

import json
from dataclasses import asdict, field
from enum import StrEnum
from typing import Annotated, Any, Literal

from pydantic import Field, TypeAdapter, ValidationError
from pydantic.dataclasses import dataclass as checked

from rtstack.messages import MESSAGE, NUMBER, StrictBool, StrictFloat
from rtstack.playback.pace import FASTEST, SLOWEST
from rtstack.safety.arming import Phase
from rtstack.samples import Reaction
from rtstack.trials.controllers import DEFAULT, ControllerName
from rtstack.trials.specification import (
    DemonstrationSpecification,
    HandMotion,
    MoveSpecification,
    PlaybackSpecification,
    TeleoperationSpecification,
    TrialSpecification,
)

MAX_LINE_BYTES = 1 << 20  # a request or an answer is far shorter: what is longer is not ours


ObjectName = Annotated[str, Field(min_length=1, max_length=64, pattern=r"^[A-Za-z0-9_-]+$")]
Seed = Annotated[int, Field(ge=0, le=2**31 - 1), NUMBER]
DisplacementMm = Annotated[StrictFloat, Field(ge=-1000.0, le=1000.0)]
YawDeg = Annotated[StrictFloat, Field(ge=-180.0, le=180.0)]
# a person's or a program's name: one line without control characters, and no space around it
Operator = Annotated[str, Field(min_length=1, max_length=40, pattern=r"^[^\p{C}\s]([^\p{C}]*[^\p{C}\s])?$")]


class ProtocolError(Exception):
    """A line that is no request or no answer. The message is one line that names the key."""


class JobKind(StrEnum):
    """What the robot process can be asked to carry out."""

    DEMONSTRATION = "demonstration"
    TRIAL = "trial"
    TELEOPERATION = "teleoperation"
    PLAYBACK = "playback"
    MOVE = "move"
    GUIDE = "guide"


class JobState(StrEnum):
    """Where a job is. The last three are final."""

    STARTING = "starting"
    RUNNING = "running"
    STOPPING = "stopping"
    DONE = "done"
    STOPPED = "stopped"
    FAILED = "failed"


@checked(frozen=True, slots=True, config=MESSAGE)
class StatusRequest:
    """Ask how things are."""

    verb: Literal["status"] = "status"


@checked(frozen=True, slots=True, config=MESSAGE)
class DemonstrationRequest:
    """Ask for a scripted demonstration, by the operator who has armed.

    faults: the text of a faults file for the simulated robot, as for `rtstack sim --faults`; empty for none.
    """

    object: ObjectName = "rice_box"
    variation: Annotated[int, Field(ge=0, le=10_000), NUMBER] = 0
    seed: Seed = 0
    faults: Annotated[str, Field(max_length=4096)] = ""
    operator: Operator = field(kw_only=True)
    verb: Literal["demonstration"] = "demonstration"

    def specification(self) -> DemonstrationSpecification:
        """Return what the trial module is asked for."""
        return DemonstrationSpecification(object=self.object, variation=self.variation, seed=self.seed)


@checked(frozen=True, slots=True, config=MESSAGE)
class TrialRequest:
    """Ask for a trial, by the operator who has armed.

    `reference` is the path of a recording or a plan; the displacement is along the world's y and x, mm, and about z;
    `reaction`: to an impact that was not meant.
    """

    reference: Annotated[str, Field(min_length=1, max_length=4096)]
    controller: ControllerName = DEFAULT
    object: ObjectName = "rice_box"
    displacement_mm: DisplacementMm = 0.0
    displacement_x_mm: DisplacementMm = 0.0
    yaw_deg: YawDeg = 0.0
    seed: Seed = 0
    reaction: Reaction = Reaction.CONTINUE
    operator: Operator = field(kw_only=True)
    verb: Literal["trial"] = "trial"

    def specification(self) -> TrialSpecification:
        """Return what the trial module is asked for."""
        return TrialSpecification(
            reference=self.reference,
            controller=self.controller,
            object=self.object,
            displacement_mm=self.displacement_mm,
            displacement_x_mm=self.displacement_x_mm,
            yaw_deg=self.yaw_deg,
            seed=self.seed,
            reaction=self.reaction,
        )


@checked(frozen=True, slots=True, config=MESSAGE)
class TeleoperationRequest:
    """Ask to move the arms by hand, by the operator who has armed. The targets go through the mailbox.

    recorded: as a recording, from home; stop_on_release: the session ends with a clutch that is let go.
    """

    object: ObjectName = "rice_box"
    seed: Seed = 0
    recorded: StrictBool = False
    stop_on_release: StrictBool = True
    operator: Operator = field(kw_only=True)
    verb: Literal["teleoperation"] = "teleoperation"

    def specification(self, job: int) -> TeleoperationSpecification:
        """Return what the trial module is asked for, as this job."""
        return TeleoperationSpecification(
            operator=self.operator,
            object=self.object,
            seed=self.seed,
            recorded=self.recorded,
            stop_on_release=self.stop_on_release,
            job=job,
        )


@checked(frozen=True, slots=True, config=MESSAGE)
class PlaybackRequest:
    """Ask to play a log on the arms, by the operator who has armed. source: its path, speed: times its own.

    A `finish` in the mailbox's target, for this job, is a soft stop.
    """

    source: Annotated[str, Field(min_length=1, max_length=4096)]
    speed: Annotated[StrictFloat, Field(ge=SLOWEST, le=FASTEST)] = 1.0
    seed: Seed = 0
    operator: Operator = field(kw_only=True)
    verb: Literal["playback"] = "playback"

    def specification(self) -> PlaybackSpecification:
        """Return what the playback module is asked for."""
        return PlaybackSpecification(source=self.source, speed=self.speed, seed=self.seed)


@checked(frozen=True, slots=True, config=MESSAGE)
class MoveRequest:
    """Ask for a motion from where the arms are, on the cell as it is, by the operator who has armed."""

    motion: HandMotion
    operator: Operator = field(kw_only=True)
    verb: Literal["move"] = "move"

    def specification(self, object_name: str) -> MoveSpecification:
        """Return what the trial module is asked for; object_name: what the cell holds."""
        return MoveSpecification(self.motion, object_name)


@checked(frozen=True, slots=True, config=MESSAGE)
class GuideRequest:
    """Ask that a person may push both arms, while this operator holds the clutch; in a fault too, which stays.

    The clutch goes through the mailbox.
    """

    operator: Operator = field(kw_only=True)
    verb: Literal["guide"] = "guide"


@checked(frozen=True, slots=True, config=MESSAGE)
class TakeRequest:
    """Ask for the lease. `over_from`: from this holder, where they still have it and nothing moves."""

    operator: Operator
    over_from: Operator | None = None
    verb: Literal["take"] = "take"


@checked(frozen=True, slots=True, config=MESSAGE)
class ControlRequest:
    """Ask for something about control, beside the lease and the jobs.

    release: give the lease back, what moves stops. beat: a sign of life, the holder's keeps the lease, another
    operator's has no effect. arm: allow motion, for the holder alone. disarm: allow none any more, what moves stops.
    stop: a controlled stop of all motion, and disarm; it needs no lease. recover: in a fault, ask both arms to clear
    what they have latched, or for a new cell where the last one was lost.
    """

    operator: Operator
    verb: Literal["release", "beat", "arm", "disarm", "stop", "recover"]


JobRequest = DemonstrationRequest | TrialRequest | TeleoperationRequest | PlaybackRequest | MoveRequest | GuideRequest
Request = StatusRequest | JobRequest | TakeRequest | ControlRequest


@checked(frozen=True, slots=True, config=MESSAGE)
class Job:
    """One job. `progress` from 0 to 1, `reason` says why it failed or was stopped, `started_s` is Unix time.

    `log` is the file's name in the folder of logs; `success` is the trial's verdict, None until there is one;
    `recorded`: a teleoperation that is a recording. cameras: the shared memory of each camera's pictures, by its name.
    """

    number: Annotated[int, NUMBER]
    kind: JobKind
    state: JobState
    title: str
    progress: StrictFloat
    started_s: StrictFloat
    reason: str | None = None
    success: StrictBool | None = None
    log: str | None = None
    recorded: StrictBool = False
    cameras: dict[str, str] = field(default_factory=dict)

    @property
    def active(self) -> bool:
        """Whether the job holds the robot."""
        return self.state in (JobState.STARTING, JobState.RUNNING, JobState.STOPPING)


@checked(frozen=True, slots=True, config=MESSAGE)
class Status:
    """How the robot process is. `job` is the running job or the last one; `refusal` says why no job is accepted now.

    `object` is what the open cell holds. `phase` says whether the arms may move, since the Unix time `since_s`;
    `reason` is the fault's, until it is recovered from; `holder` is the operator who has control.
    `scheduler` is how the system schedules the loop's thread now: fifo while it is a real-time one, or other.
    """

    cell: str
    simulated: StrictBool
    objects: tuple[str, ...]
    object: str
    job: Job | None
    refusal: str | None
    phase: Phase
    reason: str | None
    holder: str | None
    since_s: StrictFloat
    stop_requested: StrictBool
    scheduler: str


@checked(frozen=True, slots=True, config=MESSAGE)
class Answer:
    """The answer to a request: the status after it, or one line that says why it was refused."""

    status: Status | None = None
    error: str | None = None


_REQUESTS: TypeAdapter[Request] = TypeAdapter(Annotated[Request, Field(discriminator="verb")])
_ANSWERS: TypeAdapter[Answer] = TypeAdapter(Answer)


def encode(message: Request | Answer) -> bytes:
    """Return the line of a message, with its end."""
    return json.dumps(asdict(message), separators=(",", ":")).encode() + b"\n"


def decode_request(line: bytes) -> Request:
    """Return the request on a line. Raises ProtocolError."""
    return _checked(_REQUESTS, line, "request")


def decode_answer(line: bytes) -> Answer:
    """Return the answer on a line. Raises ProtocolError."""
    return _checked(_ANSWERS, line, "answer")


def _checked(adapter: TypeAdapter[Any], line: bytes, kind: str) -> Any:
    try:
        return adapter.validate_json(line)
    except ValidationError as error:
        first = error.errors(include_url=False, include_input=False)[0]
        key = ".".join(str(part) for part in first["loc"]) or "the line"
        raise ProtocolError(f"{kind}: {key}: {first['msg']}") from None
