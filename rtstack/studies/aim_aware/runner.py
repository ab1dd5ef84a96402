"""Runs what is missing of the study on the workers, keeps the rows of each planned impact as they come."""

import time

from distributed import Client, Future

from rtstack.campaign.runner import RETRIES, Progress, finished, reason_of
from rtstack.campaign.store import Store
from rtstack.studies.aim_aware.study import Case, StudyRun
from rtstack.studies.aim_aware.worker import run_plan


def run_study(run: StudyRun, store: Store, client: Client, progress: Progress) -> dict[str, str]:
    """Run, keep, report progress in cases. Returns what could not be run, with the reason."""
    grid = run.grid
    inclinations = grid.inclination_deg.values()
    done = {row["id"] for row in store.rows()}
    missing = {
        plan: left
        for plan in grid.plans()
        if (left := tuple(deg for deg in inclinations if Case(*plan, deg).id not in done))
    }
    progress.begin("simulations", len(done), grid.size())
    futures: dict[Future, tuple[tuple[float, float], int]] = {}
    for plan, left in missing.items():
        key = f"plan-{plan[0]:g}-{plan[1]:g}-{run.digest}-{time.time_ns()}"  # no earlier run's result
        future = client.submit(run_plan, run, *plan, left, key=key, retries=RETRIES, pure=False)
        futures[future] = (plan, len(left))
    failures: dict[str, str] = {}
    for future in finished(futures):
        plan, count = futures.pop(future)
        if future.status == "finished":
            store.add(*future.result())
        else:
            failures[f"{plan[0]:g} deg at {plan[1]:g} m"] = reason_of(future)
        for _ in range(count):
            progress.advance(run.study.task.duration_s)
    return failures
