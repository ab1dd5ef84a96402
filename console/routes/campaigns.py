"""Campaigns: started, cancelled and resumed; their progress, results, figures and reports, by opaque ids."""

import contextlib
import csv
import io
import os
import pathlib
import sys
from dataclasses import asdict, dataclass
from functools import lru_cache
from typing import Annotated, Any

from fastapi import APIRouter, Path, Query
from fastapi.exceptions import HTTPException
from fastapi.responses import FileResponse, Response
from pydantic import Field
from pydantic.dataclasses import dataclass as checked

from console.campaigns.campaigns import NICENESS, NICEST, CampaignView
from console.campaigns.folder import hidden
from console.parts import NeedsParts, NeedsSession, Parts, check_objects, takes_two_arms
from console.queue.entry import MOST_SHIFT_MM, Numbers, numbers
from console.routes.problems import attachment, file_of, problems
from console.sign_in import UserSession
from hal.base.configuration import ConfigurationError
from rtstack.experiments.registry import installed_plans, keep_plan, kind_named, kind_of, own_plans, plan_folder
from rtstack.live.client import RobotRefused
from rtstack.live.protocol import Phase
from rtstack.messages import MESSAGE, NUMBER, StrictBool
from rtstack.trials.controllers import ControllerName
from rtstack.trials.errors import TrialError
from rtstack.trials.specification import ObjectName, Seed

router = APIRouter(prefix="/api", tags=["campaigns"], responses=problems(404, 409))

_COMPARISON = "reference-spreading"  # the kind of experiment that compares controllers
_MOST_ROWS = 10_000
# a report is a page of its own: its style and pictures are inside, and it may do nothing at all; of our origin, so that
# the page around it hears the space bar in it
REPORT_POLICY = (
    "sandbox allow-same-origin; default-src 'none'; style-src 'unsafe-inline'; img-src data:; frame-ancestors 'self'"
)

Id = Annotated[str, Path(pattern="^[0-9a-f]{16}$")]
Workers = Annotated[int, Field(ge=1, le=256), NUMBER]
_TWO_ARMS = takes_two_arms("a campaign of trials")


@checked(frozen=True, slots=True, config=MESSAGE)
class RunOrder:
    """How a campaign is to run. `nice`: beside arms that are armed or move, at the lowest priority."""

    workers: Workers | None = None
    nice: StrictBool = False


@checked(frozen=True, slots=True, config=MESSAGE)
class CampaignOrder:
    """A plan by its name, all of it or its sample. on_cell: on the arms of this cell, not simulated."""

    name: Annotated[str, Field(min_length=1, max_length=64)]
    quick: StrictBool = False
    workers: Workers | None = None
    nice: StrictBool = False
    on_cell: StrictBool = False


@checked(frozen=True, slots=True, config=MESSAGE)
class PlanOrder:
    """A plan of the user's own: every controller with so many scripted demonstrations of each object, at every shift of
    the object along y (mm, as -60:10:60 or -30, 0, 30), with so many repetitions.
    """

    name: Annotated[str, Field(min_length=1, max_length=48, pattern="^[a-z][a-z0-9-]*$")]
    controllers: Annotated[tuple[ControllerName, ...], Field(min_length=1, max_length=32)]
    objects: Annotated[tuple[ObjectName, ...], Field(min_length=1, max_length=32)]
    displacements_mm: Numbers
    demonstrations: Annotated[int, Field(ge=1, le=20), NUMBER] = 1
    repetitions: Annotated[int, Field(ge=1, le=200), NUMBER] = 1
    seed: Seed = 1
    title: Annotated[str, Field(max_length=80, pattern=r"^\P{C}*$")] = ""


@dataclass(frozen=True, slots=True)
class PlanView:
    """A campaign that can be started, or the `problem` of one that cannot. quick_trials: of its sample, None where it
    has none; own: of the user's own; on_cell: whether it can run on arms.
    """

    name: str
    title: str
    trials: int
    quick_trials: int | None
    own: bool = False
    problem: str | None = None
    on_cell: bool = False


@dataclass(frozen=True, slots=True)
class CampaignsView:
    """What can be started, and what was. folder: of the user's own plans, which may be edited there."""

    plans: tuple[PlanView, ...]
    campaigns: tuple[CampaignView, ...]
    folder: str


@dataclass(frozen=True, slots=True)
class ResultsView:
    """The newest results: values by columns, and for each row the opaque id of its log, None without one."""

    columns: tuple[str, ...]
    rows: tuple[tuple[Any, ...], ...]
    logs: tuple[str | None, ...]


@dataclass(frozen=True, slots=True)
class Adopted:
    """The id of a log among the logs."""

    log: str


