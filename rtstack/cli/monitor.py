"""`rtstack tune-monitor`: recorded good runs into the monitor's parameters, with a check on runs that were held out."""

import json as json_module
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Annotated, Any

import typer

from hal.base.configuration import toml_text
from hal.base.files import write_whole
from rtstack.cli.exit_status import FAILED
from rtstack.cli.options import CellFile, Json, check_new
from rtstack.cli.progress import progress_bar
from rtstack.trials.errors import TrialError

if TYPE_CHECKING:
    from rtstack.model.cell_description import CellDescription
    from rtstack.monitor.expected import ExpectedImpact
    from rtstack.monitor.pair import PairParameters
    from rtstack.trials.tuning import Check, GoodRun

commands = typer.Typer()
FEWEST = 6


@commands.command("tune-monitor")
def tune_monitor(
    logs: Annotated[list[Path], typer.Argument(metavar="LOG.mcap...", help="Good runs: trials that succeeded.")],
    out: Annotated[Path, typer.Option(metavar="TOML", help="The parameters to write.")],
    sensitivity: Annotated[
        float, typer.Option(help="How many times the worst good run's deviation is unexpected.", min=1.0, max=10.0)
    ] = 1.3,
    cell_file: CellFile = None,
    json: Json = False,
) -> None:
    """Find the aim-aware monitor's parameters from good runs of one object; a third is held out, and checked."""
    from rtstack.cells import load_description
    from rtstack.trials.monitoring import tuning_folder
    from rtstack.trials.object import check_two_arms
    from rtstack.trials.tuning import check, tune

    if out.parent == tuning_folder():
        out.parent.mkdir(parents=True, exist_ok=True)
    check_new(out)
    if len(logs) < FEWEST:
        raise TrialError(f"{len(logs)} logs are too few to tune on and to check on: give at least {FEWEST}")
    description, _ = load_description(cell_file)
    check_two_arms(description, "a monitor")
    with progress_bar("reading", not json) as progress:
        runs = _good_runs(sorted(logs), description, progress)
    used, held_out = split(runs)
    parameters = tune([record.run for record in used], sensitivity)
    found = check([record.run for record in held_out], parameters)
    write_whole(out, tuning_toml(parameters, sensitivity, found, used, held_out))
    line = (
        f"tuned on {len(used)} runs of {used[0].object}, {out}; of {found.runs} that were held out "
        f"{len(found.false_alarms)} are false alarms, smallest margin {found.smallest_margin:.2f}"
    )
    values = {"out": str(out), "runs": len(used), "held_out": found.runs, "false_alarms": list(found.false_alarms)}
    typer.echo(json_module.dumps(values | {"smallest_margin": found.smallest_margin}) if json else line)
    if found.false_alarms:
        raise typer.Exit(FAILED)


@dataclass(frozen=True, slots=True)
class Recorded:
    """A good run as its log has it. demonstration: name of the recording that it follows."""

    run: "GoodRun"
    object: str
    demonstration: str
    displacement_mm: float
    seed: int


def split(records: Sequence[Recorded]) -> tuple[list[Recorded], list[Recorded]]:
    """Return the runs to tune on and those to check on: every third demonstration, or where there are fewer, run."""
    from rtstack.trials.tuning import HELD_OUT

    demonstrations = sorted({record.demonstration for record in records})
    by_run = len(demonstrations) < HELD_OUT
    used: list[Recorded] = []
    held_out: list[Recorded] = []
    for k, record in enumerate(records):
        place = k if by_run else demonstrations.index(record.demonstration)
        (held_out if place % HELD_OUT == HELD_OUT - 1 else used).append(record)
    return used, held_out


def _good_runs(paths: Sequence[Path], description: "CellDescription", progress) -> list[Recorded]:
    from rtstack.log.reader import read_log
    from rtstack.model.cell_description import base_poses
    from rtstack.references.recording import ReferenceError
    from rtstack.references.source import load_reference
    from rtstack.trials.assembly import arm_controllers, cell_parameters
    from rtstack.trials.followed import followed_file
    from rtstack.trials.review import log_columns
    from rtstack.trials.tuning import GoodRun

    parameters = cell_parameters(description)
    arms = arm_controllers(description, parameters)
    expected: dict[str, ExpectedImpact] = {}
    runs: list[Recorded] = []
    for k, path in enumerate(paths):
        log = read_log(path)
        if log.metadata.get("result", {}).get("success") != "true":
            raise TrialError(f"{path}: not a trial that succeeded: give good runs only")
        specification = json_module.loads(log.metadata["trial"]["specification"])
        thing = str(specification["object"])
        if runs and thing != runs[0].object:
            raise TrialError(f"{path}: a run of {thing}, others are of {runs[0].object}: a tuning is of one object")
        digest, content = followed_file(log, specification["reference"])
        if digest not in expected:
            with TemporaryDirectory() as folder:
                copy = Path(folder) / "reference.mcap"
                copy.write_bytes(content)
                try:
                    impact = load_reference(copy, arms, parameters.detector).impact
                except ReferenceError as error:
                    raise TrialError(f"{path}: its reference: {error}") from None
            if impact is None:
                raise TrialError(f"{path}: it follows a push or an older plan, whose impact is not known")
            expected[digest] = impact
        good = GoodRun(path.name, log_columns(log), expected[digest], base_poses(description))
        name, place = Path(specification["reference"]).stem, float(specification["displacement_mm"])
        runs.append(Recorded(good, thing, name, place, int(specification["seed"])))
        progress((k + 1) / len(paths))
    return runs


def tuning_toml(
    parameters: "PairParameters", sensitivity: float, found: "Check", used: Sequence[Recorded],
    held_out: Sequence[Recorded], command: str = "rtstack tune-monitor",
) -> str:  # fmt: skip
    """Return the file. command: that made it."""
    provenance = {
        "object": used[0].object,
        "sensitivity": sensitivity,
        **_runs("", used),
        **_runs("held_out_", held_out),
        "held_out_false_alarms": len(found.false_alarms),
        "held_out_smallest_margin": round(found.smallest_margin, 3),
    }
    return toml_text(
        {"monitor": asdict(parameters), "provenance": provenance},
        f"The aim-aware monitor for grabs of {used[0].object}, made by `{command}`:",
        "rtstack/monitor/parameters.py says what each number is. Units in the names;",
        "[provenance] says from what it was made and what it does on runs that were held out.",
    )


def _runs(prefix: str, records: Sequence[Recorded]) -> dict[str, Any]:
    return {
        f"{prefix}runs": len(records),
        f"{prefix}demonstrations": sorted({record.demonstration for record in records}),
        f"{prefix}displacements_mm": sorted({record.displacement_mm for record in records}),
        f"{prefix}seeds": sorted(record.seed for record in records),
    }
