"""The robot: its status, and what its modes are called."""

from dataclasses import dataclass

from fastapi import APIRouter

from console.parts import NeedsParts
from console.routes.problems import problems
from rtstack.live.protocol import Status
from rtstack.palette import MODE_STYLES

router = APIRouter(prefix="/api", tags=["robot"], responses=problems(503))


@dataclass(frozen=True, slots=True)
class ModeInfo:
    """A mode of the controller: its name in the live state and in logs, its word on pages, what it means, its colour,
    and that on a light ground.
    """

    name: str
    word: str
    meaning: str
    colour: str
    light: str


@router.get("/modes")
def modes() -> list[ModeInfo]:
    """Return every mode, as pages write and colour it."""
    return [ModeInfo(s.mode.name, s.word, s.meaning, s.colour, s.light) for s in MODE_STYLES.values()]


@router.get("/status")
def status(parts: NeedsParts) -> Status:
    """Return how the robot process is."""
    return parts.client.status()
