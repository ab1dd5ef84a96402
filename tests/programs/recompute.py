"""Recompute a campaign's numbers from its MCAP files alone, and compare them with what it says.

    python -m tests.programs.recompute DIR [--plan deploy/campaigns/reference-spreading.toml] [--jobs
    2] [--trials N]

Nothing of ours is imported: mcap, mcap_protobuf and numpy. Each number of results.csv that the report uses, then Table
II, Figure 11 and the means behind the claims with their 95 % intervals, as report.json and the page have them, and the
verdicts on orders. Prints the largest difference of each; exit status 0 where all agree to TOLERANCE, else 1. --trials:
only so many logs, and no report.
"""

import argparse
import csv
import html
import json
import math
import re
import sys
import tomllib
from collections import defaultdict
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from itertools import product
from pathlib import Path
from statistics import NormalDist
from typing import Any

import numpy as np

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


def lift_of(rows: list[dict], controller: str) -> Figure | None:
    """Lift of successful grabs against the mean of all controllers at the same reference and displacement."""
    keys = ("reference", "displacement_mm")
    good = [row for row in rows if row["success"]]
    everybody = grouped(good, keys, "max_lift_mm")
    own = grouped([row for row in good if row["controller"] == controller], keys, "max_lift_mm")
    return mean_of({key: [v - float(np.mean(everybody[key])) for v in values] for key, values in own.items()})


def overall(rows: list[dict], controller: str, column: str) -> Figure | None:
    """Mean of a column over all successful trials; the interval from what was repeated, where not all was."""
    good = [row for row in rows if row["controller"] == controller and row["success"]]
    groups = grouped(good, ("experiment", "reference", "displacement_mm"), column)
    repeated = {key: values for key, values in groups.items() if len(values) > 1}
    return mean_of(repeated or groups)


def shown(figure: Figure | None, unit: str = "", digits: int = 1, factor: float = 1.0) -> str:
    """A figure as the page prints it."""
    if figure is None:
        return "-"
    mean, low, high = (
        None if figure[k] is None else f"{factor * figure[k]:.{digits}f}" for k in ("mean", "low", "high")
    )
    return f"{mean}{unit} (n = {figure['n']}, no interval)" if low is None else f"{mean}{unit} [{low}, {high}]"


def order(pairs: list[tuple[Figure | None, Figure | None]]) -> str:
    """Verdict of "the first is below the second", for all pairs."""
    verdict = "holds"
    for low, high in pairs:
        if low is None or high is None:
            return "cannot be told"
        if not low["mean"] < high["mean"]:
            return "differs"
        if low["high"] is None or high["low"] is None or not low["high"] < high["low"]:
            verdict = "holds, within the intervals"
    return verdict


def verdicts(rows: list[dict]) -> dict[str, str]:
    """Verdicts of the claims on orders in Table II and Figure 11, by the claim's text."""
    table2, figure11 = ([row for row in rows if row["experiment"] == name] for name in ("table2", "figure11"))
    displacements = sorted({row["displacement_mm"] for row in figure11})
    controllers = (PROPOSED, *BASELINES)
    force: dict[tuple[float, str], Figure | None] = {}
    for d, controller in product(displacements, controllers):
        here = [row for row in figure11 if (row["displacement_mm"], row["controller"]) == (d, controller)]
        force[d, controller] = mean_of(grouped([r for r in here if r["success"]], ("reference",), "average_force_norm"))
    found = {}
    for d in displacements:
        text = f"at {d:+g} mm" if d else "at 0 mm"
        pairs = [(force[d, PROPOSED], force[d, baseline]) for baseline in BASELINES]
        found[f"{text} the proposed controller has the lowest mean force norm"] = order(pairs)
    for baseline in ("no_reference_spreading", "no_interim"):
        text = f"its 95 % intervals at -30 and 30 mm lie apart from those of “{BASELINES[baseline]}”"
        found[text] = order([(force.get((d, PROPOSED)), force.get((d, baseline))) for d in (-30.0, 30.0)])
    success = {c: share_of([row for row in table2 if row["controller"] == c]) for c in controllers}
    shares = {c: share["mean"] for c, share in success.items() if share is not None}
    alike = len(set(shares.values())) < 2
    last = "no_velocity_feedback"
    fewest = order([(success[last], success[c]) for c in controllers if c != last])
    found["no velocity feedback has the fewest successful grabs"] = "cannot be told" if alike else fewest
    best = "holds" if shares.get(PROPOSED, 0.0) >= max(shares.values(), default=0.0) else "differs"
    text = "the proposed controller's success is not below any baseline's"
    found[text] = "holds, within the intervals" if alike else best
    lifted = [row for row in figure11 if row["object"] == RICE_BOX] or table2
    lift = {c: lift_of(lifted, c) for c in controllers}
    found["no velocity feedback has the lowest lift"] = order([(lift[last], lift[c]) for c in lift if c != last])
    pairs = [(lift[PROPOSED], lift["no_reference_spreading"]), (lift["no_interim"], lift[PROPOSED])]
    found["lift: no reference spreading > proposed > no interim mode"] = order(pairs)
    return found


