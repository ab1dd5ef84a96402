"""The robot: its status, STOP, and recovery."""

from typing import Any

from fastapi import APIRouter

from console.parts import NeedsParts
from rtstack.live.protocol import status_document

router = APIRouter(prefix="/api")


@router.get("/status")
def status(parts: NeedsParts) -> dict[str, Any]:
    """Return how the robot process is."""
    return status_document(parts.client.status())


@router.post("/stop")
async def stop(parts: NeedsParts) -> dict[str, bool]:
    """Ask for a controlled stop. One word in shared memory: it waits for nobody, whatever else hangs."""
    parts.mailbox.request_stop()
    return {"stop_requested": True}


@router.post("/recover")
def recover(parts: NeedsParts) -> dict[str, Any]:
    """Ask both arms to clear a latched error; the answer says why they refuse."""
    answer = parts.client.recover()
    parts.watch.learn(answer)
    return status_document(answer)
