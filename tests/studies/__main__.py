"""Runs a study, or goes on with it: `python -m tests.studies NAME --out DIR --resume`, as `rtstack campaign` does.

NAME is a plan in this folder (a .toml of the same name as its module). `--quick` runs two seeds.
"""

import os
from importlib import import_module
from inspect import isabstract
from pathlib import Path
from typing import Annotated

import typer

from rtstack.cli.campaign import _resumable, _run
from rtstack.experiments.experiment import Request
from rtstack.experiments.plan_file import plan_file_at
from rtstack.experiments.store import check_folder
from tests.programs import program
from tests.studies.study import Study

FOLDER = Path(__file__).parent
NAMES = sorted(path.stem for path in FOLDER.glob("*.toml"))


def kind_of(name: str) -> type[Study]:
    """Return the one study of a module."""
    members = vars(import_module(f"tests.studies.{name}")).values()
    (kind,) = (m for m in members if isinstance(m, type) and issubclass(m, Study) and not isabstract(m))
    return kind


def study(
    name: Annotated[str, typer.Argument(help=f"One of {', '.join(NAMES)}.")],
    out: Annotated[Path, typer.Option(help="The folder of results, report and logs.")],
    quick: bool = False,
    workers: int = len(os.sched_getaffinity(0)),
    resume: bool = False,
) -> None:
    """Run a study, or what is missing of it, and write its report."""
    if name not in NAMES:
        raise typer.BadParameter(f"unknown study {name!r}: choose one of {', '.join(NAMES)}")
    path, kind = FOLDER / f"{name}.toml", kind_of(name)
    experiment = kind(kind.read(path, quick), Request(plan_file_at(path), out.resolve()))
    check_folder(experiment, resume)
    with _resumable(f"python -m tests.studies {name} --out {out}{' --quick' * quick} --resume"):
        _run(experiment, workers, None)


if __name__ == "__main__":
    program(study)
