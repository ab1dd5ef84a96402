"""`rtstack campaign aim-aware-grab`: the monitor of the grab, judged on faults and good trials that it never saw."""

import hashlib
import json
import os
import sys
from pathlib import Path
from typing import Any

import typer

from rtstack.cli.campaign import AIM_AWARE_GRAB, resumable
from rtstack.cli.campaign_cell import open_conditioned_cell, plant_files
from rtstack.cli.cells import load_description
from rtstack.studies.grab.cases import Judged, judged_file, load_judged
from rtstack.trials.monitoring import Tuning, load_tuning
from rtstack.trials.scoring import SuccessCriterion

FAILED = 1


def grab_study(out: Path, quick: bool, workers: int | None, scheduler: str | None, resume: bool) -> None:
    """Run the study in the folder `out`, or what is missing of it, and write its report."""
    from rtstack.studies.grab.results import check_folder

    source = judged_file()
    study, tuning = load_judged(source), load_tuning()
    sources = [source, load_description(None)[1], *plant_files()]
    sha = hashlib.sha256(repr((tuning.monitor, quick)).encode())
    for path in sources:
        sha.update(path.read_bytes())
    digest = sha.hexdigest()[:16]
    out = out.resolve()
    check_folder(out, digest, resume)
    with resumable(f"rtstack campaign {AIM_AWARE_GRAB} --out {out}{' --quick' * quick} --resume"):
        _run(study, tuning, out, quick, workers or len(os.sched_getaffinity(0)), scheduler, digest, sources)


def _run(
    study: Judged, tuning: Tuning, out: Path, quick: bool, workers: int, scheduler: str | None, digest: str,
    sources: list[Path],
) -> None:  # fmt: skip
    from rtstack.campaign.crew import distant_crew, local_crew
    from rtstack.campaign.worker import RECORDINGS, Bench, digests
    from rtstack.cli.campaign_progress import campaign_progress
    from rtstack.studies.grab.report import page, summarise, table
    from rtstack.studies.grab.results import Results
    from rtstack.studies.grab.runner import run_study
    from rtstack.studies.grab.worker import Bed

    out.mkdir(exist_ok=True)
    (out / RECORDINGS).mkdir(exist_ok=True)
    bench = Bench(out, sources[1], open_conditioned_cell, SuccessCriterion(), digest, digests(sources))
    bed = Bed(bench, study.conditions, study.faults, tuning.monitor, open_conditioned_cell)
    with Results(out, digest) as results:
        with distant_crew(scheduler) if scheduler else local_crew(workers) as client, campaign_progress() as progress:
            failures = run_study(study, quick, bed, results, client, progress)
        summary = summarise(list(results.findings.values()))
    notes = f"{study.name}{', quick' * quick}, digest {digest}, {len(results.findings)} trials"
    provenance: dict[str, Any] = dict(tuning.provenance)
    (out / "report.html").write_text(page(summary, provenance, notes), encoding="utf-8")
    (out / "summary.json").write_text(json.dumps(summary.as_dict(), indent=1), encoding="utf-8")
    print(table(summary))
    print(f"report: {out / 'report.html'}", flush=True)
    for case, reason in failures.items():
        print(f"rtstack: {case} could not be run: {reason}", file=sys.stderr)
    if failures or not summary.reached:
        raise typer.Exit(FAILED)
