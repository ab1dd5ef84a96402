"""What decides the claims about both studies, which their plans fix: one function a kind of claim."""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from math import inf
from typing import TYPE_CHECKING, Any

from rtstack.experiments.claims import ClaimStatus, order, shown, verdict_of
from rtstack.experiments.experiment import Row
from rtstack.experiments.registration import Finding, Judge, judged
from rtstack.experiments.report import Section
from rtstack.experiments.statistics import Interval, proportion

if TYPE_CHECKING:
    from rtstack.papers.aim_aware.outline import Portion

LETTERS = "paper_"  # prefix of a tuning's name: with the paper's own epsilon and e_m
SHARED = ("feasible", "second corner")  # judges of claims that do not depend on epsilon and e_m
SECOND_MS = 5.0  # the mark of Section III-B
# seen in the signals of 64deg-0.22m--1deg and 118deg-0.24m--1deg
GENTLE = "the second corner touches with few newtons while the first one lifts, and the rate of r rises with its force."


@dataclass(frozen=True, slots=True)
class Bands:
    """shares: inclination, degrees, ascending -> share of its cases that were expected; fewest: cases of one."""

    shares: dict[float, float]
    cases: int
    fewest: int = 2

    @property
    def certain(self) -> list[float]:
        """The inclinations that are always expected, wherever they lie."""
        return [deg for deg, share in self.shares.items() if share == 1.0]

    @property
    def always(self) -> tuple[float, float] | None:
        """The band about 0 that is always expected, from and to, degrees; None where 0 is not."""
        edges = [self._outwards(sign) for sign in (-1.0, 1.0)]
        return (edges[0], edges[1]) if self.shares.get(0.0) == 1.0 else None

    @property
    def sometimes(self) -> list[float]:
        return [deg for deg, share in self.shares.items() if 0.0 < share < 1.0]

    @property
    def never(self) -> tuple[float | None, float | None]:
        """From which inclination on, outwards, all are unexpected: below 0 and above it; None where none is."""
        known = list(self.shares)
        below = [deg for deg in known if deg <= 0.0 and all(self.shares[d] == 0.0 for d in known if d <= deg)]
        above = [deg for deg in known if deg >= 0.0 and all(self.shares[d] == 0.0 for d in known if d >= deg)]
        return max(below, default=None), min(above, default=None)

    @property
    def ambiguity_deg(self) -> tuple[float, float]:
        """From the last inclination that is always expected to the first that never is, on either side, degrees."""
        always = self.always or (0.0, 0.0)
        below, above = self.never
        return (inf if below is None else always[0] - below, inf if above is None else above - always[1])

    def words(self) -> str:
        if self.always is None:
            others = ", ".join(f"{deg:+g}" for deg in self.certain)
            return f"not 0 deg ({100.0 * self.shares.get(0.0, 0.0):.0f} %)" + f", but {others} deg" * bool(others)
        low, high = self.always
        return "0 deg" if low == high == 0.0 else f"{low:+g} .. {high:+g} deg"

    def _outwards(self, sign: float) -> float:
        edge = 0.0
        for deg in sorted((deg for deg in self.shares if sign * deg > 0.0), key=abs):
            if self.shares[deg] < 1.0:
                break
            edge = deg
        return edge


def bands(rows: Sequence[Row], monitor: str) -> Bands:
    counts: dict[float, list[int]] = {}
    for row in rows:
        counts.setdefault(row["inclination_deg"], []).append(int(row[f"verdict_{monitor}"] == "expected"))
    shares = {deg: sum(values) / len(values) for deg, values in sorted(counts.items())}
    return Bands(shares, len(rows), min(map(len, counts.values()), default=0))


@dataclass(frozen=True, slots=True)
class Evaluation:
    """Rows as tunings see them. prefix: of the tunings' names; found: by tuning, without prefix."""

    run: "Portion[Any, Any]"
    rows: Sequence[Row]
    prefix: str
    found: Mapping[str, Bands]

    @classmethod
    def of(cls, run: "Portion[Any, Any]", rows: Sequence[Row], prefix: str = "") -> "Evaluation":
        return cls(run, rows, prefix, {name: bands(rows, prefix + name) for name in run.study.tunings})

    def share(self, tuning: str, rows: Sequence[Row], *reasons: str) -> Interval | None:
        """Return the share that is expected; reasons: for which a row that is unexpected counts as expected too."""
        verdict, reason = f"verdict_{self.prefix}{tuning}", f"reason_{self.prefix}{tuning}"
        return proportion(sum(row[verdict] == "expected" or row[reason] in reasons for row in rows), len(rows))

    def counted(self, holds: bool) -> ClaimStatus:
        """Return the verdict of "always" or "never": a counterexample excludes it; of hits with noise, none of some
        does not prove it; one case an inclination tells nothing.
        """
        if not holds:
            return ClaimStatus.DIFFERS
        if min(each.fewest for each in self.found.values()) < 2:
            return ClaimStatus.UNDECIDED
        return ClaimStatus.WITHIN if self.run.study.noisy else ClaimStatus.HOLDS


