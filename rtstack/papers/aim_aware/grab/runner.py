"""Runs the study on a crew: the demonstrations first, then every case that is missing."""

from collections.abc import Iterator

from distributed import Client, Future, as_completed

from rtstack.campaign.runner import RETRIES, Progress
from rtstack.campaign.trial import seed_of
from rtstack.campaign.worker import RECORDINGS, record
from rtstack.studies.grab.cases import Judged
from rtstack.studies.grab.results import Results
from rtstack.studies.grab.worker import Bed, run_case
from rtstack.trials.errors import TrialError


def run_study(
    study: Judged, quick: bool, bed: Bed, results: Results, client: Client, progress: Progress
) -> dict[str, str]:
    """Run what is missing. Returns the cases that could not be run, with the reason.

    Raises TrialError for a demonstration that cannot be recorded.
    """
    _record(study, quick, bed, client, progress)
    cases = study.cases(quick)
    missing = [case for case in cases if case.id not in results.findings]
    progress.begin("trials", len(cases) - len(missing), len(cases))
    digest = bed.bench.digest
    futures = {
        client.submit(run_case, bed, case, key=f"{case.id}-{digest}", retries=RETRIES, pure=False): case
        for case in missing
    }
    failures = {}
    for future in _finished(list(futures)):
        if future.status != "finished":
            failures[futures[future].id] = " ".join(str(future.exception() or future.status).split())
            progress.advance(0.0)
            continue
        finding = future.result()
        results.add(finding)
        progress.advance(finding.ticks * 1e-3)
    return failures


def _record(study: Judged, quick: bool, bed: Bed, client: Client, progress: Progress) -> None:
    folder = bed.bench.out / RECORDINGS
    missing = [reference for reference in study.recorded(quick) if not (folder / reference.file).exists()]
    progress.begin("references", 0, len(missing))
    futures = {}
    for reference in missing:
        seed = seed_of(study.seed, "reference", reference.name)
        key = f"reference-{reference.name}-{bed.bench.digest}"
        future = client.submit(record, bed.bench, reference, bed.conditions, seed, key=key, pure=False)
        futures[future] = reference
    for future in _finished(list(futures)):
        reason = future.result() if future.status == "finished" else str(future.exception())
        if reason is not None:
            (folder / futures[future].file).unlink(missing_ok=True)
            raise TrialError(f"the reference {futures[future].name} could not be recorded: {reason}")
        progress.advance(0.0)


def _finished(futures: list[Future]) -> Iterator[Future]:
    """Yield futures as they end; cancel those that have not where the work is broken off."""
    try:
        yield from as_completed(futures)
    except BaseException:
        for future in futures:
            future.cancel()
        raise
