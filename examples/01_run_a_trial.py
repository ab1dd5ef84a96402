"""Record the scripted demonstration (`ref.mcap`), then follow it with the box 30 mm from its place (`trial.mcap`).

What `rtstack teach` and `rtstack trial` do, in Python: without a browser, as fast as the machine can.
"""

from pathlib import Path

from rtstack.cells import load_description, open_cell
from rtstack.log.writer import check_log_path
from rtstack.trials.demonstration import run_demonstration
from rtstack.trials.record import open_log
from rtstack.trials.run_context import RunContext
from rtstack.trials.specification import DemonstrationSpecification, TrialSpecification
from rtstack.trials.trial import prepare_trial, run_trial

RECORDING, LOG = Path("ref.mcap"), Path("trial.mcap")
DISPLACEMENT_MM = -30.0  # along the world's y: the right pad meets the box first


def record(path: Path) -> None:
    """Record variation 0 of the scripted demonstration."""
    description, source = load_description(None)  # the cell that comes with rtstack; a path loads your own
    asked = DemonstrationSpecification(object="rice_box")
    cell = open_cell("direct", asked.object, 0.0, asked.seed, description)  # "fci:LEFT,RIGHT": two robots
    try:
        log = open_log(path, asked, description, "direct", source)
        result = run_demonstration(asked, description, cell, RunContext(log))
    finally:
        cell.close()
    print(f"recorded {path}: impact at {result.detected_impact_time_s:.3f} s")


def follow(reference: Path, path: Path) -> None:
    """Follow a recording. Its references are made, and checked, before anything is opened."""
    description, source = load_description(None)
    asked = TrialSpecification(str(reference), "proposed", "rice_box", DISPLACEMENT_MM)
    prepared = prepare_trial(asked, description)
    cell = open_cell("direct", asked.object, DISPLACEMENT_MM * 1e-3, asked.seed, description)
    try:
        log = open_log(path, asked, description, "direct", source, reference=prepared.reference)
        result = run_trial(prepared, cell, RunContext(log))
    finally:
        cell.close()
    outcome = "success" if result.success else f"failed: {result.failure_reason}"
    print(f"{outcome}, {result.max_lift_mm:.0f} mm lifted, mean force norm {result.average_force_norm:.1f}")


if __name__ == "__main__":
    for file in (RECORDING, LOG):
        check_log_path(file)  # a log is never overwritten
    record(RECORDING)
    follow(RECORDING, LOG)
