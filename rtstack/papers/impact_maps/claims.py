"""The paper's claims and the project's own marks, one by one, with what a campaign says about each."""

from collections.abc import Sequence

from rtstack.experiments.claims import Claim, ClaimStatus
from rtstack.impact_map import ReflectedInertia
from rtstack.papers.impact_maps.evaluation import NAMES, PAPER, TABLES, Table, combined
from rtstack.references.motion import Motion

B_THETA, B, NONE = ReflectedInertia.B_THETA, ReflectedInertia.B, ReflectedInertia.NONE
LARGEST_ERROR = 4.0  # %, absolute, with B_theta
LEAST_R_SQUARED = 0.98
SCATTER = {
    Motion.HIT_AND_PUSH: "Where friction on the table differs from trial to trial (the plan's friction_scatter), "
    "(29) holds what that does for as long as it integrates: the heavier the object, the more.",
    Motion.GRAB: "",
}


def percent(value: float | None) -> str:
    """Return an error in words."""
    return "-" if value is None else f"{value:+.2f} %"


def judge_claims(under: Sequence[Table]) -> list[Claim]:
    """Return the claims about the tables under one set of conditions."""
    claims = [claim for table in under for claim in _of_table(table)]
    if {table.motion for table in under if table.errors(B_THETA)} == set(Motion):
        all_three = {kind: combined(under, kind) for kind in ReflectedInertia}
        claims.append(
            Claim(
                "VI-B", "over both scenarios the prediction with B_theta is the best, the one with B the worst "
                "(3.55, 4.25 without, 6.02 % with B)",
                "; ".join(f"{NAMES[kind]} {_plain(value)}" for kind, value in all_three.items()),
                _ordered([all_three[B_THETA], all_three[NONE], all_three[B]]),
            )
        )  # fmt: skip
    return claims


def _of_table(table: Table) -> list[Claim]:
    where = TABLES[table.motion]
    absolute = {kind: table.absolute(kind) for kind in ReflectedInertia}
    paper = PAPER[table.motion]
    margin = paper[B][1] - paper[B_THETA][1]
    best, other = absolute[B_THETA], absolute[B]
    ours = None if best is None or other is None else other - best
    r_squared = table.r_squared
    over = sum(error > 0.0 for error in table.errors(B))
    claims = [
        Claim(
            where, f"absolute error with B_theta at most {LARGEST_ERROR:g} % (paper {paper[B_THETA][1]:.2f} %)",
            _plain(absolute[B_THETA]), _at_most(absolute[B_THETA], LARGEST_ERROR),
        ),
        Claim(
            where, f"smaller than with B by {margin:.2f} points or more (the paper's margin)",
            "-" if ours is None else f"{ours:+.2f} points: {_plain(absolute[B_THETA])} against {_plain(absolute[B])}",
            _at_most(None if ours is None else -ours, -margin), _margin_why(table),
        ),
        Claim(
            where, f"R^2 of the fit at least {LEAST_R_SQUARED} in every line",
            "-" if r_squared is None else f"at least {r_squared:.4f}",
            _at_most(None if r_squared is None else -r_squared, -LEAST_R_SQUARED), SCATTER[table.motion],
        ),
    ]  # fmt: skip
    if table.motion is Motion.HIT_AND_PUSH:
        claims.append(
            Claim(where, "with B the velocity is overestimated in every line", f"in {over} of {len(table.errors(B))}",
                  ClaimStatus.HOLDS if table.errors(B) and over == len(table.errors(B)) else ClaimStatus.DIFFERS)
        )  # fmt: skip
    average = table.average(NONE)
    claims.append(
        Claim(where, f"without motor inertia it is underestimated on average (paper {paper[NONE][0]:+.2f} %)",
              percent(average), _at_most(average, 0.0))
    )  # fmt: skip
    return claims


def _margin_why(table: Table) -> str:
    apart = [
        100.0 * abs(cell.predicted[B] / cell.predicted[B_THETA] - 1.0) for cell in table.cells if cell.fit is not None
    ]
    if not apart:
        return ""
    return (
        f"The two predictions themselves are {sum(apart) / len(apart):.2f} % apart on average, {max(apart):.2f} % at "
        "most: no margin can be larger than that."
    )


def _plain(value: float | None) -> str:
    return "-" if value is None else f"{value:.2f} %"


def _at_most(value: float | None, bound: float) -> ClaimStatus:
    if value is None:
        return ClaimStatus.UNDECIDED
    return ClaimStatus.HOLDS if value <= bound else ClaimStatus.DIFFERS


def _ordered(values: Sequence[float | None]) -> ClaimStatus:
    known = [value for value in values if value is not None]
    if len(known) < len(values):
        return ClaimStatus.UNDECIDED
    return ClaimStatus.HOLDS if known == sorted(known) else ClaimStatus.DIFFERS
