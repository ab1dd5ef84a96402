"""The cell's calibration: points, what they give, and the cell's file."""

from dataclasses import asdict
from typing import Annotated, Literal

from fastapi import APIRouter, Path
from fastapi.exceptions import HTTPException
from pydantic import Field
from pydantic.dataclasses import dataclass as checked

from console.calibration import CalibrationView
from console.parts import NeedsHolder, NeedsParts, NeedsSession, Parts
from console.routes.problems import problems
from rtstack.calibration.points import Point
from rtstack.messages import MESSAGE, StrictFloat

router = APIRouter(prefix="/api/calibration", tags=["calibration"], responses=problems(409))

_Name = Annotated[str, Path(min_length=1, max_length=40, pattern=r"^[A-Za-z0-9_-]+$")]
_Metres = Annotated[StrictFloat, Field(ge=-100.0, le=100.0, allow_inf_nan=False)]


@checked(frozen=True, slots=True, config=MESSAGE)
class PlacedPoint:
    """A place of one arm: see rtstack.calibration.points. place: m, in the world, or in the tracker's frame."""

    what: Literal["touch", "see"]
    side: Literal["left", "right"]
    place: tuple[_Metres, _Metres, _Metres]


@checked(frozen=True, slots=True, config=MESSAGE)
class StandingPoint:
    """Where the tracker sees the body that it follows of an object in its place: m, in the tracker's frame."""

    what: Literal["stand"]
    object: Annotated[str, Field(min_length=1, max_length=40)]
    place: tuple[_Metres, _Metres, _Metres]


@checked(frozen=True, slots=True, config=MESSAGE)
class FreePoint:
    """Something that both arms do, wherever it is."""

    what: Literal["meet", "rest"]


@router.get("")
def calibration(parts: NeedsParts) -> CalibrationView:
    """Return the points and what they give; ask again while `looking`."""
    return parts.calibration.view()


@router.post("/points/{name}")
def put(
    name: _Name, point: PlacedPoint | StandingPoint | FreePoint, session: NeedsSession, parts: NeedsParts
) -> CalibrationView:
    """Add a point that is to be measured."""
    parts.calibration.put(name, Point(**asdict(point)))
    return parts.calibration.view()


@router.delete("/points/{name}", responses=problems(404))
def remove(name: _Name, session: NeedsSession, parts: NeedsParts) -> CalibrationView:
    """Forget a point."""
    parts.calibration.remove(name)
    return parts.calibration.view()


@router.post("/points/{name}/take", responses=problems(404, 503))
def take(name: _Name, session: NeedsHolder, parts: NeedsParts) -> CalibrationView:
    """Measure a point as the arms stand now. By who has control, while no job runs."""
    _check_idle(parts)
    parts.calibration.take(name)
    return parts.calibration.view()


@router.post("/write", responses=problems(503))
def write(session: NeedsHolder, parts: NeedsParts) -> CalibrationView:
    """Write bases, tracker, pads of real arms, date and errors into the cell's file; jobs need a new start then."""
    _check_idle(parts)
    parts.calibration.write()
    return parts.calibration.view()


def _check_idle(parts: Parts) -> None:
    job = parts.client.status().job
    if job is not None and job.active:
        raise HTTPException(409, f"{job.kind} {job.number} is running: let it end first")
