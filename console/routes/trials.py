"""What trials have come to: the card of one, and the means of the queue's."""

from fastapi import APIRouter

from console.log_rows import log_row
from console.parts import NeedsParts
from console.routes.problems import problems
from console.trials.card import TrialCard, trial_card
from console.trials.means import MeansOf, Measure, means_of

router = APIRouter(prefix="/api", tags=["trials"], responses=problems(500))


@router.get("/trials/{log_id}/card", responses=problems(404))
def card(log_id: str, parts: NeedsParts) -> TrialCard:
    """Return a trial's card by its log's id: how it ended, three numbers beside the last ten trials, its impact."""
    return trial_card(parts.catalogue, parts.impacts, log_id)


@router.get("/trials/means")
def means(parts: NeedsParts, measure: Measure = Measure.FORCE) -> list[MeansOf]:
    """Return the means of the queue's trials that have ended, with 95 % intervals, by controller, object and shift."""
    logs = {entry.id: entry for entry in parts.catalogue.entries()}
    ended = [logs[entry.log] for entry in parts.queue.view().entries if entry.log in logs]
    return means_of([log_row(entry, None) for entry in ended], measure)
