"""The paper's claims about the experiment with the arm, one by one, with what came out here."""

from collections.abc import Sequence

from rtstack.experiments.claims import Claim, ClaimStatus, verdict_of
from rtstack.experiments.experiment import Row
from rtstack.papers.aim_aware.arm.study import ArmColumn, ArmRun
from rtstack.papers.aim_aware.bands import Bands, bands
from rtstack.papers.aim_aware.claims import band_words, edge_words, growing, side_words, width_words


def judge(run: ArmRun, rows: Sequence[Row]) -> list[Claim]:
    """Return every claim with its verdict. The thresholds are the study file's."""
    if not rows:
        return []
    found = {name: bands(rows, name) for name in run.study.tunings}
    why = {name: _at_angles(rows, name, each) for name, each in found.items()}
    claims: list[Claim] = []
    for name, column in run.columns.items():
        claims += _of_tuning(run, f"Figure 8({name})", column, found[name], why[name])
    last = list(found)[-1]
    return [
        *claims,
        growing("IV-B", found),
        _one_sided(run, f"Figure 8({last})", found[last]),
        *(_asymmetric(run, f"Figure 8({name})", each, why[name]) for name, each in found.items()),
    ]


def difference_deg(found: Bands) -> float | None:
    """Return by how much what may be expected reaches further on one side; None where it has no end."""
    below, above = found.never
    return None if below is None or above is None else abs(abs(below) - abs(above))


def _at_angles(rows: Sequence[Row], tuning: str, found: Bands) -> str:
    """Count what was expected by approach angle, at the inclinations that are neither always nor never expected."""
    words = []
    for inclination, share in found.shares.items():
        if not 0.0 < share < 1.0:
            continue
        here = [row for row in rows if row["inclination_deg"] == inclination]
        counts = []
        for angle in sorted({row["approach_deg"] for row in here}):
            said = [row[f"verdict_{tuning}"] == "expected" for row in here if row["approach_deg"] == angle]
            counts.append(f"{sum(said)} of {len(said)} at {angle:g} deg")
        words.append(f"at {inclination:g} deg {', '.join(counts)}")
    return f"Expected, by approach angle: {'; '.join(words)}." if words else ""


def _of_tuning(run: ArmRun, where: str, column: ArmColumn, found: Bands, why: str) -> list[Claim]:
    limits, always = run.study.claims, found.always
    near = always is not None and all(
        abs(edge - wanted) <= limits.within_deg for edge, wanted in zip(always, column.band, strict=True)
    )
    widths = found.ambiguity_deg
    sometimes = side_words(found.sometimes)
    return [
        Claim(
            where,
            f"{band_words(column.band)} always expected (within {limits.within_deg:g} deg)",
            band_words(always),
            verdict_of(near),
            why,
        ),
        Claim(
            where,
            f"between always and never lies an ambiguous area (here: of {limits.ambiguity_deg:g} deg a side at most)",
            f"{width_words(widths[0])} and {width_words(widths[1])}; sometimes expected are {sometimes}"
            + "; nothing is always expected" * (always is None),
            verdict_of(max(widths) <= limits.ambiguity_deg) if always is not None else ClaimStatus.UNDECIDED,
            why,
        ),
        Claim(
            where,
            "beyond, all are unexpected, on either side",
            f"from {edge_words(found.never[0])} and {edge_words(found.never[1])} deg on",
            verdict_of(None not in found.never),
        ),
    ]


def _one_sided(run: ArmRun, where: str, found: Bands) -> Claim:
    """The less sensitive tuning's band lies on one side of 0."""
    says = "a less sensitive tuning's band is not symmetric around 0 deg"
    if found.always is None:
        return Claim(where, says, band_words(None), ClaimStatus.DIFFERS)
    low, high = found.always
    holds = abs(abs(low) - abs(high)) >= run.study.claims.asymmetry_deg
    return Claim(where, says, band_words(found.always), verdict_of(holds))


def _asymmetric(run: ArmRun, where: str, found: Bands, why: str) -> Claim:
    says = "what is neither always nor never expected reaches further on one side than on the other"
    by = difference_deg(found)
    if by is None:
        return Claim(where, says, "it has no end on one side", ClaimStatus.UNDECIDED)
    below, above = found.never
    ours = f"never from {edge_words(below)} and from {edge_words(above)} deg on: {by:g} deg further on one side"
    return Claim(where, says, ours, verdict_of(by >= run.study.claims.asymmetry_deg), why)
