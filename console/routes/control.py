"""Control of the robot: the lease, arming, STOP, recovery. Each answers with the status after it, or with one line."""

import asyncio
import contextlib
import time
from collections.abc import Callable
from dataclasses import dataclass

from fastapi import APIRouter
from pydantic.dataclasses import dataclass as checked

from console.live.control_request import RequestView
from console.parts import NeedsHolder, NeedsParts, NeedsSession, Parts
from console.routes.problems import problems
from console.sign_in import UserSession
from rtstack.live.client import RobotClient, RobotRefused, RobotUnreachable
from rtstack.live.protocol import Operator, Status
from rtstack.loop.mailbox import NOT_TAKEN, TAKEN_S
from rtstack.messages import MESSAGE

_LOOK_S = 2e-3
router = APIRouter(prefix="/api", tags=["control"], responses=problems(409, 503))


@checked(frozen=True, slots=True, config=MESSAGE)
class TakeOrder:
    """What a session asks for when it takes control: what it calls itself from now on, and from whom it takes over."""

    operator: Operator | None = None
    over_from: Operator | None = None


@checked(frozen=True, slots=True, config=MESSAGE)
class AskOrder:
    """What a session calls itself from now on, as it asks for control."""

    operator: Operator | None = None


@dataclass(frozen=True, slots=True)
class StopRequested:
    """Says that STOP has reached the loop. taken: it brakes the arms; False where no session controls them."""

    stop_requested: bool
    taken: bool


_reports: set[asyncio.Task[None]] = set()  # that are under way


@router.post("/take")
def take(order: TakeOrder, session: NeedsSession, parts: NeedsParts) -> Status:
    """Take control, under the name that the session has or gives itself. It lasts while there are signs of life."""
    named = parts.sign_in.rename(session, order.operator or session.operator)
    try:
        if named.operator != session.operator and parts.client.status().holder == named.operator:
            # a program without a session, or what is left of one: its name is free, its lease is not
            raise RobotRefused(f"{named.operator} has control; choose another name, or take over")
        return parts.watch.learn(parts.client.take(named.operator, order.over_from))
    except (RobotRefused, RobotUnreachable):
        parts.sign_in.rename(session, session.operator)
        raise


@router.post("/request")
def request(order: AskOrder, session: NeedsSession, parts: NeedsParts) -> Status:
    """Ask the operator who has control for it. The pages of both show the question; nothing else changes."""
    status = parts.client.status()
    if status.holder is None or status.holder == session.operator:
        raise RobotRefused(f"{'you have' if status.holder else 'no operator has'} control: there is none to ask")
    named = parts.sign_in.rename(session, order.operator or session.operator)
    parts.request.ask(named.operator, status.holder)
    return status


@router.post("/request/keep")
def keep(holder: NeedsHolder, parts: NeedsParts) -> RequestView:
    """Answer a request for control: no."""
    return parts.request.keep(holder.operator)


@router.post("/request/give")
def give(holder: NeedsHolder, parts: NeedsParts) -> Status:
    """Answer a request for control: hand it over, while nothing moves; the cell is disarmed."""
    asked = parts.request.view(holder.operator)
    if asked is None:
        raise RobotRefused("no operator asks for control any more")
    status = parts.watch.learn(parts.client.take(asked.operator, holder.operator))
    parts.audit.note("give", holder.operator, f"{holder.operator} handed control over to {asked.operator}")
    return status


@router.post("/beat")
async def beat(session: NeedsSession, parts: NeedsParts) -> Status:
    """Give a sign of life: a program's way. Pages answer what the live socket sends them."""
    view = parts.watch.view
    if view.status is None or view.unreachable is not None:
        raise RobotUnreachable(view.unreachable or "the robot process has not answered yet")
    if view.status.holder != session.operator:
        raise RobotRefused(f"{view.status.holder or 'no operator'} has control; take control first")
    parts.heartbeats.note(session.operator)
    return view.status


@router.post("/stop")
async def stop(session: NeedsSession, parts: NeedsParts) -> StopRequested:
    """Ask for a controlled stop, by a word in shared memory; answer when the loop has taken it, 503 if it does not."""
    return StopRequested(True, await request_stop(parts, session))


def _add(ask: Callable[[RobotClient, str], Status], about: str) -> None:
    """Add what the robot process is asked for in the session's name alone."""

    def order(session: NeedsSession, parts: NeedsParts) -> Status:
        return parts.watch.learn(ask(parts.client, session.operator))

    router.add_api_route(f"/{ask.__name__}", order, methods=["POST"], name=ask.__name__, description=about)


_add(RobotClient.release, "Give control back; what moves stops.")
_add(RobotClient.arm, "Allow motion.")
_add(RobotClient.disarm, "Allow no motion any more; what moves stops.")
_add(RobotClient.recover, "In a fault: ask both arms to clear what they have latched; the answer says why they refuse.")


async def request_stop(parts: Parts, session: UserSession) -> bool:
    """Ask for a controlled stop; return whether there is a motion that takes it. Raises RobotUnreachable."""
    turn = parts.mailbox.request_stop()
    report = asyncio.create_task(report_stop(parts, session))
    _reports.add(report)
    report.add_done_callback(_reports.discard)
    due_s = time.monotonic() + TAKEN_S
    while not parts.mailbox.stop_taken(turn):
        if time.monotonic() > due_s:
            raise RobotUnreachable(NOT_TAKEN)
        await asyncio.sleep(_LOOK_S)
    return turn > 0


async def report_stop(parts: Parts, session: UserSession) -> None:
    """Tell the robot process whose STOP it was, for the record: the arms stop without it."""
    with contextlib.suppress(RobotRefused, RobotUnreachable):
        await asyncio.to_thread(parts.client.stop, session.operator)
