"""A campaign whose kind of experiment is a class of a notebook."""

import os
from pathlib import Path
from typing import Any

from rtstack.experiments.experiment import Experiment, Request
from rtstack.experiments.invocation import Invocation, invoke
from rtstack.experiments.plan_file import plan_file_at
from rtstack.experiments.store import check_folder
from rtstack.experiments.workers import local_workers


def run_campaign(
    kind: type[Experiment[Any, Any]], plan: Path | str, out: Path | str, *, workers: int | None = None,
    quick: bool = False, resume: bool = False,
) -> Invocation:  # fmt: skip
    """Run a campaign in the simulator, as `rtstack campaign PLAN --out DIR` does, with no package installed.

    Args:
        kind: The kind of experiment. The plan's `kind` is not looked at.
        plan: The plan's file (TOML).
        out: The campaign's folder, new or empty.
        workers: Processes, by default one a CPU.
        quick: Run the plan's sample.
        resume: Go on with what is missing in the folder.

    Returns:
        The report, the path of its page, and what could not be run; the folder has the rows, as results.csv.

    Raises:
        TrialError, ConfigurationError: In one line, before the folder is made.
    """
    request = Request(plan_file_at(Path(plan).resolve()), Path(out).resolve())
    experiment = kind(kind.read(request.file.path, quick), request)
    check_folder(experiment, resume)
    with local_workers(workers or len(os.sched_getaffinity(0))) as client:
        return invoke(experiment, client)
