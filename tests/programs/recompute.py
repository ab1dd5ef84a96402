"""Recompute a campaign's numbers from its MCAP files alone, and compare them with what it says.
Nothing of ours is imported: mcap, mcap_protobuf and numpy. Each number of results.csv that the report uses, then Table
II, Figure 11 and the means behind the claims with their 95 % intervals, as report.json and the page have them, and the
verdicts on orders. Prints the largest difference of each; exit status 0 where all agree to TOLERANCE, else 1. --trials:
only so many logs, and no report.

Takes minutes.
"""

import csv
import html
import json
import math
import re
import sys
import tomllib
from collections import defaultdict
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from pathlib import Path
from statistics import NormalDist
from typing import Annotated, Any

import numpy as np
import typer

from tests.programs import program
from tests.support.recomputed_trial import recompute

TOLERANCE = 1e-6  # relative, of numbers that are sums in another order
RICE_BOX = "rice_box"
PROPOSED = "proposed"
BASELINES = {
    "no_reference_spreading": "no reference spreading",
    "no_velocity_feedback": "no velocity feedback",
    "no_interim": "no interim mode",
}
Figure = dict[str, Any]  # mean, low, high, n
Value = Callable[[dict], Any]


class Differences:
    """The largest difference of each number, and where it was."""

    def __init__(self) -> None:
        self.worst: dict[str, tuple[float, str]] = {}

    def take(self, name: str, theirs: object, ours: object, where: str) -> None:
        """Compare a number of the campaign with ours; None and truth values have to be the same."""
        if isinstance(theirs, float) and isinstance(ours, float):
            difference = abs(theirs - ours) / max(1.0, abs(theirs))
        else:
            difference = 0.0 if theirs == ours else math.inf
        if difference >= self.worst.get(name, (-1.0, ""))[0]:
            self.worst[name] = difference, f"{where}: {theirs} and {ours}" if difference > TOLERANCE else where

    def show(self) -> bool:
        """Print the table; return whether all agree."""
        for name, (difference, where) in self.worst.items():
            print(f"{name:44} {difference:9.2e}  {where}")
        return all(difference <= TOLERANCE for difference, _ in self.worst.values())


def student(p: float, freedom: float) -> float:
    """Quantile of Student's t: its density integrated with x = sqrt(freedom) tan(a), then a bisection."""
    constant = math.exp(math.lgamma((freedom + 1) / 2) - math.lgamma(freedom / 2)) / math.sqrt(math.pi)
    nodes, weights = np.polynomial.legendre.leggauss(200)
    low, high = 0.0, math.pi / 2
    for _ in range(200):
        a = (low + high) / 2
        share = 0.5 + constant * a / 2 * float(weights @ np.cos(a / 2 * (nodes + 1)) ** (freedom - 1))
        low, high = (a, high) if share < p else (low, a)
    return math.sqrt(freedom) * math.tan((low + high) / 2)


def mean_of(groups: dict[object, list[float]]) -> Figure | None:
    """Mean of the groups' means and its interval: variance sum(s^2 / n) / g^2, Welch and Satterthwaite's freedom."""
    if not groups:
        return None
    g = len(groups)
    mean, n = float(np.mean([np.mean(v) for v in groups.values()])), sum(map(len, groups.values()))
    if min(map(len, groups.values())) < 2:
        return {"mean": mean, "low": None, "high": None, "n": n}
    parts = [float(np.var(v, ddof=1)) / len(v) / g**2 for v in groups.values()]
    half = 0.0
    if sum(parts) > 0.0:
        freedom = sum(parts) ** 2 / sum(p**2 / (len(v) - 1) for p, v in zip(parts, groups.values(), strict=True))
        half = student(0.975, freedom) * math.sqrt(sum(parts))
    return {"mean": mean, "low": mean - half, "high": mean + half, "n": n}


def share_of(rows: list[dict]) -> Figure | None:
    """Share of successes with Wilson's interval."""
    n = len(rows)
    if not n:
        return None
    z, p = NormalDist().inv_cdf(0.975), sum(row["success"] for row in rows) / n
    middle, half = p + z * z / (2 * n), z * math.sqrt(p * (1 - p) / n + z * z / (4 * n * n))
    low, high = ((middle + sign * half) / (1 + z * z / n) for sign in (-1, 1))
    return {"mean": p, "low": max(0.0, low), "high": min(1.0, high), "n": n}


def grouped(rows: list[dict], keys: tuple[str, ...], column: str) -> dict[object, list[float]]:
    """Values of a column by the values of the keys, where there are any."""
    groups = defaultdict(list)
    for row in rows:
        if row[column] is not None:
            groups[tuple(row[key] for key in keys)].append(float(row[column]))
    return groups


def over_references(rows: list[dict], value: Value) -> Figure | None:
    """Mean of the references' means, and Student's interval over the references."""
    groups: dict[str, list[float]] = defaultdict(list)
    for row in rows:
        if (number := value(row)) is not None:
            groups[row["reference"]].append(float(number))
    return mean_of({0: [float(np.mean(values)) for values in groups.values()]}) if groups else None