@router.get("/campaigns")
def campaigns(parts: NeedsParts) -> CampaignsView:
    """Return the plans that can be started, and the campaigns that were, the newest first."""
    return CampaignsView(_plans(), tuple(parts.campaigns.views()), str(plan_folder()))


@router.post("/campaigns", status_code=201, responses=problems(503), dependencies=[_TWO_ARMS])
def start(order: CampaignOrder, session: NeedsSession, parts: NeedsParts) -> CampaignView:
    """Start a campaign here. Refused while another operator has control, or, without `nice`, with armed arms.

    On this cell: refused unless the arms are armed, by the operator who asks; the campaign takes control over.
    """
    known = {plan.name: plan for plan in _plans()}
    if order.name not in known:
        raise HTTPException(404, f"name: there is no such campaign; there are {', '.join(known)}")
    if known[order.name].problem is not None:
        raise HTTPException(409, f"name: this plan cannot be run: {known[order.name].problem}")
    if order.on_cell and not known[order.name].on_cell:
        raise HTTPException(409, f"on_cell: {order.name} runs in the simulator alone")
    niceness = _niceness(order.nice, order.on_cell, session, parts)
    return parts.campaigns.start(order.name, order.quick, order.workers, niceness, order.on_cell)


@router.post("/plans", status_code=201, responses=problems(422), dependencies=[_TWO_ARMS])
def keep(order: PlanOrder, parts: NeedsParts) -> PlanView:
    """Write a plan of the user's own into their folder; it can then be started by its name. Never over another one."""
    check_objects(parts, "objects", *order.objects)
    if order.name in installed_plans():
        raise HTTPException(409, f"name: {order.name} is an installed plan; take another name")
    kind = kind_named(_COMPARISON)
    values = asdict(order) | {
        "title": order.title or order.name.replace("-", " "),
        "controllers": tuple(dict.fromkeys(order.controllers)),
        "objects": tuple(dict.fromkeys(order.objects)),
        "displacements_mm": tuple(numbers("displacements_mm", order.displacements_mm, MOST_SHIFT_MM)),
    }
    path = keep_plan(order.name, kind.composed(values), lambda path: kind.read(path, quick=False))
    return _read(order.name, path, own=True)


@router.get("/campaigns/{campaign_id}")
def campaign(campaign_id: Id, parts: NeedsParts) -> CampaignView:
    """Return a campaign's state, progress, figures and claims."""
    return parts.campaigns.view(campaign_id)


@router.post("/campaigns/{campaign_id}/resume", responses=problems(503), dependencies=[_TWO_ARMS])
def resume(campaign_id: Id, order: RunOrder, session: NeedsSession, parts: NeedsParts) -> CampaignView:
    """Run what is missing, under the same rules as a start."""
    niceness = _niceness(order.nice, parts.campaigns.view(campaign_id).on_cell, session, parts)
    return parts.campaigns.resume(campaign_id, order.workers, niceness)


@router.post("/campaigns/{campaign_id}/cancel")
def cancel(campaign_id: Id, parts: NeedsParts) -> CampaignView:
    """End a campaign as at Ctrl-C: what it has stays, and it can be resumed. Everybody who is signed in."""
    return parts.campaigns.cancel(campaign_id)


@router.post("/campaigns/{campaign_id}/pause")
def pause(campaign_id: Id, session: NeedsSession, parts: NeedsParts) -> CampaignView:
    """Begin no further run of a campaign on the arms; what runs goes on to its end. It needs no lease."""
    return parts.campaigns.pause(campaign_id, f"paused by {session.operator}")


@router.post("/campaigns/{campaign_id}/continue")
def go_on(campaign_id: Id, session: NeedsSession, parts: NeedsParts) -> CampaignView:
    """Go on with a campaign that is paused; where the arms were disarmed meanwhile, it arms them."""
    parts.audit.note("continue", session.operator, f"{session.operator} let the campaign on the arms go on")
    return parts.campaigns.pause(campaign_id, None)


@router.get("/campaigns/{campaign_id}/results")
def results(
    campaign_id: Id, parts: NeedsParts, limit: Annotated[int, Query(ge=1, le=_MOST_ROWS)] = 1000
) -> ResultsView:
    """Return the newest results as far as there are any."""
    columns, rows = parts.campaigns.folder(campaign_id).rows(limit)
    return ResultsView(
        tuple(columns),
        tuple(tuple(row[name] for name in columns) for row in rows),
        tuple(hidden(row["id"]) if row.get("log") else None for row in rows),
    )


