"""The card of a trial: how it ended, in a word and a sentence; three numbers beside earlier trials'; its impact."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from statistics import fmean, stdev

from console.orders import TrialOrder
from console.refused import Refused
from console.trials.impact import Impact, impact_of, thinned
from hal.displacement import Displacement
from rtstack.log.errors import LogError
from rtstack.log_folder.catalogue import Catalogue, LogEntry
from rtstack.log_folder.log_rows import Ending, LogRow, NoReference, log_row, reference_of
from rtstack.samples import LawInertia
from rtstack.trials.errors import TrialError
from rtstack.trials.specification import TrialSpecification, like, specification_of

TRIAL = "trial"
COMPARED = 10
_POINTS = 300


@dataclass(frozen=True, slots=True)
class Number:
    """One number of a trial, None where it has none. before: of earlier trials, the newest first, with their mean and
    standard deviation (None for fewer than two); about: what it is, in a sentence.
    """

    name: str
    unit: str
    about: str
    value: float | None
    before: tuple[float, ...]
    mean: float | None
    spread: float | None


@dataclass(frozen=True, slots=True)
class TrialCard:
    """The card of a trial. what: the order in words; sentence: how it ended and why; compared: number of earlier trials
    with this object that the numbers are compared with, at most ten; before: id of the newest earlier trial. again: the
    order, for a repetition; None if its reference can no longer be followed, with the reason in `refusal`.
    """

    row: LogRow
    ending: Ending
    what: str
    sentence: str
    numbers: tuple[Number, ...]
    compared: int
    impact: Impact | None
    before: str | None
    again: TrialOrder | None
    refusal: str | None


_Value = Callable[[LogRow, Impact | None], float | None]

_NUMBERS: tuple[tuple[str, str, str, _Value], ...] = (
    (
        "Peak contact force", "N",
        "The largest force that a pad felt, from 20 ms before the detected impact to 200 ms after it; the larger arm's",
        lambda row, impact: None if impact is None else impact.peak_force_n,
    ),
    (
        "Mean force norm", "",
        "Mean of the norm (33) of both arms' interaction wrenches, N and Nm, over 200 ms around the nominal impact",
        lambda row, impact: row.average_force_norm,
    ),
    (
        "Tracking error", "mm",
        "The largest distance of a pad from its reference within 200 ms after the impact; the larger arm's",
        lambda row, impact: None if impact is None else impact.error_mm,
    ),
)  # fmt: skip


def trial_card(catalogue: Catalogue, log_id: str) -> TrialCard:
    """Return the card of a trial. Raises Refused, LogError."""
    entries = catalogue.entries()
    entry = next((each for each in entries if each.id == log_id), None)
    if entry is None or entry.kind != TRIAL:
        raise Refused(404, "there is no such trial; look at the list of logs again")
    row = log_row(entry, None)
    earlier = [each for each in entries if each.kind == TRIAL and each.modified_s < entry.modified_s]
    alike = [(each, log_row(each, None)) for each in earlier]
    alike = [(each, its) for each, its in alike if its.object == row.object and its.success is not None][:COMPARED]
    impact = impact_of(entry)
    known = [(row, impact), *((its, impact_of(each)) for each, its in alike)]
    numbers = []
    for name, unit, about, value in _NUMBERS:
        now, *found = (value(its, hit) for its, hit in known)
        before = tuple(each for each in found if each is not None)
        mean, spread = fmean(before) if before else None, stdev(before) if len(before) > 1 else None
        numbers.append(Number(name, unit, about, now, before, mean, spread))
    again, refusal = _again(entries, catalogue, entry)
    place = Displacement.given(row.displacement_mm or 0.0, row.displacement_x_mm or 0.0, row.yaw_deg or 0.0).in_words
    plain = ", ".join((text or "").replace("_", " ") for text in (row.controller, row.object))
    law = f", law with {row.law_inertia}" if row.law_inertia == LawInertia.LINKS else ""
    what = f"{plain}, {place}, seed {row.seed}{law}"
    return TrialCard(
        row, row.ending, what, _sentence(row, impact), tuple(numbers), len(alike),
        None if impact is None else thinned(impact, _POINTS), earlier[0].id if earlier else None, again, refusal,
    )  # fmt: skip


def _sentence(row: LogRow, impact: Impact | None) -> str:
    said = f"{row.outcome[:1].upper()}{row.outcome[1:]}."
    if row.ending is Ending.SUCCESS:
        words = {"expected": "the impact was the one that was meant", "not watched": "no monitor judged the impact"}
        said = f"Held until release; {words.get(row.verdict or '', 'the monitor came to no verdict on the impact')}."
    if impact is None:
        return said
    late = -impact.nominal_ms
    detected = f"Detected {abs(late):.0f} ms {'after' if late >= 0 else 'before'} the nominal impact."
    return f"{said} {detected if impact.detected else 'No impact was detected.'}"


def _again(entries: Sequence[LogEntry], catalogue: Catalogue, entry: LogEntry) -> tuple[TrialOrder | None, str | None]:
    """Return the order of a trial, or why it cannot be given again. Its reference is known by its file's name."""
    try:
        asked = specification_of(entry.trial or {})
    except TrialError as error:
        return None, str(error)
    assert isinstance(asked, TrialSpecification)  # as the kind of its log
    name = Path(asked.reference).name
    found = next((each for each in entries if each.path.name == name), None)
    if found is None:
        return None, f"its reference {name} is not among the logs"
    try:
        reference_of(catalogue, found.id)
    except (NoReference, LogError) as error:
        return None, f"its reference {name}: {error}"
    return like(TrialOrder, asked, reference=found.id, safety=()), None
