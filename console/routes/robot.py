"""The robot: its status."""

from typing import Any

from fastapi import APIRouter

from console.parts import NeedsParts
from rtstack.live.protocol import status_document

router = APIRouter(prefix="/api")


@router.get("/status")
def status(parts: NeedsParts) -> dict[str, Any]:
    """Return how the robot process is."""
    return status_document(parts.client.status())