@router.get("/campaigns/{campaign_id}/csv", response_class=Response, responses=file_of("text/csv"))
def table(campaign_id: Id, parts: NeedsParts) -> Response:
    """Send all results as CSV."""
    columns, rows = parts.campaigns.folder(campaign_id).rows(_MOST_ROWS)
    text = io.StringIO()
    writer = csv.DictWriter(text, columns, lineterminator="\n")
    writer.writeheader()
    writer.writerows(reversed(rows))
    return Response(text.getvalue(), media_type="text/csv", headers=attachment("results.csv"))


@router.get("/campaigns/{campaign_id}/report", response_class=FileResponse, responses=file_of("text/html"))
def report(campaign_id: Id, parts: NeedsParts) -> FileResponse:
    """Send the report, a page that may do nothing."""
    path = parts.campaigns.folder(campaign_id).report
    if path is None:
        raise HTTPException(404, "this campaign has no report yet: it is written at its end")
    return FileResponse(path, media_type="text/html", headers={"content-security-policy": REPORT_POLICY})


@router.get("/campaigns/{campaign_id}/figures/{figure_id}", response_class=FileResponse, responses=file_of("image/png"))
def figure(campaign_id: Id, figure_id: Id, parts: NeedsParts) -> FileResponse:
    """Send a figure as PNG."""
    path = parts.campaigns.folder(campaign_id).figures().get(figure_id)
    if path is None:
        raise HTTPException(404, "there is no such figure; look at the campaign again")
    return FileResponse(path, media_type="image/png")


@router.post("/campaigns/{campaign_id}/logs/{row_id}")
def adopt(campaign_id: Id, row_id: Id, parts: NeedsParts) -> Adopted:
    """Put the log behind a result among the logs, where it can be reviewed."""
    folder = parts.campaigns.folder(campaign_id)
    log = folder.log(row_id)
    if log is None:
        raise HTTPException(404, "there is no log behind this result")
    target = parts.catalogue.directory / f"{folder.path.name}-{log.name}"
    try:
        with contextlib.suppress(FileExistsError):
            os.link(log, target)  # the same file under a second name: it takes no room
    except OSError as error:
        raise HTTPException(409, f"it cannot be put among the logs: {error.strerror}") from None
    for entry in parts.catalogue.entries():
        if entry.path.name == target.name:
            return Adopted(entry.id)
    raise HTTPException(404, "it was removed meanwhile")


def _niceness(nice: bool, on_cell: bool, session: UserSession, parts: Parts) -> int:
    """Return a campaign's niceness. Raises RobotRefused where it would disturb who has control, or may move no arms."""
    status = parts.client.status()
    if on_cell and (status.holder != session.operator or status.phase is not Phase.ARMED):
        raise RobotRefused("take control and arm the arms first: a campaign on this cell takes over from you")
    if not on_cell and status.holder not in (None, session.operator):
        raise RobotRefused(f"{status.holder} has control: a campaign would take this machine's time; ask them")
    if not on_cell and status.phase in (Phase.ARMED, Phase.MOVING) and not nice:
        raise RobotRefused(
            f"the arms are {status.phase}: a campaign takes this machine's time; disarm them, or start it with `nice`"
        )
    return NICEST if nice else NICENESS


def _plans() -> tuple[PlanView, ...]:
    """Return what can be started, and the user's own plans that cannot, with the reason."""
    taken = {plan.name for plan in _installed()}
    own = [
        PlanView(path.name, "", 0, None, True, f"{name} is an installed plan: give the file {path} another name")
        if name in taken
        else _own(name, path, path.stat().st_mtime_ns)
        for name, path in own_plans().items()
    ]
    return (*_installed(), *own)


@lru_cache(maxsize=1)
def _installed() -> tuple[PlanView, ...]:
    """Return the installed plans that can be run: their kind is installed, and they are right. They are read once."""
    views = [_read(name, path) for name, path in installed_plans().items()]
    for view in views:
        if view.problem is not None:
            print(f"rtstack: warning: the campaign {view.name} is not offered: {view.problem}", file=sys.stderr)
    return tuple(view for view in views if view.problem is None)


@lru_cache(maxsize=64)
def _own(name: str, path: pathlib.Path, changed_ns: int) -> PlanView:
    """Return a plan of the user's own, read again once its file has changed."""
    return _read(name, path, own=True)


def _read(name: str, path: pathlib.Path, own: bool = False) -> PlanView:
    try:
        kind = kind_named(kind_of(path))
        whole = kind.read(path, quick=False)
    except (ConfigurationError, TrialError) as error:
        return PlanView(name, "", 0, None, own, str(error))
    try:
        sample = kind.read(path, quick=True).size()
    except ConfigurationError:
        sample = None
    return PlanView(name, whole.title, whole.size(), sample, own, on_cell=kind.runs_on_cell() and kind.on_stack)
