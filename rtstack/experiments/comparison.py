"""Two campaigns of one plan beside each other, row by row and claim by claim: arms and simulation, before and after."""

import json
import math
import sqlite3
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rtstack.experiments.experiment import Row
from rtstack.experiments.report import NUMBERS, Table
from rtstack.experiments.statistics import Interval, plain_mean
from rtstack.experiments.store import OF_THE_HOST, PROVENANCE, campaign_database
from rtstack.trials.errors import TrialError


@dataclass(frozen=True, slots=True)
class ColumnDifference:
    """A column that is not the same in all common rows. differing: in how many; one_sided: in how many only one has a
    value.

    means: of both; difference: second minus first with its 95 % interval; largest: absolute; of rows with both
    numbers.
    """

    name: str
    differing: int
    one_sided: int = 0
    means: tuple[float, float] | None = None
    difference: Interval | None = None
    largest: float | None = None


@dataclass(frozen=True, slots=True)
class ClaimPair:
    """A claim with what came out in both: verdict and figures, in words; empty where one of them does not judge it."""

    condition: str
    where: str
    claim: str
    first: str
    second: str


@dataclass(frozen=True, slots=True)
class Comparison:
    """common: ids of rows of both; only: how many one has alone; equal: how many columns do not differ."""

    common: Sequence[str]
    only: tuple[int, int]
    equal: int
    columns: Sequence[ColumnDifference]
    claims: Sequence[ClaimPair]

    @property
    def same(self) -> bool:
        """Whether all rows are common and no column differs."""
        return not self.columns and not any(self.only)

    @property
    def summary(self) -> str:
        """How many rows and columns are the same, in a sentence."""
        alone = f"; {self.only[0]} only in the first, {self.only[1]} only in the second" if any(self.only) else ""
        return (f"{len(self.common)} common rows{alone}; of {self.equal + len(self.columns)} columns {self.equal} are "
                "equal in all of them")  # fmt: skip

    def tables(self, first: str, second: str) -> list[Table]:
        """Return columns and claims as tables. first, second: what the campaigns are called."""
        lines = [(each.name, str(each.differing), str(each.one_sided or ""), *_numbers(each)) for each in self.columns]
        headings = ("column", "rows that differ", "in one alone", f"mean, {first}", f"mean, {second}",
                    "mean difference [95 %]", "largest")  # fmt: skip
        rows = Table(f"Rows of {first} and {second}", headings, lines, note=f"{self.summary}.")
        pairs = [(each.condition, f"{each.where}: {each.claim}", each.first, each.second) for each in self.claims]
        claims = Table(f"Claims in {first} and {second}", ("condition", "claim", first, second), pairs, numbers_from=4)
        return [rows, claims]


def compare(first: Path, second: Path) -> Comparison:
    """Compare two campaigns' folders, without what depends on host and origin. Raises TrialError: no campaign or common
    row.
    """
    ours, theirs = _rows(first), _rows(second)
    common = sorted(ours.keys() & theirs.keys())
    if not common:
        raise TrialError(f"{first} and {second} have no case in common: give two campaigns of one plan")
    left_out = {"id", *OF_THE_HOST, *PROVENANCE}
    names = [name for name in ours[common[0]] if name not in left_out and name in theirs[common[0]]]
    columns = [_column(name, [(ours[each][name], theirs[each][name]) for each in common]) for name in names]
    differing = [each for each in columns if each.differing]
    only = (len(ours) - len(common), len(theirs) - len(common))
    return Comparison(common, only, len(columns) - len(differing), differing, _claims(first, second))


def _rows(folder: Path) -> dict[str, Row]:
    with campaign_database(folder) as connection:
        connection.row_factory = sqlite3.Row
        return {row["id"]: dict(row) for row in connection.execute("SELECT * FROM results")}


def _column(name: str, pairs: Sequence[tuple[Any, Any]]) -> ColumnDifference:
    differing = sum(one != other for one, other in pairs)
    one_sided = sum((one is None) != (other is None) for one, other in pairs)
    numbers = [pair for pair in pairs if all(isinstance(one, int | float) and math.isfinite(one) for one in pair)]
    if not differing or not numbers:
        return ColumnDifference(name, differing, one_sided)
    differences = [other - one for one, other in numbers]
    means = tuple(sum(values) / len(numbers) for values in zip(*numbers, strict=True))
    return ColumnDifference(name, differing, one_sided, (means[0], means[1]), plain_mean(differences),
                            max(map(abs, differences)))  # fmt: skip


def _numbers(each: ColumnDifference) -> tuple[str, str, str, str]:
    if each.means is None or each.difference is None or each.largest is None:
        return ("", "", "", "")
    between = each.difference
    interval = "" if between.low is None else f" [{between.low:.3g}, {between.high:.3g}]"
    return (f"{each.means[0]:.4g}", f"{each.means[1]:.4g}", f"{between.mean:.3g}{interval}", f"{each.largest:.3g}")


def _claims(first: Path, second: Path) -> list[ClaimPair]:
    if not all((folder / NUMBERS).exists() for folder in (first, second)):
        return []
    ours, theirs = (dict(_outcomes(folder / NUMBERS)) for folder in (first, second))
    return [ClaimPair(*key, ours.get(key, ""), theirs.get(key, "")) for key in ours | theirs]


def _outcomes(path: Path) -> Iterator[tuple[tuple[str, str, str], str]]:
    try:
        report = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise TrialError(f"{path} cannot be read: {error}") from None
    for part in report["conditions"]:
        for claim in part["claims"]:
            key = (part["name"], claim["where"], claim["claim"] or claim["mark"])
            yield key, f"{claim['verdict']}: {claim['figures']}"
