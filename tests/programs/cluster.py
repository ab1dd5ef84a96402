"""Three workers in three network namespaces run a campaign: one is killed, one is cut off, and the table is the same.

Runner, Dask scheduler and an S3-compatible server (moto) are in one namespace, each worker in one of its own behind a
cable of its own; logs go to s3://. The first worker is killed with -9 and the second one's cable is pulled, both in the
middle of a trial; later the cable is back, and so is what that worker still had to say. A fourth worker, of another
version, is refused. Then results.csv and report.json have to be those of an undisturbed campaign with one local worker,
with one log a trial. Exit status 0 where they are, 1 otherwise, 3 without namespaces.

Takes some minutes.
"""

import contextlib
import csv
import http.client
import os
import re
import shutil
import sqlite3
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Annotated

import typer

from rtstack.experiments.registry import plan_file
from rtstack.papers.reference_spreading.plan import load_plan
from tests.programs import program
from tests.support.network import switch
from tests.support.network.namespaces import Namespace, permitted

BIN = Path(sys.executable).parent
PLAN = "reference-spreading"
NETWORK = "10.77.{}.{}"
HOME, SCHEDULER_PORT, S3_PORT = "10.77.200.1", 18786, 15000
BUCKET = "campaigns"
PATIENCE_S = 280.0
WORKERS = 3
OTHER_VERSION = "0.0.9"
LATE_S = 20.0  # for what a worker that comes back still has to say
# a cut-off worker is noticed by its kernel's silence, not by its own: a trial keeps it from its heartbeats. Dask's
# patience is half a minute, and 11 s is the least that it takes
DASK = {"DASK_DISTRIBUTED__COMM__TIMEOUTS__TCP": "11s"}
S3 = {
    "AWS_ENDPOINT_URL": f"http://{HOME}:{S3_PORT}", "AWS_ACCESS_KEY_ID": "test", "AWS_SECRET_ACCESS_KEY": "test",
    "AWS_DEFAULT_REGION": "us-east-1", "AWS_EC2_METADATA_DISABLED": "true",
}  # fmt: skip


class Broken(Exception):
    """What is not as it has to be."""


class Network:
    """One namespace at home and one a worker, joined by a switch."""

    def __init__(self) -> None:
        self.home, self.workers = Namespace(), [Namespace() for _ in range(WORKERS)]
        self.addresses = [HOME, *(NETWORK.format(200, 2 + k) for k in range(WORKERS))]
        everybody = (self.home, *self.workers)
        ends = [one.connect(at, mtu=60000) for one, at in zip(everybody, self.addresses, strict=True)]
        words = [f"{address}={end}" for address, end in zip(self.addresses, ends, strict=True)]
        command = [sys.executable, switch.__file__, *words]
        self._switch = subprocess.Popen(command, stdin=subprocess.PIPE, pass_fds=ends)
        for end in ends:
            os.close(end)

    def close(self) -> None:
        """End all of it."""
        assert self._switch.stdin is not None
        self._switch.stdin.close()
        self._switch.wait(PATIENCE_S)
        for one in (self.home, *self.workers):
            one.close()


