"""`rtstack campaign aim-aware-grab`: the monitor of the grab, judged on faults and good trials that it never saw."""

import hashlib
import os
import sys
from pathlib import Path

import typer

from rtstack.cli.campaign import AIM_AWARE_GRAB, resumable
from rtstack.cli.campaign_cell import open_conditioned_cell, plant_files
from rtstack.cli.cells import load_description
from rtstack.studies.grab.cases import Judged, judged_file, load_judged
from rtstack.trials.errors import TrialError
from rtstack.trials.monitoring import Tuning, tuning_of
from rtstack.trials.scoring import SuccessCriterion

FAILED = 1


def grab_study(out: Path, quick: bool, workers: int | None, scheduler: str | None, resume: bool) -> None:
    """Run the study in the folder `out`, or what is missing of it, and write its report."""
    from rtstack.studies.grab.results import check_folder

    source = judged_file()
    study = load_judged(source)
    tunings = {name: _tuning(name) for name in study.objects}
    sources = [source, load_description(None)[1], *plant_files()]
    sha = hashlib.sha256(repr(([tuning.monitor for tuning in tunings.values()], quick)).encode())
    for path in sources:
        sha.update(path.read_bytes())
    digest = sha.hexdigest()[:16]
    out = out.resolve()
    check_folder(out, digest, resume)
    with resumable(f"rtstack campaign {AIM_AWARE_GRAB} --out {out}{' --quick' * quick} --resume"):
        _run(study, tunings, out, quick, workers or len(os.sched_getaffinity(0)), scheduler, digest, sources)


def _tuning(name: str) -> Tuning:
    tuning = tuning_of(name)
    if tuning is None:
        raise TrialError(f"there is no tuning for {name}: make deploy/monitor/{name}.toml with `rtstack tune-monitor`")
    return tuning


def _run(
    study: Judged, tunings: dict[str, Tuning], out: Path, quick: bool, workers: int, scheduler: str | None, digest: str,
    sources: list[Path],
) -> None:  # fmt: skip
    from rtstack.campaign.crew import distant_crew, local_crew
    from rtstack.campaign.worker import RECORDINGS, Bench, digests
    from rtstack.cli.campaign_progress import campaign_progress
    from rtstack.studies.grab.report import PAGE, About, table, write_report
    from rtstack.studies.grab.results import Results
    from rtstack.studies.grab.runner import run_study
    from rtstack.studies.grab.worker import Bed

    out.mkdir(exist_ok=True)
    (out / RECORDINGS).mkdir(exist_ok=True)
    bench = Bench(out, sources[1], open_conditioned_cell, SuccessCriterion(), digest, digests(sources))
    monitors = {name: tuning.monitor for name, tuning in tunings.items()}
    bed = Bed(bench, study.conditions, study.faults, monitors, open_conditioned_cell)
    with Results(out, digest) as results:
        with distant_crew(scheduler) if scheduler else local_crew(workers) as client, campaign_progress() as progress:
            failures = run_study(study, quick, bed, results, client, progress)
        provenance = {name: tuning.provenance for name, tuning in tunings.items()}
        about = About(study.name, quick, digest, len(study.cases(quick)), provenance)
        summaries = write_report(out, list(results.findings.values()), about)
    for name, summary in summaries.items():
        print(f"{name}\n{table(summary)}\n")
    print(f"report: {out / PAGE}", flush=True)
    for case, reason in failures.items():
        print(f"rtstack: {case} could not be run: {reason}", file=sys.stderr)
    if failures or not summaries[study.objects[0]].reached:  # the mark is the first set's
        raise typer.Exit(FAILED)
