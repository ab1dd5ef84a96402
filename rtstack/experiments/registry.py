"""The kinds of experiments that are installed: entry points of the group `rtstack.experiments`.

    [project.entry-points."rtstack.experiments"]
    my-kind = "my_package.my_module:MyExperiment"

The name is what a plan file says as `kind = "my-kind"`; the object is a subclass of Experiment
(rtstack.experiments.experiment). It is imported when a plan asks for its kind, or when plans are listed.
"""

import sys
import tomllib
from collections.abc import Callable
from contextlib import suppress
from functools import lru_cache
from importlib.resources import as_file, files
from pathlib import Path
from typing import Any

from hal.base.configuration import ConfigurationError
from hal.base.files import PARTIAL, replacing
from hal.base.shared import user_folder
from hal.extensions import ExtensionError, ExtensionPoint
from rtstack.experiments.experiment import Experiment
from rtstack.experiments.plan_file import PlanFile, plan_file_at
from rtstack.trials.errors import TrialError

GROUP = "rtstack.experiments"
_FIRST = "reference-spreading"  # of plans that were written when there was one kind

KINDS = ExtensionPoint(GROUP, "kind of experiment", type)


def kind_named(name: str) -> type[Experiment[Any, Any]]:
    """Import a kind. Raises TrialError with one line where there is none of this name, or where it cannot be used."""
    try:
        kind = KINDS.load(name)
    except ExtensionError as error:
        raise TrialError(str(error)) from None
    if not issubclass(kind, Experiment):
        raise TrialError(f"kind of experiment {name!r}: {kind.__qualname__} is no subclass of {Experiment.__module__}"
                         f".{Experiment.__qualname__}; repair or uninstall its package")  # fmt: skip
    without = set(kind.__abstractmethods__)  # said now, not once all its cases have run
    if kind.tasks is Experiment.tasks and not kind.runs_on_cell():
        without |= {"on_cell and row_of_log, or tasks"}
    if without:
        missing = ", ".join(sorted(without))
        raise TrialError(
            f"kind of experiment {name!r}: {kind.__qualname__} does not define {missing}; repair its package"
        )
    return kind


def kind_of(path: Path) -> str:
    """Return the kind that a plan file names. What is wrong with a file is said by the kind that reads it."""
    try:
        kind = tomllib.loads(path.read_text(encoding="utf-8")).get("kind", _FIRST)
    except (OSError, ValueError):
        return _FIRST
    return kind if isinstance(kind, str) else _FIRST


def plan_folder() -> Path:
    """Return the folder of the user's own plans, a NAME.toml each. Raises ConfigurationError."""
    return user_folder("XDG_CONFIG_HOME", ".config") / "campaigns"


def own_plans() -> dict[str, Path]:
    """Return the user's own plans by name, none without a home; they are checked when they are read."""
    with suppress(ConfigurationError):
        return {path.stem: path for path in sorted(plan_folder().glob("*.toml"))}
    return {}


def keep_plan(name: str, text: str, read: Callable[[Path], Any]) -> Path:
    """Write a plan into the user's folder, as a new file that `read` accepts. Raises ConfigurationError, nothing
    written.
    """
    path = plan_folder() / f"{name}.toml"
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        if path.exists():
            raise ConfigurationError(f"name: there is a plan {name} already, {path}; take another name")
        with replacing(path) as new:
            new.write_text(text, encoding="utf-8")
            try:
                read(new)
            except ConfigurationError as error:
                line = str(error).partition(PARTIAL)[2].lstrip(":0123456789 ") or str(error)
                raise ConfigurationError(line) from None
    except OSError as error:
        raise ConfigurationError(f"{path}: cannot be written: {error.strerror}") from None
    return path


def plan_paths() -> dict[str, Path]:
    """Return the plans that have a name: the user's own, and the installed ones, which no other hides."""
    return own_plans() | installed_plans()


@lru_cache(maxsize=1)
def installed_plans() -> dict[str, Path]:
    """Return the plans of deploy/campaigns, and those of each plug-in.

    A plug-in that cannot be loaded has none, and is named in a line on stderr.
    """
    found = {}
    for name in KINDS.names():
        try:
            found |= kind_named(name).plans()
        except TrialError as error:
            print(f"rtstack: warning: {error}", file=sys.stderr)
    for entry in files("deploy.campaigns").iterdir():
        if entry.name.endswith(".toml"):
            with as_file(entry) as path:
                found[path.stem] = path
    return dict(sorted(found.items()))


def plan_file(name: str) -> PlanFile:
    """Return the plan of a name, or at the path of a .toml. Raises TrialError for an unknown one."""
    if name.endswith(".toml"):
        return plan_file_at(Path(name).resolve())
    path = plan_paths().get(name)
    if name in installed_plans() and (hidden := own_plans().get(name)):
        print(f"rtstack: warning: {name} is an installed plan: give {hidden} another name to run it", file=sys.stderr)
    if path is None:
        raise TrialError(f"unknown campaign {name!r}: there are {', '.join(plan_paths())}, or give the path of a .toml")
    return plan_file_at(path)