class Site:
    """Scheduler, object store and workers, each in its place. Their words go to files in `work`."""

    def __init__(self, network: Network, work: Path) -> None:
        self.network, self.work = network, work
        self.address = f"tcp://{HOME}:{SCHEDULER_PORT}"
        self.environment = os.environ | DASK | S3
        self._processes: list[subprocess.Popen] = []
        home = network.home
        self.start(home, "store", BIN / "moto_server", "-H", HOME, "-p", str(S3_PORT))
        scheduler = ("scheduler", "--host", HOME, "--port", str(SCHEDULER_PORT), "--no-dashboard")
        self.start(home, "scheduler", BIN / "dask", *scheduler)
        self.workers = [
            self.worker(namespace, name, network.addresses[1 + k])
            for k, (namespace, name) in enumerate(zip(network.workers, ("killed", "cut", "quiet"), strict=True))
        ]
        self.other = self.worker(home, "other", HOME, PYTHONPATH=f"{_other_version(work)}:{_python_path()}")
        until(lambda: self.store("PUT", f"/{BUCKET}") == 200, "the object store does not answer")
        for name, worker in zip(("killed", "cut", "quiet", "other"), (*self.workers, self.other), strict=True):
            registered = f"the worker {name} has no scheduler: see {work / name}.txt"
            until(lambda name=name: "Registered to" in self.said(name), registered, worker)

    def worker(self, where: Namespace, name: str, host: str, **environment: str) -> subprocess.Popen:
        """Start a worker of one thread."""
        words = ["worker", self.address, "--host", host, "--name", name, "--nthreads", "1", "--no-dashboard"]
        return self.start(where, name, BIN / "dask", *words, "--no-nanny", **environment)

    def start(self, where: Namespace, name: str, *command: str | Path, **environment: str) -> subprocess.Popen:
        """Start a program somewhere."""
        with (self.work / f"{name}.txt").open("wb") as said:
            process = where.start(*command, stdout=said, stderr=said, env=self.environment | environment)
        self._processes.append(process)
        return process

    def said(self, name: str) -> str:
        """What a program has said so far."""
        return (self.work / f"{name}.txt").read_text(errors="replace")

    def store(self, method: str, path: str) -> int:
        """Ask the object store for something; its status, 0 without an answer. `body` is what it said."""
        connection = http.client.HTTPConnection(HOME, S3_PORT, timeout=30.0)
        try:
            with self.network.home.inside():
                connection.request(method, path)
                answer = connection.getresponse()
                self.body = answer.read().decode(errors="replace")
                return answer.status
        except OSError:
            return 0
        finally:
            connection.close()

    def logs(self) -> list[str]:
        """Names of the logs in the store."""
        self.store("GET", f"/{BUCKET}?list-type=2&prefix=logs/")
        return re.findall(r"<Key>logs/([^<]*)</Key>", self.body)

    def close(self) -> None:
        """End every program."""
        for process in reversed(self._processes):
            process.kill()
            process.wait(PATIENCE_S)


def until(holds: Callable[[], bool], otherwise: str, process: subprocess.Popen | None = None) -> None:
    """Wait until something holds. Raises Broken where it takes too long, or the process has ended."""
    deadline = time.monotonic() + PATIENCE_S
    while not holds():
        if time.monotonic() > deadline or (process is not None and process.poll() is not None and not holds()):
            raise Broken(otherwise)
        time.sleep(0.1)


def _python_path() -> str:
    return os.environ.get("PYTHONPATH", "")


def _other_version(work: Path) -> Path:
    """The same package, installed under another version: its metadata are found first."""
    metadata = work / "other" / f"rtstack-{OTHER_VERSION}.dist-info" / "METADATA"
    metadata.parent.mkdir(parents=True, exist_ok=True)
    metadata.write_text(f"Metadata-Version: 2.1\nName: rtstack\nVersion: {OTHER_VERSION}\n")
    return metadata.parent.parent


def disturbed(site: Site, plan: Path, out: Path) -> str:
    """Run the campaign, kill a worker and cut another one off. Returns what the campaign said. Raises Broken."""
    campaign = site.start(
        site.network.home, "campaign", BIN / "rtstack", "campaign", plan, "--out", out, "--scheduler", site.address,
        "--logs", f"s3://{BUCKET}",
    )  # fmt: skip
    total = load_plan(plan).size()
    until(lambda: len(site.logs()) >= 1, f"no trial came about: {site.said('campaign')}", campaign)
    site.workers[0].kill()
    site.network.workers[1].plug(False)
    at = len(site.logs())
    if at >= total - 1:
        raise Broken(f"{at} of {total} trials were done before anything went wrong: take more")
    print(f"{at} of {total} trials done: one worker killed, one cut off", flush=True)
    until(lambda: re.search(r"Remove worker.*\bname: cut\b", site.said("scheduler")) is not None, "nobody missed it")
    site.network.workers[1].plug(True)
    print(f"missed by the scheduler; the cable is back, with {len(site.logs())} of {total} trials done", flush=True)
    if campaign.wait(PATIENCE_S * total):
        raise Broken(f"the campaign failed: {site.said('campaign')}")
    # whatever it still has to say: it ends by itself once it has heard that its scheduler has given it up
    with contextlib.suppress(subprocess.TimeoutExpired):
        site.workers[1].wait(LATE_S)
    return site.said("campaign")


