"""Messages on the robot process's socket: one JSON object a line, one answer to each request, in order.

Requests and answers are frozen dataclasses, checked on arrival; an invalid one is refused with one line that names the
key. The socket carries orders and status, never samples (rings) or the fast path of a stop (mailbox).
"""

import json
from dataclasses import asdict, field
from enum import StrEnum
from typing import Annotated, Any, Literal, get_args

from pydantic import Field, PlainValidator, TypeAdapter, ValidationError
from pydantic.dataclasses import dataclass as checked
from pydantic_core import PydanticCustomError

from rtstack.messages import MESSAGE, NUMBER, StrictBool, StrictFloat, problem
from rtstack.safety.arming import Phase
from rtstack.trials.specification import (
    DemonstrationSpecification,
    GuideSpecification,
    MoveSpecification,
    PlacementSpecification,
    PlaybackSpecification,
    TeleoperationSpecification,
    TrialSpecification,
)

MAX_LINE_BYTES = 1 << 20  # a request or an answer is far shorter: what is longer is not ours

# a person's or a program's name: one line without control characters, and no space around it
_LOG_PATH = r"^(([A-Za-z0-9][^/\p{C}]*/)*[A-Za-z0-9][^/\p{C}]*\.mcap)?$"
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
    PLACE = "place"
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


JobSpecification = (
    TrialSpecification
    | DemonstrationSpecification
    | TeleoperationSpecification
    | PlaybackSpecification
    | MoveSpecification
    | PlacementSpecification
    | GuideSpecification
)
_SPECIFICATIONS: dict[str, TypeAdapter[Any]] = {kind.verb: TypeAdapter(kind) for kind in get_args(JobSpecification)}


def _specification(value: Any) -> Any:
    """Return the specification of the kind that a message names."""
    if isinstance(value, JobSpecification):
        return value
    values = dict(value) if isinstance(value, dict) else {}
    adapter = _SPECIFICATIONS.get(str(values.pop("kind", "")))
    if adapter is None:
        raise PydanticCustomError("kind", "kind: expected one of {known}", {"known": ", ".join(_SPECIFICATIONS)})
    if values.get("safety"):
        raise PydanticCustomError("safety", "safety: limits are tightened by a file, not by a request")
    try:
        return adapter.validate_python(values)
    except ValidationError as error:
        raise PydanticCustomError("specification", "{line}", {"line": problem(error)}) from None


@checked(frozen=True, slots=True, config=MESSAGE)
class RunRequest:
    """Ask for a run, by the operator who has armed. On the line the specification has one more key, its `kind`.

    faults: the text of a faults file for the simulated robot, as for `rtstack sim --faults`; empty for none.
    log: path of the log in the folder of logs; empty: a name of its time and kind. campaign: what the log says of the
    campaign that the run is part of. watched: a person watches the runs of real arms, so that no clutch is held.
    """

    specification: Annotated[JobSpecification, PlainValidator(_specification)]
    operator: Operator
    faults: Annotated[str, Field(max_length=4096)] = ""
    log: Annotated[str, Field(max_length=1024, pattern=_LOG_PATH)] = ""
    campaign: dict[str, str] = field(default_factory=dict)
    watched: StrictBool = False
    verb: Literal["run"] = "run"

    @property
    def kind(self) -> JobKind:
        """The kind of job."""
        return JobKind(self.specification.verb)

    @property
    def title(self) -> str:
        """The run in one line, for people."""
        return self.specification.title + ", training" * bool(self.faults)


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


@checked(frozen=True, slots=True, config=MESSAGE)
class NoteRequest:
    """Say something in the log of what runs, and in the audit trail. failed: its result is a failure, for this."""

    operator: Operator
    text: Annotated[str, Field(max_length=500, pattern=r"^\P{C}+$")]
    failed: StrictBool = False
    verb: Literal["note"] = "note"


Request = StatusRequest | RunRequest | TakeRequest | ControlRequest | NoteRequest


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
    kind: of the cell, as the command line spells it; cell_file, logs: paths of its description and the folder of logs.
    """

    cell: str
    kind: str
    cell_file: str
    logs: str
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
    values = asdict(message)
    if isinstance(message, RunRequest):
        values["specification"]["kind"] = message.kind
    return json.dumps(values, separators=(",", ":")).encode() + b"\n"


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
        raise ProtocolError(f"{kind}: {problem(error, 'the line')}") from None
