"""Mutation testing of the judge: change one thing in its source, run its tests, see whether they notice.

    .venv/bin/python tests/safety/mutate.py [--minutes 30] [--jobs 1] [--module stop]

Own code, because the known tools cannot see it: mutmut leaves decorated functions alone, and all that counts here is
under `njit`; cosmic-ray rewrites the sources in place, under a stack that may be running them. Here the compiled
functions run as the plain Python that they are (NUMBA_DISABLE_JIT), and a mutant is an import hook in a forked process.

What became of each mutant is kept in .mutants/, in a file a version of the judge: the next run goes on from there.
Survivors are run again where the tests have changed. Prints killed / total; exit status 1 where a survivor is not
listed in mutation_survivors.txt, or not all have been run.
"""

import argparse
import ast
import hashlib
import importlib.abc
import importlib.util
import os
import random
import signal
import sys
import time
from collections import Counter
from collections.abc import Iterable, Iterator
from pathlib import Path

from mutants import mutants

os.environ["NUMBA_DISABLE_JIT"] = "1"

HERE = Path(__file__).resolve().parent
ROOT = HERE.parents[1]
PACKAGE = ROOT / "rtstack" / "safety"
MODULES = ("stop", "checks", "judge", "geometry", "limits", "records", "body", "reasons")
TESTS = [
    str(HERE / f"test_{name}.py") for name in ("judge_boundaries", "judge_pair", "judge_stop", "judge", "safety_limits")
]
# what needs many runs of the judge says nothing about a mutant that the others do not; it runs with the compiled judge
SLOW = "not from_any_state and not masses_that and not whatever_is_wanted and not definitions and not no_chain"
SURVIVORS = HERE / "mutation_survivors.txt"
RESULTS = ROOT / ".mutants"
PATIENCE_S = 120


class Import(importlib.abc.MetaPathFinder, importlib.abc.Loader):
    """Gives one module from a tree instead of its file."""

    def __init__(self, module: str, tree: ast.Module) -> None:
        self._name, self._tree = f"rtstack.safety.{module}", ast.fix_missing_locations(tree)

    def find_spec(self, fullname: str, path: object, target: object = None):
        return importlib.util.spec_from_loader(fullname, self) if fullname == self._name else None

    def exec_module(self, module) -> None:
        exec(compile(self._tree, f"<mutant of {self._name}>", "exec"), module.__dict__)


def start(module: str, tree: ast.Module) -> int:
    """Fork a process that runs the tests on the mutant; it exits with 0 where they all pass. Returns its id."""
    child = os.fork()
    if child:
        return child
    signal.alarm(PATIENCE_S)
    quiet = os.open(os.devnull, os.O_WRONLY)
    os.dup2(quiet, 1)
    os.dup2(quiet, 2)
    status = 1
    try:
        import pytest

        for name in [n for n in sys.modules if n.startswith("rtstack.safety")]:
            del sys.modules[name]
        sys.meta_path.insert(0, Import(module, tree))
        status = pytest.main(
            [*TESTS, "-x", "-q", "--noconftest", "-p", "no:cacheprovider", "-W", "ignore", "--assert=plain", "-k", SLOW]
        )
    finally:
        os._exit(0 if status == 0 else 1)


def _digest(paths: list[Path]) -> str:
    return hashlib.sha256(b"".join(path.read_bytes() for path in paths)).hexdigest()[:12]


class Results:
    """What became of the mutants of this version of the judge: lines of status, the tests' digest, and the key.

    A mutant's key is its name and the how manyth of that name it is: the same line may stand in two functions.
    """

    def __init__(self) -> None:
        RESULTS.mkdir(exist_ok=True)
        (RESULTS / ".gitignore").write_text("*\n")
        self._path = RESULTS / f"{_digest([PACKAGE / f'{module}.py' for module in MODULES])}.tsv"
        self._tests = _digest([*map(Path, TESTS), HERE / "judge_oracle.py", HERE / "judge_samples.py"])
        self.killed: dict[str, bool] = {}
        self.by_other_tests: set[str] = set()
        for line in self._path.read_text().splitlines() if self._path.exists() else ():
            status, tests, key = line.split("\t")
            if tests == self._tests or status == "killed":
                self.killed[key] = status == "killed"
            if tests != self._tests:
                self.by_other_tests.add(key)

    def keep(self, key: str, killed: bool) -> None:
        """Remember a result, on disk at once."""
        self.killed[key] = killed
        self.by_other_tests.discard(key)
        with self._path.open("a") as file:
            file.write(f"{'killed' if killed else 'survived'}\t{self._tests}\t{key}\n")