def compare_figure(differences: Differences, name: str, theirs: Figure | None, ours: Figure | None, where: str) -> None:
    """Compare mean, both ends of the interval and n."""
    if theirs is None or ours is None:
        differences.take(name, theirs, ours, where)
        return
    for key in ("mean", "low", "high", "n"):
        differences.take(f"{name} {key}", theirs[key], ours[key], where)


def compare_report(out: Path, rows: list[dict], differences: Differences) -> None:
    """Compare report.json and the page with what follows from `rows`."""
    report = json.loads((out / "report.json").read_text())
    page = html.unescape((out / "report.html").read_text())

    def printed(name: str, text: str, where: str) -> None:
        differences.take(f"{name} on the page", True, f">{text}<" in page, f"{where}, {text}")

    for part in report["conditions"]:
        mine = [
            row for row in rows if row["conditions"] == part["name"] and row["controller"] in (PROPOSED, *BASELINES)
        ]
        table2, figure11 = ([row for row in mine if row["experiment"] == name] for name in ("table2", "figure11"))
        lifted = [row for row in figure11 if row["object"] == RICE_BOX] or table2
        for line in part["table2"]:
            controller, where = line["controller"], f"{part['name']}, {line['controller']}"
            success, lift = (
                share_of([row for row in table2 if row["controller"] == controller]), lift_of(lifted, controller),
            )  # fmt: skip
            compare_figure(differences, "Table II success", line["success"], success, where)
            compare_figure(differences, "Table II lift", line["lift_mm"], lift, where)
            if success is not None:
                printed("Table II success", shown(success, " %", 0, 100.0), where)
                printed("Table II lift", shown(lift, " mm", 2), where)
        for point in part["figure11"]:
            where = f"{part['name']}, {point['controller']} at {point['displacement_mm']:g} mm"
            here = [row for row in figure11 if row["success"] and row["controller"] == point["controller"]
                    and row["displacement_mm"] == point["displacement_mm"]]  # fmt: skip
            for column in ("average_force_norm", "average_force_norm_linear_n"):
                figure = mean_of(grouped(here, ("reference",), column))
                compare_figure(differences, f"Figure 11 {column}", point[column], figure, where)
                printed("Figure 11", shown(figure), where)
        for entry in part["means"]:
            figure = overall(mine, entry["controller"], entry["column"])
            where = f"{part['name']}, {entry['controller']}"
            compare_figure(differences, f"mean {entry['column']}", entry["mean"], figure, where)
        mine_of = verdicts(mine)
        for claim in part["claims"]:
            cells = re.escape(f"<td>{claim['claim']}</td><td>{claim['figures']}")
            row = re.search(cells + r'.{0,2000}?class="verdict [^"]*">' + re.escape(claim["verdict"]) + "<", page, re.S)
            differences.take("claim and verdict on the page", True, row is not None, claim["claim"])
            if claim["claim"] in mine_of:
                differences.take("verdict", claim["verdict"], mine_of[claim["claim"]], claim["claim"])


def value(text: str) -> object:
    """A cell of results.csv as a value."""
    if text in ("", "True", "False"):
        return {"": None, "True": True, "False": False}[text]
    try:
        return float(text)
    except ValueError:
        return text


def main() -> int:
    """Run the comparison."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("out", type=Path, metavar="DIR")
    parser.add_argument("--plan", type=Path, default=Path("deploy/campaigns/reference-spreading.toml"))
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--trials", type=int, help="look at so many of the logs only, and not at the report")
    arguments = parser.parse_args()
    for path in (arguments.out / "results.csv", arguments.out / "report.json", arguments.plan):
        if not path.is_file():
            why = "give a campaign's folder and the plan that it followed"
            print(f"recompute: there is no {path}: {why}", file=sys.stderr)
            return 2
    with (arguments.out / "results.csv").open(newline="") as file:
        theirs = [{name: value(text) for name, text in row.items()} for row in csv.DictReader(file)][: arguments.trials]
    criterion = tomllib.loads(arguments.plan.read_text())["success"]
    differences, rows = Differences(), []
    logs = [arguments.out / str(row["log"]) for row in theirs]
    with ProcessPoolExecutor(arguments.jobs) as pool:
        for row, numbers in zip(theirs, pool.map(partial(recompute, criterion=criterion), logs), strict=True):
            for name, number in numbers.items():
                plain = number if number is None or isinstance(number, bool) else float(number)
                differences.take(name, row[name], plain, str(row["id"]))
            rows.append(row | numbers)
            if sys.stderr.isatty():
                print(f"\r{len(rows)} of {len(theirs)} logs", end="", file=sys.stderr, flush=True)
    if arguments.trials is None:
        compare_report(arguments.out, rows, differences)
    agree = differences.show()
    print(f"{len(rows)} logs: {'all numbers agree' if agree else 'NOT ALL NUMBERS AGREE'} to {TOLERANCE:g}")
    return 0 if agree else 1


if __name__ == "__main__":
    sys.exit(main())
