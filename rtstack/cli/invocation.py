"""An invocation of a campaign or study: who works, what is kept of how fast it went, and its last lines."""

import sys
from collections.abc import Mapping
from contextlib import AbstractContextManager
from pathlib import Path
from typing import TYPE_CHECKING, Protocol

import typer

from rtstack.campaign.store import Store

if TYPE_CHECKING:  # Dask is loaded once there is work
    from distributed import Client

    from rtstack.campaign.runner import Tally

FAILED = 1


class Counted(Protocol):
    """A runner, which counts what it does."""

    @property
    def tally(self) -> "Tally": ...
    def run(self) -> None: ...


def crew(workers: int, scheduler: str | None) -> "AbstractContextManager[Client]":
    """Give the workers at a scheduler's address, without one so many processes on this machine."""
    from rtstack.campaign.crew import distant_crew, local_crew

    return distant_crew(scheduler) if scheduler else local_crew(workers)


def run_counted(runner: Counted, store: Store, at_once: int) -> "Tally":
    """Run what is missing, and keep in the store how fast it went, also where it is broken off."""
    tally = runner.tally
    try:
        runner.run()
    finally:
        store.note_invocation(tally.trials, tally.robot_s, tally.wall_s, at_once)
    return tally


def end(page: Path, failures: Mapping[str, str], spoilt: bool = False) -> None:
    """Say where the report is and what could not be run, with the reason. Exits with 1 for that, or where `spoilt`."""
    print(f"report: {page}", flush=True)
    for what, reason in failures.items():
        print(f"rtstack: {what} could not be run: {reason}", file=sys.stderr)
    if failures:
        print("rtstack: run the same with --resume to try them again", file=sys.stderr)
    if failures or spoilt:
        raise typer.Exit(FAILED)