def at_contact(run: "Portion[Any, Any]", rows: Sequence[Row], number: int, mapped: bool) -> list[Row]:
    """Return the rows of a contact that are, or are not, points of the map."""
    points = {(case.approach_deg, case.location_m, case.inclination_deg) for case in run.study.contacts.grid.cases()}
    here = (row for row in rows if row["contact"] == number)
    return [
        row for row in here
        if ((row["approach_deg"], row["location_m"], row["inclination_deg"]) in points) is mapped
    ]  # fmt: skip


def evaluated(run: "Portion[Any, Any]", rows: Sequence[Row], every: Sequence[Row]) -> list[Section]:
    """Return the claims of a plan with the paper's letters, with our tuning, and once what both share.

    rows: the judged ones; every: with those of the contacts that are run everywhere, judged where the map has none.
    """
    if not rows:
        return []
    of_tunings, shared = ([claim for claim in run.claims if (claim.judge in SHARED) is each] for each in (False, True))
    sections = [("with the paper's letters", LETTERS, of_tunings), ("with our tuning", "", of_tunings)]
    judge = [(name, claims, Evaluation.of(run, rows, prefix)) for name, prefix, claims in sections]
    judge.append(("whatever the tuning", shared, Evaluation.of(run, rows)))
    for number in run.study.contacts.whole if run.contacts else ():
        unseen = at_contact(run, every, number, mapped=False)
        values = ", ".join(f"{name.replace('_', ' ')} {value:g}" for name, value in run.contacts[number - 1].items())
        if unseen:
            judge.append((f"with the paper's letters and {values}", of_tunings, Evaluation.of(run, unseen, LETTERS)))
    return [Section(name, judged(claims, JUDGES, evaluation)) for name, claims, evaluation in judge if claims]


def _about(e: Evaluation, at: str, wanted: tuple[float, float]) -> Finding:
    """Judge whether all these inclinations are always expected, and none beyond them by more than the mark."""
    found, within = e.found[at], e.run.study.marks.within_deg
    low, high = found.always or (inf, -inf)
    near = wanted[0] - within <= low <= wanted[0] and wanted[1] <= high <= wanted[1] + within
    inside = [row for row in e.rows if wanted[0] <= row["inclination_deg"] <= wanted[1]]
    share = shown(e.share(at, inside), " %", 0, 100.0)
    return Finding(f"{found.words()}; of the claimed band {share} are expected", e.counted(near), _why(e, at, inside))


def _why(e: Evaluation, at: str, rows: Sequence[Row]) -> str:
    """Say which conditions, and which approach angles, make impacts unexpected that are claimed to be expected."""
    lost = [row for row in rows if row[f"verdict_{e.prefix}{at}"] != "expected"]
    reasons = Counter(row[f"reason_{e.prefix}{at}"].replace("_", " ") for row in lost)
    angles = Counter(row["approach_deg"] for row in lost) if e.run.study.noisy else {}
    words = [*(f"{name} {count}" for name, count in reasons.items()), *(f"{n} at {a:g} deg" for a, n in angles.items())]
    where = " Other contacts: see the map of the report." if e.prefix else ""
    return f"First condition that is not met, and approach angle: {', '.join(words)}.{where}" if words else ""


def _ambiguity(e: Evaluation, at: Any) -> Finding:
    found = e.found[at]
    below, above = map(_width, found.ambiguity_deg)
    some = ", ".join(f"{deg:+g} ({100.0 * found.shares[deg]:.0f} %)" for deg in found.sometimes) or "none"
    ours = f"{below} below and {above} above; sometimes expected are {some}"
    if found.always is None:
        return Finding(ours, ClaimStatus.UNDECIDED, "0 deg is not always expected: the area has no inner edge.")
    return Finding(ours, e.counted(max(found.ambiguity_deg) <= e.run.study.marks.ambiguity_deg))


