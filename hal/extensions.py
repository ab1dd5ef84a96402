"""Extension points: what installed packages offer under a group of entry points, found by name, loaded when needed."""

import inspect
import sys
import traceback
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache
from importlib.metadata import EntryPoint, entry_points
from pathlib import Path
from typing import Any, Generic, TypeVar, cast

T = TypeVar("T")


OURS = ("hal", "rtstack", "sim_robot", "console", "deploy")
PLUG_INS_RAISE = (Exception, SystemExit)  # a module of another author may also call exit
_ROOT = Path(__file__).resolve().parents[1]
_INSTALLED = {"site-packages", "dist-packages"}  # folders of packages, which are plug-ins only if they were loaded
_MOST = 120  # characters of an error's own text: an event has 200 in all
_LOADED: dict[str, str] = {}  # name and version of each package that was loaded, by its top-level module


def raised(error: BaseException, *called: object) -> str:
    """Return in one line what was raised, where, and what to do if it is the code of another author.

    Args:
        error: what was raised.
        called: the functions or methods of another author whose answer may have caused it, where ours raised it.
    """
    try:
        text = " ".join(f"{type(error).__name__}: {error}".split())
    except PLUG_INS_RAISE:  # its own text raises
        text = type(error).__name__
    text = text if len(text) <= _MOST else f"{text[:_MOST]}..."
    if where := culprit(error, *called):
        return f"{text} {blame(where)}"
    frames = list(traceback.walk_tb(error.__traceback__))
    return text + "".join(f" ({Path(frame.f_code.co_filename).name}:{line})" for frame, line in frames[-1:])


def culprit(error: BaseException, *called: object) -> str:
    """Return package, version, file and line of the innermost code of another author in a traceback; "" where all of it
    is ours. An answer of the wrong type is raised in ours: then of the first of `called`.
    """
    frames = reversed(list(traceback.walk_tb(error.__traceback__)))
    places = (_place(frame.f_globals.get("__name__", ""), frame.f_code.co_filename, line) for frame, line in frames)
    return next(filter(None, places), "") or (
        defined_at(*called) if isinstance(error, TypeError | AttributeError) else ""
    )


def defined_at(*things: object) -> str:
    """Return package, version, file and line of the first function, method or class of another author; "" for none."""
    return next(filter(None, map(_definition, things)), "")


def _definition(thing: object) -> str:
    thing = inspect.unwrap(getattr(thing, "func", thing))  # type: ignore[arg-type]  # of a functools.partial, or wraps
    code = getattr(thing, "__code__", None)
    if code is not None:
        return _place(str(thing.__module__), code.co_filename, code.co_firstlineno)
    kind = thing if isinstance(thing, type) else type(thing)
    try:
        return _place(kind.__module__, inspect.getfile(kind), inspect.findsource(kind)[1] + 1)
    except (OSError, TypeError):
        return ""


def package_of(module: str) -> str:
    """Return name and version of the loaded package that a module belongs to; "" for ours, and for no package."""
    return _LOADED.get(module.partition(".")[0], "")


@contextmanager
def blaming(what: str, *called: object, error: type[Exception] | None = None) -> Iterator[None]:
    """Where the code of another author raises, raise one line that begins with `what`; our own errors pass.

    Args:
        what: what cannot be done.
        called: see `raised`.
        error: the type of what is raised, ExtensionError by default.
    """
    try:
        yield
    except PLUG_INS_RAISE as reason:
        if type(reason).__module__.partition(".")[0] in OURS or not culprit(reason, *called):
            raise
        raise (error or ExtensionError)(f"{what}: {raised(reason, *called)}") from reason


def require(made: object, *methods: str) -> None:
    """Raise TypeError where an object of another author lacks one of these methods."""
    if missing := [name for name in methods if not callable(getattr(made, name, None))]:
        raise TypeError(f"{type(made).__name__} has no {', no '.join(missing)}")


def blame(where: str) -> str:
    """Return a place as the end of a message. Only a plug-in's begins with its package and a comma."""
    return f"({where}); mend it there{', or uninstall the package' * (', ' in where)}" if where else ""


def _place(module: str, file: str, line: int) -> str:
    top, package, path = module.partition(".")[0], package_of(module), Path(file)
    if top in OURS or top in sys.stdlib_module_names or any(path.is_relative_to(_ROOT / name) for name in OURS):
        return ""
    if not package and (file[:1] in ("", "<") or path.is_relative_to(sys.prefix) or _INSTALLED & set(path.parts)):
        return ""
    depth = 1 + module.count(".") + (path.stem == "__init__")
    return f"{package}{', ' * bool(package)}{'/'.join(path.parts[-depth:])}:{line}"


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
        if (module := entry.module.partition(".")[0]) not in OURS:
            _LOADED[module] = _package(entry)
        return found

    def make(self, name: str, argument: str, *methods: str) -> Any:
        """Return what the function under a name makes of the text behind NAME: on the command line. methods: which the
        object must have. Raises ExtensionError with one line.
        """
        make = cast("Callable[[str], Any]", self.load(name))
        with blaming(f"the {self.what} {name} cannot be opened with {argument!r}", make):
            require(made := make(argument), *methods)
        return made

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