def _keyed(modules: Iterable[str]) -> Iterator[tuple[str, str, ast.Module]]:
    """Yield key, module and tree of every mutant."""
    seen: Counter[str] = Counter()
    for module in modules:
        for name, tree in mutants(PACKAGE / f"{module}.py"):
            seen[name] += 1
            yield f"{name} ({seen[name]})", module, tree


def _name(key: str) -> str:
    return key.rpartition(" (")[0]


def main() -> int:
    """Run what has not been run yet, within the time; return the exit status."""
    arguments = argparse.ArgumentParser(description="Mutation testing of the safety judge.")
    arguments.add_argument("--minutes", type=float, default=30.0, help="stop after this long; the next run goes on")
    arguments.add_argument("--jobs", type=int, default=1)
    arguments.add_argument("--module", choices=MODULES, action="append")
    options = arguments.parse_args()
    os.nice(19)
    sys.path[:0] = [str(ROOT), str(HERE)]
    os.chdir(ROOT)
    import hypothesis
    import numba  # noqa: F401 - loaded once, before the forks
    import pytest  # noqa: F401

    import rtstack.samples  # noqa: F401

    hypothesis.settings.register_profile("mutants", deadline=None, database=None, max_examples=30)
    hypothesis.settings.load_profile("mutants")
    start("stop", ast.parse((PACKAGE / "stop.py").read_text()))
    if os.wait()[1] != 0:
        print("the tests fail on the judge as it is: see to that first", file=sys.stderr)
        return 2
    results = Results()
    all_of_them = list(_keyed(options.module or MODULES))
    waiting = [mutant for mutant in all_of_them if mutant[0] not in results.killed]
    total = len(all_of_them)
    print(f"{total} mutants, {total - len(waiting)} of them known from earlier runs", flush=True)
    random.Random(0).shuffle(waiting)
    running: dict[int, str] = {}
    left = len(waiting)
    end = time.monotonic() + 60.0 * options.minutes
    while running or (waiting and time.monotonic() < end):
        while waiting and len(running) < options.jobs and time.monotonic() < end:
            key, module, tree = waiting.pop()
            running[start(module, tree)] = key
        child, status = os.wait()
        key = running.pop(child)
        if os.WIFSIGNALED(status) and os.WTERMSIG(status) != signal.SIGALRM:
            continue  # somebody ended it: it says nothing
        results.keep(key, status != 0)
        left -= 1
        if status == 0:
            print(f"survived  {key}", flush=True)
        elif left % 50 == 0:
            print(f"          {left} of {total} are left", flush=True)
    return report([key for key, _, _ in all_of_them], results)


def report(keys: list[str], results: Results) -> int:
    """Print killed / total, and the survivors that nobody has listed; return the exit status."""
    done = [key for key in keys if key in results.killed]
    survivors = [key for key in done if not results.killed[key]]
    listed = {line.split(" # ")[0] for line in SURVIVORS.read_text().splitlines() if " # " in line}
    unlisted = [key for key in survivors if _name(key) not in listed]
    for key in unlisted:
        print(f"survived and not listed: {key}")
    print(f"killed {len(done) - len(survivors)} / {len(keys)} mutants, "
          f"{len(results.by_other_tests.intersection(done))} of them by earlier tests; {len(survivors)} survivors, "
          f"{len(unlisted)} of them not listed in {SURVIVORS.name}; not run: {len(keys) - len(done)}")  # fmt: skip
    return 1 if unlisted or len(done) < len(keys) else 0


if __name__ == "__main__":
    sys.exit(main())
