"""Mutation testing of the judge and the arming state machine: change one thing, run the tests, see whether they notice.

Own code, because the known tools cannot see it: mutmut leaves decorated functions alone, and all that counts here is
under `njit`; cosmic-ray rewrites the sources in place, under a stack that may be running them. Here the compiled
functions run as the plain Python that they are (NUMBA_DISABLE_JIT), and a mutant is a forked process.

What became of each mutant is kept in .mutants/, in a file for each version of the two: the next run goes on from
there. Survivors that nobody has listed are run again where the tests have changed. Prints killed / total; exit status
1 where a survivor is not listed in mutation_survivors.txt, or not all have been run; 2 where the tests fail on the
judge as it is. A first look, of which nothing is kept: `--module arming --test test_arming_steps --count 1`.

Takes hours, --minutes at a time.
"""

import os
import signal
import sys
import time
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Annotated

import typer

from tests.programs import choose, program

os.environ["NUMBA_DISABLE_JIT"] = "1"  # before anything imports numba
os.environ["RTSTACK_SEQUENCES"] = "20"

import hypothesis

from tests.support.safety.judge_version import MODULES, PACKAGE, SUPPORT, digest
from tests.support.safety.mutant_tests import Child, Tests
from tests.support.safety.mutants import Mutant, mutants

HERE = Path(__file__).resolve().parent
ROOT = HERE.parents[1]
TESTS = sorted(path for path in (ROOT / "tests/safety").glob("test_*.py") if not path.stem.endswith("_plant"))
# what needs many runs of the judge says nothing about a mutant that the others do not; it runs with the compiled judge
CHOICE = "not from_any_state and not masses_that and not whatever_is_wanted"
SURVIVORS = HERE / "mutation_survivors.txt"
RESULTS = ROOT / ".mutants"
SAY_S = 10.0


class Results:
    """What became of the mutants of this version of the judge: lines of status, the tests' digest, and the name."""

    def __init__(self, folder: Path = RESULTS) -> None:
        folder.mkdir(exist_ok=True)
        (folder / ".gitignore").write_text("*\n")
        self._path = folder / f"{digest()}.tsv"
        self._tests = digest(*TESTS, SUPPORT / "judge_oracle.py", SUPPORT / "judge_samples.py", modules=())
        self.killed: dict[str, bool] = {}
        self.by_other_tests: set[str] = set()
        tolerated = listed()
        for line in self._path.read_text().splitlines() if self._path.exists() else ():
            status, tests, name = line.split("\t")
            if tests == self._tests or status == "killed" or name in tolerated:
                self.killed[name] = status == "killed"
            if tests != self._tests:
                self.by_other_tests.add(name)

    def keep(self, name: str, killed: bool) -> None:
        """Remember a result, on disk at once."""
        self.killed[name] = killed
        self.by_other_tests.discard(name)
        with self._path.open("a") as file:
            file.write(f"{'killed' if killed else 'survived'}\t{self._tests}\t{name}\n")


def run(waiting: list[Mutant], tests: Tests, results: Results, jobs: int, minutes: float) -> None:
    """Run what waits, `jobs` at a time; at last what takes longest: all imported anew, and what all tests let pass."""
    began = said = time.monotonic()
    tolerated = listed()
    queue = sorted(waiting, key=lambda mutant: (mutant.name not in tolerated, not tests.anew(mutant)))
    running: dict[int, tuple[Child, Mutant]] = {}
    while running or (queue and time.monotonic() - began < 60.0 * minutes):
        while queue and len(running) < jobs:
            mutant = queue.pop()
            child = tests.start(mutant)
            running[child.pid] = child, mutant
        pid, status = os.wait()
        child, mutant = running.pop(pid)
        killer = child.killer()
        if os.WIFSIGNALED(status) and os.WTERMSIG(status) != signal.SIGXCPU:
            print(f"ended from outside, not counted: {mutant.name}", flush=True)
            continue
        if killer:
            tests.note(mutant, killer)
        results.keep(mutant.name, status != 0)
        if status == 0:
            print(f"survived  {mutant.name}", flush=True)
        left = len(queue) + len(running)
        if time.monotonic() - said > SAY_S:
            said = time.monotonic()
            minutes_left = (said - began) / (len(waiting) - left) * left / 60.0
            print(f"          {left} of {len(waiting)} left, {minutes_left:.1f} min", flush=True)


def listed() -> set[str]:
    """Return the names of the mutants that nobody can tell apart."""
    return {line.rpartition(" # ")[0] for line in SURVIVORS.read_text().splitlines() if " # " in line}


def report(names: list[str], results: Results) -> int:
    """Print killed / total, and the survivors that nobody has listed; return the exit status."""
    done = [name for name in names if name in results.killed]
    survivors = [name for name in done if not results.killed[name]]
    tolerated = listed()
    unlisted = [name for name in survivors if name not in tolerated]
    for name in unlisted:
        print(f"survived and not listed: {name}")
    for name in sorted(tolerated.intersection(done).difference(survivors)):
        print(f"listed, and killed all the same: {name}")
    print(f"killed {len(done) - len(survivors)} / {len(names)} mutants, "
          f"{len(results.by_other_tests.intersection(done))} of them by earlier tests; {len(survivors)} survivors, "
          f"{len(unlisted)} of them not listed in {SURVIVORS.name}; not run: {len(names) - len(done)}")  # fmt: skip
    return 1 if unlisted or len(done) < len(names) else 0


def main(
    minutes: Annotated[float, typer.Option(help="stop after this long; the next run goes on")] = 120.0,
    jobs: int = 2,
    module: list[str] | None = None,
    test: Annotated[list[str] | None, typer.Option(help="only this file of tests/safety: nothing is kept")] = None,
    count: Annotated[int | None, typer.Option(help="only the first so many of the chosen mutants")] = None,
) -> int:
    """Run what has not been run yet, within the time; return the exit status."""
    os.nice(5)
    os.chdir(ROOT)
    hypothesis.settings.register_profile(
        "mutants", deadline=None, database=None, max_examples=25, derandomize=True,
        phases=(hypothesis.Phase.explicit, hypothesis.Phase.generate),
        suppress_health_check=list(hypothesis.HealthCheck),
    )  # fmt: skip
    hypothesis.settings.load_profile("mutants")
    files = [path for path in TESTS if path.stem in choose(test, [path.stem for path in TESTS])]
    chosen = [m for name in choose(module, MODULES) for m in mutants(PACKAGE / f"{name}.py")][:count]
    with TemporaryDirectory() as folder:
        return _run_and_report(chosen, files, Results(Path(folder)) if test else Results(), jobs, minutes)


def _run_and_report(chosen: list[Mutant], files: list[Path], results: Results, jobs: int, minutes: float) -> int:
    names = [mutant.name for mutant in chosen]
    waiting = [mutant for mutant in chosen if mutant.name not in results.killed]
    print(f"{len(names)} mutants, {len(names) - len(waiting)} of them known from earlier runs", flush=True)
    if waiting:
        tests = Tests([str(path) for path in files], CHOICE, [str(PACKAGE / "*.py")])
        tests.run(lambda: run(waiting, tests, results, jobs, minutes))
        if tests.failed:
            print(f"{tests.why}\n{tests.failed} fails on the judge as it is: see to that first", file=sys.stderr)
            return 2
    return report(names, results)


if __name__ == "__main__":
    program(main)
