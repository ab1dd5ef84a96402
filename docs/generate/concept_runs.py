"""The runs that the figures of the concepts are drawn from: a demonstration and three trials, in the direct cell."""

from pathlib import Path

from rtstack.cells import load_description, open_cell
from rtstack.log.reader import Log, read_log
from rtstack.trials.demonstration import run_demonstration
from rtstack.trials.record import open_log
from rtstack.trials.run_context import RunContext
from rtstack.trials.specification import DemonstrationSpecification, TrialSpecification
from rtstack.trials.trial import prepare_trial, run_trial


def demonstrate(path: Path) -> None:
    """Record the plain scripted demonstration at `path`."""
    description, source = load_description(None)
    asked = DemonstrationSpecification()
    cell = open_cell("direct", asked.object, 0.0, asked.seed, description)
    try:
        run_demonstration(asked, description, cell, RunContext(open_log(path, asked, description, "direct", source)))
    finally:
        cell.close()


def follow(reference: Path, controller: str, object_name: str, displacement_mm: float) -> Log:
    """Return the log of a trial, seed 0, which is written beside its reference."""
    description, source = load_description(None)
    asked = TrialSpecification(str(reference), controller, object_name, displacement_mm)
    prepared = prepare_trial(asked, description)
    path = reference.with_name(f"{controller}-{object_name}-{displacement_mm:g}.mcap")
    cell = open_cell("direct", object_name, displacement_mm * 1e-3, asked.seed, description)
    try:
        log = open_log(path, asked, description, "direct", source, reference=prepared.reference)
        run_trial(prepared, cell, RunContext(log))
    finally:
        cell.close()
    return read_log(path)
