"""The paper's claims about the planar study, one by one, with what came out here."""

from collections.abc import Mapping, Sequence
from itertools import pairwise
from math import inf

from rtstack.experiments.claims import Claim, verdict_of
from rtstack.experiments.experiment import Row
from rtstack.papers.aim_aware.bands import Bands, bands
from rtstack.papers.aim_aware.study import PlanarColumn, StudyRun

WITHIN_DEG = 1.0  # of the paper's edges: the grid's resolution
PAPER_AMBIGUITY_DEG = 2.0  # "about 2 deg", a side
MOST_AMBIGUITY_DEG = 3.0


def judge(run: StudyRun, rows: Sequence[Row]) -> list[Claim]:
    """Return every claim with its verdict; rows: of cases that the tuning has not seen."""
    if not rows:
        return []
    found = {name: bands(rows, name) for name in run.study.tunings}
    claims: list[Claim] = []
    for name, column in run.study.tunings.items():
        claims += _of_tuning(name, column, found[name])
    return [*claims, growing("IV-A", found), _consistent(found), _feasible(rows)]


def band_words(edges: tuple[float, float] | None) -> str:
    """Return a band in words."""
    if edges is None:
        return "none: not even 0 deg"
    return "0 deg" if edges == (0.0, 0.0) else f"{edges[0]:+g} .. {edges[1]:+g} deg"


def side_words(sides: tuple[list[float], list[float]]) -> str:
    """Return the ambiguous inclinations of both sides in words."""
    below, above = (", ".join(f"{deg:+g}" for deg in side) or "none" for side in sides)
    return f"below: {below}; above: {above}"


def _of_tuning(name: str, column: PlanarColumn, found: Bands) -> list[Claim]:
    where, wanted = f"Figure 7({name})", column.always_deg
    always, never = found.always, found.never
    meant = "0 deg is" if wanted == 0.0 else f"-{wanted:g} .. +{wanted:g} deg are"
    beyond = wanted + PAPER_AMBIGUITY_DEG
    near = always is not None and all(abs(abs(edge) - wanted) <= WITHIN_DEG for edge in always)
    far = all(edge is not None and abs(abs(edge) - beyond) <= WITHIN_DEG for edge in never)
    widths = found.ambiguity_deg
    sometimes = side_words(found.sometimes)
    return [
        Claim(where, f"{meant} always expected (within 1 deg)", band_words(always), verdict_of(near)),
        Claim(
            where,
            "an area of about 2 deg on each side is neither always expected nor always unexpected (3 at most)",
            f"{width_words(widths[0])} and {width_words(widths[1])}; sometimes expected are {sometimes}",
            verdict_of(all(width <= MOST_AMBIGUITY_DEG for width in widths)),
        ),
        Claim(
            where,
            f"beyond, from {beyond:g} deg on, 100 % are unexpected (within 1 deg)",
            f"from {edge_words(never[0])} and {edge_words(never[1])} deg on",
            verdict_of(far),
        ),
    ]


def width_words(width_deg: float) -> str:
    """Return an ambiguous width in words."""
    return "no end" if width_deg == inf else f"{width_deg:g} deg"


def edge_words(edge: float | None) -> str:
    """Return the edge of what is never expected in words."""
    return "nowhere" if edge is None else f"{edge:+g}"


def growing(where: str, found: Mapping[str, Bands]) -> Claim:
    """Return the claim that the tunings, from the first to the last one, expect more and more."""
    widths = [each.always[1] - each.always[0] if each.always else -1.0 for each in found.values()]
    grows = all(before < after for before, after in pairwise(widths))
    ours = "; ".join(f"({name}) {band_words(each.always)}" for name, each in found.items())
    names = list(found)
    says = f"the sensitivity can be tuned: the band grows from ({names[0]}) to ({names[-1]})"
    return Claim(where, says, ours, verdict_of(grows))


def _consistent(found: dict[str, Bands]) -> Claim:
    widest = {name: max(each.ambiguity_deg) for name, each in found.items()}
    ours = "; ".join(f"({name}) {width_words(width)} on the worse side" for name, width in widest.items())
    alike = max(widest.values()) - min(widest.values()) <= WITHIN_DEG
    return Claim("IV-A", "the ambiguous area is of much the same width with every sensitivity", ours, verdict_of(alike))


def _feasible(rows: Sequence[Row]) -> Claim:
    least = min(row["impulse_ns"] for row in rows)
    return Claim(
        "II-B",
        "the map (4) applies: both corners hit together, and neither impulse is negative",
        f"the smallest impulse of all planned impacts is {least:.3f} Ns",
        verdict_of(least >= 0.0),
    )