def _beyond(e: Evaluation, at: Any) -> Finding:
    column, never, within = e.run.study.tunings[at], e.found[at].never, e.run.study.marks.within_deg
    edges = (column.always_deg[0] - column.ambiguity_deg, column.always_deg[1] + column.ambiguity_deg)
    near = all(a is not None and abs(a - b) <= within for a, b in zip(never, edges, strict=True))
    inside = any(a is not None and abs(a) < abs(b) - within for a, b in zip(never, edges, strict=True))
    return Finding(_from(never), e.counted(near), "What is always expected is narrower already." if inside else "")


def _from(never: tuple[float | None, float | None]) -> str:
    below, above = ("nowhere" if edge is None else f"{edge:+g}" for edge in never)
    return f"from {below} and {above} deg on"


def _width(width_deg: float) -> str:
    return "no end" if width_deg == inf else f"{width_deg:g} deg"


def _growing(e: Evaluation, at: Any) -> Finding:
    shares = {name: e.share(name, e.rows) for name in e.found}
    ours = "; ".join(f"({name}) {shown(share, ' %', 1, 100.0)}" for name, share in shares.items())
    return Finding(f"expected of all: {ours}", order(pairwise(shares.values())))


def _alike(e: Evaluation, at: Any) -> Finding:
    widest = {name: max(each.ambiguity_deg) for name, each in e.found.items()}
    ours = "; ".join(f"({name}) {_width(width)} on the wider side" for name, width in widest.items())
    if any(each.always is None for each in e.found.values()):
        return Finding(ours, ClaimStatus.UNDECIDED, "A tuning that does not always expect 0 deg has no band.")
    return Finding(ours, e.counted(max(widest.values()) - min(widest.values()) <= e.run.study.marks.within_deg))


def _time_window(e: Evaluation, at: Any) -> Finding:
    """(17) refuses what (10) to (12) let pass."""
    pairs = [(e.share(name, e.rows), e.share(name, e.rows, "envelope")) for name in e.found]
    ours = "; ".join(
        f"({name}) {shown(both, ' %', 1, 100.0)} with (17), {shown(static, ' %', 1, 100.0)} without"
        for name, (both, static) in zip(e.found, pairs, strict=True)
    )
    return Finding(f"expected of all: {ours}", order(pairs))


def _off_centre(e: Evaluation, at: Any) -> Finding:
    certain = e.found[at].certain
    if not certain:
        return Finding("nothing is always expected", ClaimStatus.UNDECIDED)
    off = abs(certain[0] + certain[-1]) >= e.run.study.marks.within_deg
    return Finding(f"always expected: {', '.join(f'{deg:+g}' for deg in certain)} deg", e.counted(off))


def _asymmetric(e: Evaluation, at: Any) -> Finding:
    sides = [e.share(at, [row for row in e.rows if sign * row["inclination_deg"] > 0.0]) for sign in (-1.0, 1.0)]
    one, other = sorted(sides, key=lambda side: side.mean if side else 0.0)
    verdict = order([(one, other)])
    below, above = (shown(side, " %", 0, 100.0) for side in sides)
    return Finding(f"expected below 0: {below}; above: {above}; {_from(e.found[at].never)} nothing", verdict)


def _feasible(e: Evaluation, at: Any) -> Finding:
    least = min(row["impulse_ns"] for row in e.rows)
    return Finding(f"the smallest impulse of all planned impacts is {least:.3f} Ns", verdict_of(least >= 0.0))


def _second(e: Evaluation, at: Any) -> Finding:
    rows = [row for row in e.rows if row["inclination_deg"] != 0.0]
    late = [row for row in rows if row["second_ms"] is None or row["second_ms"] > SECOND_MS]
    ours = f"{len(rows) - len(late)} of {len(rows)} within {SECOND_MS:g} ms; others at most "
    ours += f"{max((row['second_ms'] or inf for row in late), default=0.0):g} ms"
    at_deg = ", ".join(f"{deg:+g}" for deg in sorted({row["inclination_deg"] for row in late}))
    return Finding(ours, verdict_of(not late), f"All of the others at {at_deg} deg: {GENTLE}")


JUDGES: dict[str, Judge] = {
    "band": lambda e, at: _about(e, at, e.run.study.tunings[at].always_deg),
    "mirrored band": lambda e, at: _about(e, at, e.run.study.tunings[at].mirrored().always_deg),
    "ambiguity": _ambiguity, "beyond": _beyond,
    "ends": lambda e, at: Finding(_from(e.found[at].never), e.counted(None not in e.found[at].never)),
    "growing": _growing, "alike": _alike, "time window": _time_window, "off centre": _off_centre,
    "asymmetric": _asymmetric, "feasible": _feasible, "second corner": _second,
}  # fmt: skip