def went_on(row: dict) -> bool:
    """Whether a trial lasted until 0.3 s after its nominal impact."""
    return 1e-3 * row["ticks"] >= row["nominal_impact_time_s"] + 0.3


def difference(rows: list[dict], first: str, second: str, value: Value) -> Figure | None:
    """Mean of the first controller's values less the second's, pair by pair, over references."""
    keys = ("reference", "experiment", "displacement_mm", "repetition")
    found = [
        {tuple(row[key] for key in keys): float(number) for row in rows
         if row["controller"] == name and (number := value(row)) is not None}
        for name in (first, second)
    ]  # fmt: skip
    pairs = [{"reference": key[0], "less": found[0][key] - found[1][key]} for key in found[0] if key in found[1]]
    return over_references(pairs, lambda pair: pair["less"])


def lift_of(rows: list[dict], controller: str) -> Figure | None:
    """Lift of successful grabs against the mean of all controllers at the same reference and displacement."""
    good = [row for row in rows if row["success"]]
    everybody = grouped(good, ("reference", "displacement_mm"), "max_lift_mm")
    own = [row for row in good if row["controller"] == controller]
    mean = {key: float(np.mean(values)) for key, values in everybody.items()}
    return over_references(own, lambda row: row["max_lift_mm"] - mean[row["reference"], row["displacement_mm"]])


def shown(figure: Figure | None, unit: str = "", digits: int = 1, factor: float = 1.0) -> str:
    """A figure as the page prints it."""
    if figure is None:
        return "-"
    mean, low, high = (
        None if figure[k] is None else f"{factor * figure[k]:.{digits}f}" for k in ("mean", "low", "high")
    )
    return f"{mean}{unit} (n = {figure['n']}, no interval)" if low is None else f"{mean}{unit} [{low}, {high}]"


def below_zero(figure: Figure | None) -> str:
    """Verdict of "the mean is below 0"."""
    if figure is None or figure["low"] is None or figure["low"] == figure["high"] == 0.0:
        return "cannot be told"
    if figure["high"] <= 0.0:
        return "holds"
    if figure["low"] > 0.0:
        return "differs"
    return "holds, within the intervals" if figure["mean"] <= 0.0 else "cannot be told"


def worst(found: list[str]) -> str:
    """Verdict of a claim of several parts."""
    return next(each for each in ("differs", "cannot be told", "holds, within the intervals", "holds") if each in found)


def verdicts(rows: list[dict], claims: list[dict]) -> dict[tuple[str, str], str]:
    """Verdicts of the claims on orders, by (where, claim). claims: those of the plan."""
    table2, figure11 = ([row for row in rows if row["experiment"] == name] for name in ("table2", "figure11"))
    last, every, lasting = "no_velocity_feedback", (PROPOSED, *BASELINES), [row for row in rows if went_on(row)]
    above = {last: every, "no_interim": (PROPOSED, "no_reference_spreading"), PROPOSED: ("no_reference_spreading",)}
    good, to_last = [row for row in table2 if row["success"]], [(c, last) for c in every if c != last]
    peaked = [(PROPOSED, c) for c in ("no_reference_spreading", "no_interim")]
    all_three = [(PROPOSED, c) for c in BASELINES]
    orders = {  # judge -> the rows, the pairs, the column
        "fewest_grabs": (table2, [(b, a) for a, b in to_last], "success"),
        "most_grabs": (table2, [(c, PROPOSED) for c in BASELINES], "success"),
        "peaks_reduced": (lasting, all_three, "peak_in_window"),
        "steps_reduced": (lasting, all_three, "largest_step"),
        "swing": (lasting, to_last, "swing_m_s"),
        "swing_other": (lasting, to_last, "swing_other_m_s"),
        "contact_lost": (lasting, to_last, "lost_ms"),
        "other_robot": (lasting, peaked, "largest_step_other"),
        "posture": (lasting, peaked, "posture_peak"),
    }
    found = {}
    for claim in claims:
        at = claim.get("at")
        if claim["judge"] in ("lowest_force_norm", "high_at_zero"):
            some = [row for row in figure11 or table2 if row["displacement_mm"] == at and went_on(row)]
            pairs = peaked if claim["judge"] == "high_at_zero" else all_three
            some, pairs, column = some, pairs, "average_force_norm"
        elif claim["judge"] == "lift_order":
            some, pairs, column = good, [(at, c) for c in above[at] if c != at], "max_lift_mm"
        elif claim["judge"] in orders:
            some, pairs, column = orders[claim["judge"]]
        else:
            continue
        parts = [below_zero(difference(some, a, b, lambda row, name=column: row[name])) for a, b in pairs]
        found[claim["where"], claim.get("says", "")] = worst(parts)
    return found


def compare_figure(differences: Differences, name: str, theirs: Figure | None, ours: Figure | None, where: str) -> None:
    """Compare mean, both ends of the interval and n."""
    if theirs is None or ours is None:
        differences.take(name, theirs, ours, where)
        return
    for key in ("mean", "low", "high", "n"):
        differences.take(f"{name} {key}", theirs[key], ours[key], where)


