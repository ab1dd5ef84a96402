"""The judge's tests as mutation testing runs them: which test runs which lines, and a process a mutant.

The tests are collected once. A mutant in a function is that function's code exchanged in a forked process, which then
runs the tests that touch its lines, to the first failure: those first that found most mutants a second, and most of
this place. A mutant outside of functions, or one that these let pass and whose lines run while the tests are imported,
needs everything imported anew, with the mutant in the place of its module, and all tests.
"""

import functools
import importlib.abc
import importlib.util
import os
import resource
import signal
import sys
from collections import Counter, defaultdict
from collections.abc import Callable, Iterable
from pathlib import Path
from time import perf_counter
from types import CodeType
from typing import Any

import coverage
import pytest

from tests.support.safety.mutants import Mutant, functions

PATIENCE_S = 20.0  # of a processor, and four times what all tests take: who needs more does not end
SAME_PLACE = 20  # so many times a mutant of the same function, or outside of them, counts where tests are put in order
OPTIONS = ["-s", "--noconftest", "-p", "no:cacheprovider", "-p", "no:terminal", "-c", os.devnull]
OPTIONS += ["-W", "ignore", "--assert=plain"]


class Child:
    """A forked process that runs tests on a mutant: it exits with 0 where they all pass, and says which one failed."""

    def __init__(self, work: Callable[[], str], patience_s: int) -> None:
        reader, writer = os.pipe()
        self.pid = os.fork()
        if self.pid == 0:
            said = "it broke off"
            try:
                signal.signal(signal.SIGINT, signal.SIG_DFL)
                resource.setrlimit(resource.RLIMIT_CPU, (patience_s, patience_s + 5))
                quiet = os.open(os.devnull, os.O_WRONLY)
                os.dup2(quiet, 1)
                os.dup2(quiet, 2)
                said = work()
            finally:
                os.write(writer, said.encode()[:4000])
                os._exit(1 if said else 0)
        os.close(writer)
        self._said = reader

    def killer(self) -> str:
        """Return the test that failed, empty where none did. The process has ended."""
        with os.fdopen(self._said) as said:
            return said.read()


class First:
    """A plug-in of pytest's that remembers the first failure, and what it said."""

    def __init__(self, worth: Callable[[str], float]) -> None:
        """worth: of a test by its name; the smallest one is run first."""
        self._worth = worth
        self.failed = self.why = ""

    def pytest_collection_modifyitems(self, items: list[pytest.Item]) -> None:
        """Put the tests in order."""
        items.sort(key=lambda item: self._worth(item.nodeid))

    def pytest_collectreport(self, report: pytest.CollectReport) -> None:
        """Notice a file that could not be imported."""
        self.pytest_runtest_logreport(report)

    def pytest_runtest_logreport(self, report: pytest.CollectReport | pytest.TestReport) -> None:
        """Notice a failure."""
        if report.failed and not self.failed:
            self.failed, self.why = report.nodeid, report.longreprtext