def compare(site: Site, plan: Path, out: Path, undisturbed: Path, said: str) -> None:
    """Raise Broken where the disturbed campaign is not the undisturbed one."""
    ours, theirs = results(out), results(undisturbed)
    if [row["id"] for row in ours] != [row["id"] for row in theirs]:
        raise Broken(f"{len(ours)} rows instead of {len(theirs)}")
    differing = [a["id"] for a, b in zip(ours, theirs, strict=True) if a != b]
    if differing:
        raise Broken(f"{len(differing)} rows differ, {differing[0]} first")
    if (out / "report.json").read_bytes() != (undisturbed / "report.json").read_bytes():
        raise Broken("report.json differs")
    logs, wanted = site.logs(), sorted(f"{row['id']}.mcap" for row in theirs)
    if sorted(logs) != wanted:
        raise Broken(f"{len(logs)} logs instead of {len(wanted)}: {sorted(set(logs) ^ set(wanted))}")
    with sqlite3.connect(out / "campaign.sqlite") as table:
        workers = {row[0].rpartition(":")[2] for row in table.execute("SELECT worker FROM results")}
    if str(site.other.pid) in workers:
        raise Broken("the worker of another version ran a trial")
    refusals = [line for line in said.splitlines() if "it gets no trials" in line]
    if len(refusals) != 1 or f"rtstack {OTHER_VERSION} instead of" not in refusals[0]:
        raise Broken(f"not one line on the worker of another version, but {refusals}")
    print(refusals[0])
    print(f"the same {len(theirs)} rows and report, {len(wanted)} logs at s3://{BUCKET}", flush=True)


def results(out: Path) -> list[dict[str, str]]:
    """results.csv without the commit, which may change between two runs."""
    with (out / "results.csv").open(newline="") as file:
        return [{name: text for name, text in row.items() if name != "git_commit"} for row in csv.DictReader(file)]


def small_plan(name: str, trials: int, folder: Path) -> Path:
    """Write a plan with Table II's first references only, of `trials` trials or a few more."""
    path = plan_file(name).path
    text, each = path.read_text(), 2 * len(load_plan(path).controllers)
    references = ", ".join(f'"rice_box/{k}"' for k in range(-(-trials // each)))
    experiment = f'name = "table2"\nreferences = [{references}]\ndisplacements_mm = [-30.0, 30.0]\nrepetitions = 1\n'
    path = folder / f"first-{trials}.toml"
    path.write_text(f"{text[: text.index('[[experiments]]')]}[[experiments]]\n{experiment}")
    return path


def main(
    work: Path,
    plan: Annotated[Path | None, typer.Option(help="default: the first references of reference-spreading")] = None,
    trials: Annotated[int, typer.Option(help="of the default plan, about")] = 40,
    undisturbed: Annotated[Path | None, typer.Option(help="folder of that plan's campaign; else it is run")] = None,
) -> int:
    """Run both, and compare."""
    print(f"{1 + WORKERS} network namespaces, {permitted()}", flush=True)
    work = work.resolve()
    shutil.rmtree(work, ignore_errors=True)
    work.mkdir(parents=True)
    plan = (plan or small_plan(PLAN, trials, work)).resolve()
    if undisturbed is None:
        undisturbed = work / "undisturbed"
        command = [BIN / "rtstack", "campaign", plan, "--out", undisturbed, "--workers", "1"]
        subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
    network = Network()
    try:
        site = Site(network, work)
        try:
            compare(site, plan, work / "out", undisturbed, disturbed(site, plan, work / "out"))
        finally:
            site.close()
    except Broken as broken:
        print(broken, file=sys.stderr)
        return 1
    finally:
        network.close()
    return 0


if __name__ == "__main__":
    program(main)
