"""Options that several commands have, and the record of a run that is made of options."""

import inspect
from collections.abc import Callable
from dataclasses import fields
from functools import wraps
from pathlib import Path
from typing import Annotated, Any, get_type_hints

import typer

from rtstack.trials.errors import TrialError


def asks_for(kind: type | dict[str, Any], *without: str) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """Decorate a command with the parameter `asked`: the options that were given, by the names of fields of a record.

    A field without an option of the command gets one, of its type and default, in the place of `asked`. without: fields
    that the command line does not ask for. kind: the record, or the annotation of each option, all None by default.
    """
    types = kind if isinstance(kind, dict) else get_type_hints(kind)
    defaults = dict.fromkeys(types) if isinstance(kind, dict) else {each.name: each.default for each in fields(kind)}
    names = {name: default for name, default in defaults.items() if name not in without}

    def decorate(command: Callable[..., None]) -> Callable[..., None]:
        declared = inspect.signature(command).parameters

        def option(name: str, default: Any) -> inspect.Parameter:
            named = Annotated[types[name], typer.Option(f"--{name.replace('_', '-')}")]
            annotation = types[name] if isinstance(kind, dict) else named
            return inspect.Parameter(name, inspect.Parameter.KEYWORD_ONLY, default=default, annotation=annotation)

        @wraps(command)
        def with_record(**values: Any) -> None:
            given = {name: value for name in names if (value := values.get(name)) is not None}
            asked = {name: str(value) if isinstance(value, Path) else value for name, value in given.items()}
            command(**{name: value for name, value in values.items() if name in declared}, asked=asked)

        parameters = []
        for name, parameter in declared.items():
            undeclared = (option(*each) for each in names.items() if each[0] not in declared)
            more = undeclared if name == "asked" else [parameter]
            parameters += [each.replace(kind=inspect.Parameter.KEYWORD_ONLY) for each in more]
        with_record.__signature__ = inspect.Signature(parameters)  # type: ignore[attr-defined]
        return with_record

    return decorate


def check_new(path: Path) -> None:
    """Raise TrialError for a file or folder that exists already, or that is to be made in a folder that does not."""
    if path.exists():
        raise TrialError(f"{path} exists: choose another name, or remove it")
    if not path.parent.is_dir():
        raise TrialError(f"cannot write {path}: the folder {path.parent} does not exist")


Sign = Annotated[
    str | None, typer.Option(metavar="NAME", help="Sign the step of commissioning that this has carried out.")
]
Json = Annotated[bool, typer.Option("--json", help="Print one JSON object on stdout, and nothing else.")]
ObjectName = Annotated[str, typer.Option("--object", help="An object of the cell.")]
CellKind = Annotated[
    str, typer.Option(help="direct, lockstep, realtime, fci:LEFT,RIGHT, or NAME[:ARGUMENT] of another package.")
]
Profile = Annotated[
    str | None,
    typer.Option(metavar="NAME", help="How honest the simulated robot is: ideal (the default), honest or harsh."),
]
ShiftY = Annotated[float, typer.Option("--displacement-mm", help="Shift of the object along y.")]
ShiftX = Annotated[float, typer.Option("--displacement-x-mm", help="Shift of the object along x.")]
Yaw = Annotated[float, typer.Option("--yaw-deg", help="Turn of the object about z.")]
LeftArm = Annotated[str | None, typer.Option(help="Address of the left arm.")]
RightArm = Annotated[str | None, typer.Option(help="Address of the right arm.")]
CellFile = Annotated[Path | None, typer.Option("--cell-file", help="TOML description of the cell and its objects.")]
Seed = Annotated[int, typer.Option(help="Seed of noise, plant and placement.", min=0)]
LogFolder = Annotated[Path, typer.Option("--logs", metavar="DIR", help="The folder of logs.")]
LogsWritten = Annotated[Path, typer.Option("--logs", metavar="DIR", help="Where logs are written.")]
LogOut = Annotated[Path | None, typer.Option("--log", metavar="OUT.mcap", help="The log to write.")]
Faults = Annotated[Path | None, typer.Option("--faults", metavar="FILE", help="TOML script of what goes wrong.")]