class Tests(First):
    """The collected tests, and what is known of them."""

    __test__ = False

    def __init__(self, paths: list[str], choice: str, files: Iterable[str]) -> None:
        """paths, choice: as pytest takes them; files: the sources whose lines count."""
        super().__init__(self._value)
        self._paths, self._options = paths, [*OPTIONS, "-k", choice]
        self._coverage = coverage.Coverage(data_file=None, include=list(files), config_file=False)
        self._items: dict[str, pytest.Item] = {}
        self._touching: dict[tuple[str, int], set[str]] = defaultdict(set)
        self._seconds: dict[str, float] = {}
        self._found: Counter[tuple[str, str]] = Counter()

    def run(self, main: Callable[[], None]) -> None:
        """Collect the tests, run each of them once on the judge as it is, and call main, unless one fails."""
        self._main = main
        self._coverage.start()
        status = pytest.main([*self._paths, *self._options], plugins=[self])
        if status == pytest.ExitCode.INTERRUPTED and not self.failed:
            raise KeyboardInterrupt
        if status not in (pytest.ExitCode.OK, pytest.ExitCode.TESTS_FAILED) and not self.failed:
            self.failed = f"pytest ended with {status!r}: it"

    @pytest.hookimpl(tryfirst=True)
    def pytest_runtestloop(self, session: pytest.Session) -> bool:
        """Run every test once, remember the lines that it runs, and go on with main."""
        self._items = {item.nodeid: item for item in session.items}
        for name, item in self._items.items():
            began = perf_counter()
            self._coverage.switch_context(name)
            self._run(item)
            self._seconds[name] = perf_counter() - began
        self._coverage.stop()
        data = self._coverage.get_data()
        for file in data.measured_files():
            for line, names in data.contexts_by_lineno(file).items():
                self._touching[Path(file).stem, line].update(names)
        if not self.failed:
            self._main()
        return True

    # a mutant's processes

    def start(self, mutant: Mutant) -> Child:
        """Run a mutant's tests in a process."""
        names = self._names(mutant)
        patience_s = round(PATIENCE_S + 4.0 * sum(self._seconds.values()))
        anew = self.anew(mutant)
        ordered = sorted(names - {""} if mutant.function else (), key=lambda name: self._value(name, _place(mutant)))
        return Child(lambda: self._run_some(mutant, ordered) or (self._run_anew(mutant) if anew else ""), patience_s)

    def anew(self, mutant: Mutant) -> bool:
        """Whether a mutant that is exchanged may do less than one that was there from the beginning."""
        names = self._names(mutant)
        return mutant.function is None or "" in names or not names

    def _names(self, mutant: Mutant) -> set[str]:
        """Return the tests that run the lines; the name without text is that of what ran while they were imported."""
        return set().union(*(self._touching[mutant.module, n] for n in range(mutant.lines[0], mutant.lines[1] + 1)))

    def note(self, mutant: Mutant, killer: str) -> None:
        """Remember which test noticed a mutant."""
        for place in ("", _place(mutant)):
            self._found[place, killer] += 1

    def _value(self, name: str, place: str = "") -> float:
        worth = 1 + self._found["", name] + (SAME_PLACE * self._found[place, name] if place else 0)
        return -worth / (self._seconds.get(name, 1.0) + 0.01)

    def _run(self, item: pytest.Item) -> None:
        item.ihook.pytest_runtest_protocol(item=item, nextitem=None)

    def _run_some(self, mutant: Mutant, names: list[str]) -> str:
        if names:
            _exchange(f"rtstack.safety.{mutant.module}", mutant.function or "", mutant.code)
        for name in names:
            self._run(self._items[name])
            if self.failed:
                break
        return self.failed

    def _run_anew(self, mutant: Mutant) -> str:
        tests = {Path(path).stem for path in self._paths}
        for name in list(sys.modules):
            if name.partition(".")[0] in ("rtstack", *tests) or name.startswith("tests.support.safety.judge_"):
                del sys.modules[name]
        sys.meta_path.insert(0, _Import(f"rtstack.safety.{mutant.module}", mutant.code))
        first = First(lambda name: self._value(name, _place(mutant)))
        status = pytest.main([*self._paths, *self._options, "-x"], plugins=[first])
        return first.failed or ("" if status == 0 else "before any test")


class _Import(importlib.abc.MetaPathFinder, importlib.abc.Loader):
    """Gives one module from a code instead of its file."""

    def __init__(self, name: str, code: CodeType) -> None:
        self._name, self._code = name, code

    def find_spec(self, fullname: str, path: object, target: object = None):
        return importlib.util.spec_from_loader(fullname, self) if fullname == self._name else None

    def exec_module(self, module) -> None:
        exec(self._code, module.__dict__)


def _place(mutant: Mutant) -> str:
    return f"{mutant.module}.{mutant.function or ''}"


def _exchange(module: str, path: str, code: CodeType) -> None:
    """Give a function that is already imported, everywhere at once, the code that it has in another module's code."""
    *outer, name = path.split(".")
    found = vars(functools.reduce(getattr, outer, sys.modules[module]))[name]
    function: Any = found.fget if isinstance(found, property) else found
    function.__code__ = dict(functions(code))[path]
