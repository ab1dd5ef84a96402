"""The robot: its status."""

from fastapi import APIRouter

from console.parts import NeedsParts
from console.routes.problems import problems
from rtstack.live.protocol import Status

router = APIRouter(prefix="/api", tags=["robot"], responses=problems(503))


@router.get("/status")
def status(parts: NeedsParts) -> Status:
    """Return how the robot process is."""
    return parts.client.status()
