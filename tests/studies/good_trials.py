"""Good trials have no intervention, and every limit in turn made reachable has one in each of them.

Grabs in the direct cell: all controllers, objects and displacements, each with a seed of its own, of a demonstration of
each object. Then every recording is judged anew, alone: within the cell's limits, and with each limit tightened to
inside what the recording contains. Not reached where a good trial has an intervention or a limit is not reached. A grab
that failed for another reason than the judge is no good trial; how many those are is in the table.

Takes an hour.
"""

import json
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from rtstack.cells import default_cell_file
from rtstack.experiments.experiment import Row, Stage, Stages, Task
from rtstack.experiments.report import Table
from rtstack.model.cell_description import CellDescription, load_cell_description
from rtstack.papers.reference_spreading.controllers import Controller
from rtstack.safety.limits import HARDWARE
from rtstack.trials.specification import DemonstrationSpecification, TrialSpecification
from tests.studies.study import Case, Study
from tests.support.runs import attempt, demonstrate
from tests.support.safety.reachable_limits import LIMITS, cases
from tests.support.safety.recorded_trial import empty_places, furthest, judges_of, read_recorded, replay

DISPLACEMENTS_MM = (-30.0, 15.0, 0.0, -15.0, 30.0)


def grab(seed: int, cell: CellDescription) -> tuple[str, Controller, float]:
    """Return object, controller and displacement, mm, in turn, so that any number of seeds has of all."""
    row, k = divmod(seed, len(Controller) * len(DISPLACEMENTS_MM))
    controller = list(Controller)[k % len(Controller)]
    return list(cell.objects)[(row + k) % len(cell.objects)], controller, DISPLACEMENTS_MM[k // len(Controller)]


def taught(path: Path, name: str) -> str | None:
    """Record the demonstration of an object. Returns why there is none, or none that is good."""
    cell, asked = load_cell_description(default_cell_file()), DemonstrationSpecification(name)
    part = path.with_suffix(".part.mcap")
    result = demonstrate(part, cell, asked)
    found = judged(part, cell)
    if result.failure_reason or result.safety_interventions or found["again"] or found["unreached"]:
        return f"{result.failure_reason}, {found['again']}, not reached: {found['unreached']}"
    part.replace(path)
    return None


def judged(log: Path, cell: CellDescription) -> dict[str, Any]:
    """Judge a recording within the cell's limits, then with each limit in reach. again: an intervention within them."""
    trial, stock, judges = read_recorded(log), HARDWARE.tightened(cell.safety), judges_of(cell)
    places = empty_places(trial)
    good = replay(trial, judges(stock), places)
    if good is not None:
        text = f"{good.reason.text}, at tick {good.tick}"
        return {"again": text, "limits": {}, "unreached": list(LIMITS), "furthest": {}, "ticks": good.tick}
    counts: dict[str, Counter[str]] = {}
    unreached = []
    for case in cases(trial, places, stock):
        seen = case.seen(judges)
        counts.setdefault(case.limit, Counter())[seen.reason.name.lower() if seen else "nothing"] += 1
        if not case.reached_by(seen):
            unreached.append(f"{case.limit} {case.detail}")
    unreached += sorted(set(LIMITS).difference(counts))
    return {"again": None, "limits": counts, "unreached": unreached, "furthest": furthest(trial, places),
            "ticks": trial.arms.shape[1]}  # fmt: skip


class GoodTrials(Study):
    """The study. failed: why a grab is no good trial; limits, unreached, furthest: of `judged`, as JSON."""

    COLUMNS: ClassVar = {
        "object": str, "controller": str, "displacement_mm": float, "failed": str | None, "interventions": int,
        "again": str | None, "limits": str, "unreached": str, "furthest": str, "ticks": int,
    }  # fmt: skip

    def stages(self) -> Stages:
        """Record a demonstration of each object, and judge it."""
        cell = load_cell_description(default_cell_file())
        names = dict.fromkeys(grab(case.seed, cell)[0] for case in self.cases([]))
        paths = {name: self.request.out / f"{name}.mcap" for name in names}
        tasks = [Task(name, taught, (path, name)) for name, path in paths.items() if not path.exists()]
        yield Stage("demonstrations", tasks)

    @staticmethod
    def run(out: Path, case: Case) -> Row:
        """Grab, and judge the recording."""
        cell = load_cell_description(default_cell_file())
        name, controller, displacement_mm = grab(case.seed, cell)
        log = out / f"trial-{case.seed}.mcap"
        asked = TrialSpecification(str(out / f"{name}.mcap"), controller, name, displacement_mm, case.seed)
        result = attempt(asked, cell, log)
        found: dict[str, Any] = {"again": None, "limits": {}, "unreached": [], "furthest": {}, "ticks": 0}
        if result.failure_reason is None:
            found = judged(log, cell)
        row = {"object": name, "controller": str(controller), "displacement_mm": displacement_mm}
        texts = {key: json.dumps(found[key]) for key in ("limits", "unreached", "furthest")}
        counts = {"failed": result.failure_reason, "interventions": result.safety_interventions}
        return row | counts | {"again": found["again"], "ticks": found["ticks"]} | texts

    def tables(self, rows: Sequence[Row]) -> tuple[list[Table], list[str]]:
        """Return how often each limit intervened, how far good grabs go, and the grabs that failed."""
        good = [row for row in rows if row["failed"] is None]
        wrong = [f"{row['id']}: an intervention: {row['failed'] or row['again']}" for row in rows
                 if row["interventions"] or row["again"]]  # fmt: skip
        wrong += [f"{row['id']}: not reached: {name}" for row in good for name in json.loads(row["unreached"])]
        lines = []
        for limit in LIMITS:
            found = [seen for row in good if (seen := json.loads(row["limits"]).get(limit))]
            reasons = sum(map(Counter, found), Counter())
            words = ", ".join(f"{name} {n}" for name, n in reasons.most_common())
            lines.append([limit, str(len(found)), str(reasons.total()), words])
        tables = [Table("Limits in reach", ("limit", "trials", "replays", "reasons"), lines)]
        ranges = [json.loads(row["furthest"]) for row in good if not row["again"]]
        lines = []
        for name in ranges[0] if ranges else ():
            lows, highs = np.moveaxis([each[name] for each in ranges], 1, 0)
            ends = (lows.min(axis=0), highs.max(axis=0))
            lines.append([name, *(np.array2string(end, precision=3, suppress_small=True) for end in ends)])
        tables.append(Table("The furthest that good grabs go", ("what", "from", "to"), lines))
        failed = [[row["id"], row["failed"]] for row in rows if row["failed"]]
        ticks = sum(row["ticks"] for row in good)
        counts = [["good trials", str(len(good))], ["ticks", str(ticks)], ["failed grabs", str(len(failed))]]
        return [*tables, Table("Trials", ("what", "n"), counts + failed)], wrong
