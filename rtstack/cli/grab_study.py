"""`rtstack campaign aim-aware-grab`: the monitor of the grab, judged on faults and good trials that it never saw."""

import hashlib
import os
from pathlib import Path

from rtstack.campaign.plan import GRAB_STUDY
from rtstack.cli.campaign import resumable
from rtstack.cli.campaign_cell import open_conditioned_cell, plant_files
from rtstack.cli.cells import load_description
from rtstack.cli.invocation import crew, end
from rtstack.studies.grab.cases import Judged, judged_file, load_judged
from rtstack.trials.errors import TrialError
from rtstack.trials.monitoring import Tuning, tuning_of
from rtstack.trials.scoring import SuccessCriterion


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
    with resumable(f"rtstack campaign {GRAB_STUDY} --out {out}{' --quick' * quick} --resume"):
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
    from rtstack.campaign.worker import RECORDINGS, Bench, digests
    from rtstack.cli.campaign_progress import campaign_progress
    from rtstack.studies.grab.report import PAGE, About, table, write_report
    from rtstack.studies.grab.results import Results
    from rtstack.studies.grab.runner import run_study
    from rtstack.studies.grab.worker import Bed

    bench = Bench(out, sources[1], open_conditioned_cell, SuccessCriterion(), digest, digests(sources))
    monitors = {name: tuning.monitor for name, tuning in tunings.items()}
    bed = Bed(bench, study.conditions, study.faults, monitors, open_conditioned_cell)
    with crew(workers, scheduler) as client:
        for folder in (out, out / RECORDINGS):
            folder.mkdir(exist_ok=True)
        with Results(out, digest) as results:
            with campaign_progress() as progress:
                failures = run_study(study, quick, bed, results, client, progress)
            provenance = {name: tuning.provenance for name, tuning in tunings.items()}
            about = About(study.name, quick, digest, len(study.cases(quick)), provenance)
            summaries = write_report(out, list(results.findings.values()), about)
    for name, summary in summaries.items():
        print(f"{name}\n{table(summary)}\n")
    end(out / PAGE, failures, spoilt=not summaries[study.objects[0]].reached)  # the mark is the first set's
