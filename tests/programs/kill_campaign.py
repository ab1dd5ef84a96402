"""Campaigns that are killed, resumed and run by others give what an undisturbed one gives, at any size.

    python -m tests.programs.kill_campaign WORK [--trials N | --quick] [--plan reference-spreading] [--cases NAME
    ...]

Runs the campaign once with one worker, undisturbed, then each case, and compares results.csv (but for the commit) and
report.json, in which Table II and Figure 11 are. Prints a line a case; exit status 0 where all are alike and no process
is left, else 1. A case that is done is not run again: the same command goes on where it was ended.
"""

import argparse
import contextlib
import csv
import os
import shutil
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import psutil

from rtstack.experiments.registry import plan_file
from rtstack.papers.reference_spreading.plan import load_plan

BIN = Path(sys.executable).parent
HOST = "127.73.6.1"
END_S = 120.0  # for processes to end
DONE = ".compared"


class Broken(Exception):
    """A case that did not go as it has to. The message says where."""


class Campaign:
    """A campaign's command line in a folder of its own."""

    def __init__(self, plan: str, quick: bool, out: Path, total: int) -> None:
        self.plan, self.quick, self.out, self.total = plan, quick, out, total

    def start(self, *more: str) -> subprocess.Popen[bytes]:
        """Start it as a terminal does: in a process group of its own. Resumes where there is something."""
        resume = ["--resume"] * (self.out / "campaign.sqlite").exists()
        words = [str(BIN / "rtstack"), "campaign", self.plan, "--out", str(self.out), *["--quick"] * self.quick, *more]
        with self.out.with_suffix(".txt").open("ab") as said:
            return subprocess.Popen(words + resume, stdout=said, stderr=said, start_new_session=True)

    def finish(self, *more: str) -> None:
        """Run what is missing. Raises Broken where it fails."""
        if self.start(*more).wait():
            raise Broken(f"it failed: see {self.out.with_suffix('.txt')}")

    def logs(self) -> dict[str, int]:
        """Finished logs, with the time of each."""
        return {path.name: path.stat().st_mtime_ns for path in (self.out / "logs").glob("*.mcap")}

    def run_to(self, share: float, *more: str) -> subprocess.Popen[bytes]:
        """Start it and wait until this share of its trials has been run."""
        process = self.start(*more)
        while len(self.logs()) < max(1, share * self.total):
            if process.poll() is not None:
                raise Broken(f"it ended too early: see {self.out.with_suffix('.txt')}")
            time.sleep(0.05)
        return process


def kill(process: subprocess.Popen[bytes], group: bool) -> None:
    """End a campaign with -9, itself or its whole process group. Raises Broken where one of its processes stays."""
    family = psutil.Process(process.pid).children(recursive=True)
    if group:
        os.killpg(process.pid, signal.SIGKILL)
    else:
        process.kill()
    process.wait()
    _, left = psutil.wait_procs(family, timeout=END_S)
    if left:
        raise Broken(f"{len(left)} processes are left: {[p.pid for p in left]}")


def resumed(campaign: Campaign, *more: str) -> None:
    """Run the rest of a killed campaign. Raises Broken where a trial that was finished has been run again."""
    kept = campaign.logs()
    campaign.finish(*more)
    now = campaign.logs()
    again = [name for name, at in kept.items() if now.get(name) != at]
    if again:
        raise Broken(f"{len(again)} finished trials were run again, {again[0]} first")


def group_killed(campaign: Campaign) -> None:
    """The whole process group, at a third, with two workers; resumed with one."""
    kill(campaign.run_to(1 / 3, "--workers", "2"), group=True)
    resumed(campaign, "--workers", "1")


def runner_killed(campaign: Campaign) -> None:
    """The runner alone, at a third, with one worker: its workers end too; resumed with two."""
    kill(campaign.run_to(1 / 3, "--workers", "1"), group=False)
    resumed(campaign, "--workers", "2")


def worker_killed(campaign: Campaign) -> None:
    """A worker in the middle of its trial: another one takes it, and the campaign ends as ever."""
    process = campaign.run_to(1 / 3, "--workers", "2")
    children = psutil.Process(process.pid).children(recursive=True)
    next(child for child in children if "spawn_main" in " ".join(child.cmdline())).kill()
    if process.wait():
        raise Broken(f"it failed: see {campaign.out.with_suffix('.txt')}")