def compare_report(out: Path, rows: list[dict], claims: list[dict], differences: Differences) -> None:
    """Compare report.json and the page with what follows from `rows`. claims: those of the plan."""
    report = json.loads((out / "report.json").read_text())
    page = html.unescape((out / "report.html").read_text())

    def printed(name: str, text: str, where: str) -> None:
        differences.take(f"{name} on the page", True, f">{text}<" in page, f"{where}, {text}")

    for part in report["conditions"]:
        mine = [
            row for row in rows if row["conditions"] == part["name"] and row["controller"] in (PROPOSED, *BASELINES)
        ]
        table2, figure11 = ([row for row in mine if row["experiment"] == name] for name in ("table2", "figure11"))
        repeated = [row for row in figure11 if row["object"] == RICE_BOX]
        for line in part["table2"]:
            controller, where = line["controller"], f"{part['name']}, {line['controller']}"
            success, lift = (
                share_of([row for row in table2 if row["controller"] == controller]), lift_of(table2, controller),
            )  # fmt: skip
            compare_figure(differences, "Table II success", line["success"], success, where)
            compare_figure(differences, "Table II lift", line["lift_mm"], lift, where)
            again = lift_of(repeated, controller)
            compare_figure(differences, "Table II lift, repeated", line["repeated_lift_mm"], again, where)
            if success is not None:
                printed("Table II success", shown(success, " %", 0, 100.0), where)
                printed("Table II lift", shown(lift, " mm", 2), where)
        for point in part["figure11"]:
            where = f"{part['name']}, {point['controller']} at {point['displacement_mm']:g} mm"
            here = [row for row in figure11 if went_on(row) and row["controller"] == point["controller"]
                    and row["displacement_mm"] == point["displacement_mm"]]  # fmt: skip
            for column in ("average_force_norm", "average_force_norm_linear_n"):
                figure = mean_of(grouped(here, ("reference",), column))
                compare_figure(differences, f"Figure 11 {column}", point[column], figure, where)
                printed("Figure 11", shown(figure), where)
        for entry in part["means"]:
            own = [row for row in mine if row["controller"] == entry["controller"] and went_on(row)]
            figure = over_references(own, lambda row, column=entry["column"]: row[column])
            where = f"{part['name']}, {entry['controller']}"
            compare_figure(differences, f"mean {entry['column']}", entry["mean"], figure, where)
        mine_of = verdicts(mine, claims)
        for claim in part["claims"]:
            three = (claim["claim"] or "-", claim["mark"] or "-", claim["figures"])
            cells = re.escape("<td>" + "</td><td>".join(three))
            row = re.search(cells + r'.{0,2000}?class="verdict [^"]*">' + re.escape(claim["verdict"]) + "<", page, re.S)
            differences.take("claim and verdict on the page", True, row is not None, claim["claim"])
            key = claim["where"], claim["claim"]
            if key in mine_of:
                differences.take("verdict", claim["verdict"], mine_of[key], claim["claim"])


def value(text: str) -> object:
    """A cell of results.csv as a value."""
    if text in ("", "True", "False"):
        return {"": None, "True": True, "False": False}[text]
    try:
        return float(text)
    except ValueError:
        return text


def main(
    out: Path,
    plan: Path = Path("deploy/campaigns/reference-spreading.toml"),
    jobs: int = 2,
    trials: Annotated[int | None, typer.Option(help="look at so many of the logs only, and not at the report")] = None,
) -> int:
    """Run the comparison."""
    for path in (out / "results.csv", out / "report.json", plan):
        if not path.is_file():
            why = "give a campaign's folder and the plan that it followed"
            print(f"recompute: there is no {path}: {why}", file=sys.stderr)
            return 2
    with (out / "results.csv").open(newline="") as file:
        theirs = [{name: value(text) for name, text in row.items()} for row in csv.DictReader(file)][:trials]
    followed = tomllib.loads(plan.read_text())
    criterion = followed["success"]
    differences, rows = Differences(), []
    logs = [out / str(row["log"]) for row in theirs]
    with ProcessPoolExecutor(jobs) as pool:
        for row, numbers in zip(theirs, pool.map(partial(recompute, criterion=criterion), logs), strict=True):
            for name, number in numbers.items():
                plain = number if number is None or isinstance(number, bool) else float(number)
                differences.take(name, row[name], plain, str(row["id"]))
            rows.append(row | numbers)
            if sys.stderr.isatty():
                print(f"\r{len(rows)} of {len(theirs)} logs", end="", file=sys.stderr, flush=True)
    if trials is None:
        compare_report(out, rows, followed.get("claims", []), differences)
    agree = differences.show()
    print(f"{len(rows)} logs: {'all numbers agree' if agree else 'NOT ALL NUMBERS AGREE'} to {TOLERANCE:g}")
    return 0 if agree else 1


if __name__ == "__main__":
    program(main)
