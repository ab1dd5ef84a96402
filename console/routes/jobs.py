"""Jobs: a scripted demonstration or a trial, one at a time."""

from typing import Annotated

from fastapi import APIRouter
from fastapi.exceptions import HTTPException
from pydantic import ConfigDict, Field
from pydantic.dataclasses import dataclass as checked

from console.log_rows import log_path
from console.parts import NeedsParts, NeedsSession, Parts
from console.routes.problems import problems
from rtstack.live.protocol import (
    DemonstrationRequest,
    JobRequest,
    ObjectName,
    Seed,
    Status,
    TeleoperationRequest,
    TrialRequest,
)
from rtstack.trials.specification import Controller

router = APIRouter(prefix="/api/jobs", tags=["jobs"], responses=problems(409, 503))

_STRICT = ConfigDict(extra="forbid", allow_inf_nan=False)


@checked(frozen=True, slots=True, config=_STRICT)
class DemonstrationOrder:
    """What the page asks for when it records a scripted demonstration."""

    object: ObjectName
    variation: Annotated[int, Field(ge=0, le=10_000)] = 0
    seed: Seed = 0


@checked(frozen=True, slots=True, config=_STRICT)
class TrialOrder:
    """What the page asks for when it runs a trial. `reference` is the id of a log, displacement in mm."""

    reference: Annotated[str, Field(min_length=1, max_length=128)]
    object: ObjectName
    controller: Controller = Controller.PROPOSED
    displacement_mm: Annotated[float, Field(ge=-1000.0, le=1000.0)] = 0.0
    seed: Seed = 0


@checked(frozen=True, slots=True, config=_STRICT)
class TeleoperationOrder:
    """What the page asks for before it moves the arms by hand. See TeleoperationRequest."""

    object: ObjectName
    seed: Seed = 0
    recorded: bool = False
    stop_on_release: bool = True


@router.post("/teleoperation", status_code=202)
def teleoperation(order: TeleoperationOrder, session: NeedsSession, parts: NeedsParts) -> Status:
    """Start a teleoperation: the arms hold where they are until the clutch is held."""
    request = TeleoperationRequest(
        order.object, order.seed, order.recorded, order.stop_on_release, operator=session.operator
    )
    return start_job(parts, request)


@router.post("/demonstration", status_code=202)
def demonstration(order: DemonstrationOrder, session: NeedsSession, parts: NeedsParts) -> Status:
    """Start a scripted demonstration."""
    return start_job(parts, DemonstrationRequest(order.object, order.variation, order.seed, operator=session.operator))


@router.post("/trial", status_code=202, responses=problems(404))
def trial(order: TrialOrder, session: NeedsSession, parts: NeedsParts) -> Status:
    """Start a trial against a recording."""
    path = log_path(parts.catalogue, order.reference)
    if path is None:
        raise HTTPException(404, "there is no such recording; choose one from the list")
    return start_job(
        parts,
        TrialRequest(
            reference=str(path),
            controller=order.controller,
            object=order.object,
            displacement_mm=order.displacement_mm,
            seed=order.seed,
            operator=session.operator,
        ),
    )


def start_job(parts: Parts, request: JobRequest) -> Status:
    """Order a job and return the status that answers. Raises RobotRefused, RobotUnreachable."""
    status = parts.client.start(request)
    parts.watch.learn(status)
    return status