def scheduler_elsewhere(campaign: Campaign) -> None:
    """A scheduler and two workers in other processes; the runner killed at a third, and resumed there."""
    with scheduler() as address:
        kill(campaign.run_to(1 / 3, "--scheduler", address), group=True)
        resumed(campaign, "--scheduler", address)


def two_workers(campaign: Campaign) -> None:
    """Undisturbed, with two workers."""
    campaign.finish("--workers", "2")


CASES: dict[str, Callable[[Campaign], None]] = {
    case.__name__: case for case in (two_workers, group_killed, runner_killed, worker_killed, scheduler_elsewhere)
}


@contextlib.contextmanager
def scheduler() -> Iterator[str]:
    """A Dask scheduler and two workers, in processes of their own."""
    with socket.create_server((HOST, 0)) as free:
        port = free.getsockname()[1]
    address = f"tcp://{HOST}:{port}"
    worker = ["worker", address, "--host", HOST, "--nthreads", "1", "--no-dashboard", "--no-nanny"]
    commands = (["scheduler", "--host", HOST, "--port", str(port), "--no-dashboard"], worker, worker)
    null = subprocess.DEVNULL
    processes = [subprocess.Popen([str(BIN / "dask"), *words], stdout=null, stderr=null) for words in commands]
    try:
        yield address
    finally:
        for process in reversed(processes):
            process.terminate()
            process.wait(END_S)


def results(out: Path) -> list[dict[str, str]]:
    """results.csv without the commit, which may change between two runs."""
    with (out / "results.csv").open(newline="") as file:
        return [{name: text for name, text in row.items() if name != "git_commit"} for row in csv.DictReader(file)]


def compare(out: Path, reference: Path) -> None:
    """Raise Broken where results or tables differ."""
    ours, theirs = results(out), results(reference)
    differing = [a["id"] for a, b in zip(ours, theirs, strict=False) if a != b]
    if len(ours) != len(theirs) or differing:
        raise Broken(f"results.csv differs: {len(ours)} rows for {len(theirs)}, {len(differing)} of them others")
    if (out / "report.json").read_bytes() != (reference / "report.json").read_bytes():
        raise Broken("report.json differs")


def small_plan(name: str, trials: int, folder: Path) -> Path:
    """Write a plan with Table II's first references only, of `trials` trials or a few more."""
    path = plan_file(name).path
    text, each = path.read_text(), 2 * len(load_plan(path).controllers)
    references = ", ".join(f'"rice_box/{k}"' for k in range(-(-trials // each)))
    experiment = f'name = "table2"\nreferences = [{references}]\ndisplacements_mm = [-30.0, 30.0]\nrepetitions = 1\n'
    path = folder / f"first-{trials}.toml"
    path.write_text(f"{text[: text.index('[[experiments]]')]}[[experiments]]\n{experiment}")
    return path


def main() -> int:
    """Run the cases."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("work", type=Path, metavar="WORK")
    parser.add_argument("--plan", default="reference-spreading")
    size = parser.add_mutually_exclusive_group()
    size.add_argument("--trials", type=int)
    size.add_argument("--quick", action="store_true")
    parser.add_argument("--cases", nargs="+", choices=list(CASES), default=list(CASES))
    arguments = parser.parse_args()
    arguments.work.mkdir(parents=True, exist_ok=True)
    plan = arguments.plan
    if arguments.trials:
        plan = str(small_plan(plan, arguments.trials, arguments.work))
    total = load_plan(plan_file(plan).path, arguments.quick).size()
    undisturbed = Campaign(plan, arguments.quick, arguments.work / "undisturbed", total)
    print(f"{total} trials a case", flush=True)
    undisturbed.finish("--workers", "1")
    failed = 0
    for name in arguments.cases:
        campaign = Campaign(plan, arguments.quick, arguments.work / name, total)
        if not (campaign.out / DONE).exists():
            shutil.rmtree(campaign.out, ignore_errors=True)
            try:
                CASES[name](campaign)
                compare(campaign.out, undisturbed.out)
            except Broken as broken:
                failed += 1
                print(f"{name}: {broken}", flush=True)
                continue
            (campaign.out / DONE).touch()
        print(f"{name}: the same {total} results and tables", flush=True)
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
