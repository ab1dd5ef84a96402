"""What is asked of a trial, and an entry of the queue: one trial, with what has become of it."""

from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path
from typing import Annotated

from pydantic import Field
from pydantic.dataclasses import dataclass as checked

from console.log_rows import Ending
from rtstack.live.protocol import DisplacementMm, ObjectName, Seed, TrialRequest, YawDeg
from rtstack.messages import MESSAGE, NUMBER, StrictFloat
from rtstack.samples import Reaction
from rtstack.trials.controllers import DEFAULT, ControllerName

MAX_REPETITIONS = 200


@checked(frozen=True, slots=True, config=MESSAGE)
class TrialOrder:
    """One trial. `reference` is the id of an accepted recording or of a plan; displacement along the world's y and x,
    mm, and about z; `reaction`: to an impact that was not meant.
    """

    reference: Annotated[str, Field(min_length=1, max_length=128)]
    object: ObjectName
    controller: ControllerName = DEFAULT
    displacement_mm: DisplacementMm = 0.0
    displacement_x_mm: DisplacementMm = 0.0
    yaw_deg: YawDeg = 0.0
    seed: Seed = 0
    reaction: Reaction = Reaction.CONTINUE

    def request(self, path: Path, operator: str) -> TrialRequest:
        """Return what the robot process is asked for; path: of the reference."""
        return TrialRequest(
            reference=str(path),
            controller=self.controller,
            object=self.object,
            displacement_mm=self.displacement_mm,
            displacement_x_mm=self.displacement_x_mm,
            yaw_deg=self.yaw_deg,
            seed=self.seed,
            reaction=self.reaction,
            operator=operator,
        )


@checked(frozen=True, slots=True, config=MESSAGE)
class QueueOrder:
    """The same trial so many times, each with the next seed: `seed`, `seed` + 1, ..."""

    trial: TrialOrder
    repetitions: Annotated[int, Field(ge=1, le=MAX_REPETITIONS), NUMBER] = 1


class EntryState(StrEnum):
    """Where an entry is. The last four are final."""

    WAITING = "waiting"
    RUNNING = "running"
    SUCCEEDED = "succeeded"
    FAILED = "failed"
    STOPPED = "stopped"
    CANCELLED = "cancelled"


@checked(frozen=True, slots=True, config=MESSAGE)
class Entry:
    """One trial of the queue. `followed`: what a person calls its reference; `repetition` of the `repetitions` that
    were added together, from 1.

    began_s: Unix time; duration_s: from the order to both arms at rest; reason: why it did not succeed; log: the id of
    its log; job: its number in the robot process, None before it has one; ending: as the list of logs
    says it.
    """

    id: str
    trial: TrialOrder
    followed: str
    repetition: Annotated[int, NUMBER] = 1
    repetitions: Annotated[int, NUMBER] = 1
    state: EntryState = EntryState.WAITING
    job: Annotated[int, NUMBER] | None = None
    began_s: StrictFloat | None = None
    duration_s: StrictFloat | None = None
    reason: str | None = None
    log: str | None = None
    ending: Ending | None = None

    @property
    def final(self) -> bool:
        """Whether nothing more becomes of it."""
        return self.state not in (EntryState.WAITING, EntryState.RUNNING)


@dataclass(frozen=True, slots=True)
class QueueView:
    """The queue as everybody sees it. `operator`: on whose word it runs, None while it is paused, for this `reason`.

    past_failures: whether it goes on past grabs that do not succeed. time_left_s: from the durations of the trials that
    have ended, None where none has.
    """

    running: bool
    operator: str | None
    reason: str | None
    past_failures: bool
    time_left_s: float | None
    entries: tuple[Entry, ...]
