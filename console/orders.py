"""What HTTP asks for: the specifications of rtstack.trials.specification. A body names a log by its id, not by a path,
names its object, and has no key for what the console, the robot process or a file fills in.
"""

from dataclasses import field
from typing import Annotated, Literal

from pydantic import Field
from pydantic.dataclasses import dataclass as checked
from pydantic.json_schema import SkipJsonSchema

from rtstack.messages import MESSAGE
from rtstack.trials import specification
from rtstack.trials.specification import ObjectName

LogId = Annotated[str, Field(min_length=1, max_length=128)]
# a key that a body may not have: it accepts its default alone, and is neither described nor answered
_NoText = SkipJsonSchema[Annotated[Literal[""], Field(exclude=True)]]
_NoNumber = SkipJsonSchema[Annotated[Literal[0], Field(exclude=True)]]
_Nothing = SkipJsonSchema[Annotated[None, Field(exclude=True)]]
_NoEntries = SkipJsonSchema[Annotated[tuple[()], Field(exclude=True)]]


@checked(frozen=True, slots=True, config=MESSAGE)
class TrialOrder(specification.TrialSpecification):
    """One trial. `reference` is the id of an accepted recording or of a plan; displacement along the world's y and x,
    mm, and about z; `reaction`: to an impact that was not meant; `law_inertia`: the mass matrix of the controller's
    law, null: the cell's; `shadow`: torques are computed, judged and logged, and none is sent.
    """

    reference: LogId
    object: ObjectName = field(kw_only=True)
    safety: _NoEntries = ()


@checked(frozen=True, slots=True, config=MESSAGE)
class PlanOrder:
    """A grab to be planned. speed: of both pads when they meet the object, m/s; height: of the pads over its centre
    there, m; squeeze: force of each pad, N. null, or left out: as `rtstack plan`.
    """

    object: ObjectName
    speed: float | None = None
    height: float | None = None
    squeeze: float | None = None


@checked(frozen=True, slots=True, config=MESSAGE)
class DemonstrationOrder(specification.DemonstrationSpecification):
    """A scripted demonstration."""

    object: ObjectName = field(kw_only=True)
    speed_m_s: _Nothing = None
    squeeze_m: _Nothing = None
    squeeze_s: _Nothing = None


@checked(frozen=True, slots=True, config=MESSAGE)
class TeleoperationOrder(specification.TeleoperationSpecification):
    """The arms are moved by hand. recorded: as a recording, from home; stop_on_release: it ends with a clutch that is
    released.
    """

    operator: _NoText = ""
    object: ObjectName = field(kw_only=True)
    job: _NoNumber = 0


@checked(frozen=True, slots=True, config=MESSAGE)
class MoveOrder(specification.MoveSpecification):
    """The arms move by themselves from where they are."""

    object: _NoText = ""
    seed: _NoNumber = 0


@checked(frozen=True, slots=True, config=MESSAGE)
class PlaybackOrder(specification.PlaybackSpecification):
    """A log is played on the arms. `log` is its id, speed times the log's own."""

    source: Annotated[LogId, Field(alias="log")]
    digest: _NoText = ""
    object: _NoText = ""
