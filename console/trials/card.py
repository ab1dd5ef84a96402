"""The card of a trial: how it ended, in a word and a sentence; three numbers beside earlier trials'; its impact.

The numbers are what impact-aware grasping is about: how hard the hit was, what the contact cost on average (the paper's
measure), and how far the hit threw the pads off their way.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from statistics import fmean, stdev

from console.log_rows import Ending, LogRow, NoReference, log_row, reference_of, specification_of
from console.queue.entry import TrialOrder
from console.trials.impact import Impact, Impacts, thinned
from hal.displacement import Displacement
from rtstack.log.catalogue import Catalogue, LogEntry
from rtstack.log.errors import LogError
from rtstack.samples import Reaction

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
    """What a trial ends in. what: was asked, in words; sentence: why it ended so.

    compared: how many earlier trials with this object the numbers stand beside, at most ten; before: the id of the
    newest trial before it, of any object. again: the order that it was, None where its reference cannot be followed any
    more, for this `refusal`.
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


class NoTrial(Exception):
    """There is no trial of this id. The message is one line."""


def trial_card(catalogue: Catalogue, impacts: Impacts, log_id: str) -> TrialCard:
    """Return the card of a trial. Raises NoTrial, LogError."""
    entries = catalogue.entries()
    entry = next((each for each in entries if each.id == log_id), None)
    if entry is None or entry.kind != TRIAL:
        raise NoTrial("there is no such trial; look at the list of logs again")
    row = log_row(entry, None)
    earlier = [each for each in entries if each.kind == TRIAL and each.modified_s < entry.modified_s]
    alike = [(each, log_row(each, None)) for each in earlier]
    alike = [(each, its) for each, its in alike if its.object == row.object and its.success is not None][:COMPARED]
    impact = impacts.of(entry)
    known = [(its, impacts.of(each)) for each, its in alike]
    again, refusal = _again(catalogue, entry, row)
    return TrialCard(
        row=row,
        ending=row.ending,
        what=_what(row),
        sentence=_sentence(row, impact),
        numbers=tuple(_number(*each, row=row, impact=impact, known=known) for each in _NUMBERS),
        compared=len(known),
        impact=None if impact is None else thinned(impact, _POINTS),
        before=earlier[0].id if earlier else None,
        again=again,
        refusal=refusal,
    )


def _number(
    name: str, unit: str, about: str, value: _Value,
    row: LogRow, impact: Impact | None, known: Sequence[tuple[LogRow, Impact | None]],
) -> Number:  # fmt: skip
    before = [each for its, hit in known if (each := value(its, hit)) is not None]
    mean = fmean(before) if before else None
    return Number(
        name, unit, about, value(row, impact), tuple(before), mean, stdev(before) if len(before) > 1 else None
    )


def _what(row: LogRow) -> str:
    place = Displacement.given(row.displacement_mm or 0.0, row.displacement_x_mm or 0.0, row.yaw_deg or 0.0).in_words
    plain = [(text or "").replace("_", " ") for text in (row.controller, row.object)]
    return f"{', '.join(plain)}, {place}, seed {row.seed}"


def _sentence(row: LogRow, impact: Impact | None) -> str:
    parts = [f"{row.outcome[:1].upper()}{row.outcome[1:]}."] if row.ending is not Ending.SUCCESS else []
    if row.ending is Ending.SUCCESS:
        words = {"expected": "the impact was the one that was meant", "not watched": "no monitor judged the impact"}
        judged = words.get(row.verdict or "", "the monitor came to no verdict on the impact")
        parts.append(f"Held until release; {judged}.")
    if impact is not None and impact.detected:
        late = -impact.nominal_ms
        parts.append(f"Detected {abs(late):.0f} ms {'after' if late >= 0 else 'before'} the nominal impact.")
    elif impact is not None:
        parts.append("No impact was detected.")
    return " ".join(parts)


def _again(catalogue: Catalogue, entry: LogEntry, row: LogRow) -> tuple[TrialOrder | None, str | None]:
    """Return the order of a trial, or why it cannot be given again. Its reference is known by its file's name."""
    asked = specification_of(entry)
    name = Path(str(asked.get("reference", ""))).name
    found = next((each for each in catalogue.entries() if each.path.name == name), None)
    if found is None:
        return None, f"its reference {name} is not among the logs"
    try:
        reference_of(catalogue, found.id)
        reaction = Reaction(str(asked.get("reaction", Reaction.CONTINUE)))
        order = TrialOrder(
            reference=found.id,
            object=row.object or "",
            controller=row.controller or "",
            displacement_mm=row.displacement_mm or 0.0,
            displacement_x_mm=row.displacement_x_mm or 0.0,
            yaw_deg=row.yaw_deg or 0.0,
            seed=row.seed or 0,
            reaction=reaction,
        )
    except (NoReference, LogError, ValueError) as error:
        return None, f"its reference {name}: {str(error).splitlines()[0]}"
    return order, None
