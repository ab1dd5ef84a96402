"""Extension points: what installed packages offer under a group of entry points, found by name, loaded when needed."""

import sys
import traceback
from dataclasses import dataclass
from functools import cache
from importlib.metadata import EntryPoint, entry_points
from pathlib import Path
from typing import Generic, TypeVar

T = TypeVar("T")


OURS = ("hal", "rtstack", "sim_robot", "console", "deploy")
_NO_PACKAGE = {"__main__", *sys.stdlib_module_names}
PLUG_INS_RAISE = (Exception, SystemExit)  # a module of another author may also call exit


def raised(error: BaseException) -> str:
    """Return in one line what was raised, in which file and line, and in which package, where that is not ours."""
    frames = list(traceback.walk_tb(error.__traceback__))
    packages = (str(frame.f_globals.get("__name__", "")).partition(".")[0] for frame, _ in frames)
    where = [f"{name}, " for name in packages if name not in OURS and name not in _NO_PACKAGE][:1]
    where += [f"{Path(frame.f_code.co_filename).name}:{line}" for frame, line in frames[-1:]]
    text = " ".join(f"{type(error).__name__}: {error}".split())
    return f"{text} ({''.join(where)})" if where else text


class ExtensionError(Exception):
    """An extension that is not there, is offered twice, or cannot be loaded. One line that says what to do."""


@dataclass(frozen=True)  # without slots: Python 3.11 cannot set the type that a generic class was made for
class ExtensionPoint(Generic[T]):
    """A group of entry points. what: one thing of the group, for messages; kind: the type that all of them have;
    ours: rtstack itself offers some, so that an empty group means an old installation."""

    group: str
    what: str
    kind: type[T]
    ours: bool = True

    def names(self) -> tuple[str, ...]:
        """Return the names that are offered, sorted. Imports nothing."""
        return tuple(sorted(_offered(self.group)))

    def check(self, name: str) -> str:
        """Return a name that is offered. Imports nothing. Raises ExtensionError."""
        names = self.names()
        if not names and not self.ours:
            raise ExtensionError(f"unknown {self.what} {name!r}: no installed package offers one")
        if not names:
            raise ExtensionError(f"no {self.what} is installed: the installation is older than its sources: make setup")
        if name not in names:
            raise ExtensionError(f"unknown {self.what} {name!r}: choose one of {', '.join(names)}")
        return name

    def load(self, name: str) -> T:
        """Import and return what is offered under a name. Raises ExtensionError."""
        offered = _offered(self.group)[self.check(name)]
        if len(offered) > 1:
            packages = ", ".join(sorted(map(_package, offered)))
            raise ExtensionError(f"{self.what} {name!r} is offered more than once: uninstall all but one of {packages}")
        entry = offered[0]
        try:
            found = entry.load()
        except PLUG_INS_RAISE as error:  # whatever the module of another author raises
            from hal.base.extras import advice  # which brings more than a name costs to look up

            if isinstance(error, ModuleNotFoundError) and (lacking := advice(error.name)):
                raise ExtensionError(f"{self.what} {name!r}: {lacking}") from error
            reason = " ".join(f"{type(error).__name__}: {error}".split())
            raise ExtensionError(self._refusal(entry, f"cannot be loaded: {reason}")) from error
        if not isinstance(found, self.kind):
            raise ExtensionError(self._refusal(entry, f"is {type(found).__name__}, not {self.kind.__name__}"))
        return found

    def package(self, name: str) -> tuple[str, str]:
        """Return name and version of the package that offers a name; of the first, where there are several."""
        entry = _offered(self.group)[name][0]
        return (entry.dist.name, entry.dist.version) if entry.dist is not None else ("unknown", "unknown")

    def loadable(self) -> tuple[dict[str, T], tuple[str, ...]]:
        """Return everything that can be loaded, by name, and one line for each that cannot."""
        found: dict[str, T] = {}
        refused: list[str] = []
        for name in self.names():
            try:
                found[name] = self.load(name)
            except ExtensionError as error:
                refused.append(str(error))
        return found, tuple(refused)

    def _refusal(self, entry: EntryPoint, reason: str) -> str:
        what = f"{self.what} {entry.name!r}: {entry.value} of {_package(entry)}"
        return f"{what} {reason}; repair or uninstall that package"


@cache
def _offered(group: str) -> dict[str, list[EntryPoint]]:
    """Entry points by name: to read the metadata of all packages takes some 10 ms."""
    found: dict[str, list[EntryPoint]] = {}
    for entry in entry_points(group=group):
        found.setdefault(entry.name, []).append(entry)
    return found


def _package(entry: EntryPoint) -> str:
    return f"{entry.dist.name} {entry.dist.version}" if entry.dist is not None else "an unknown package"
