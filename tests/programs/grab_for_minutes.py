"""Minutes of ordinary grabbing over the wire, with every controller, displaced boxes and default thresholds.

`python -m tests.programs.grab_for_minutes --minutes 10`: robot's minutes, in lockstep unless --cell says otherwise. Any
reflex of the robot or intervention of the safety judge is a false trip; exit status 1 then. Ctrl-C ends it.
"""

import argparse
import itertools
import sys
from pathlib import Path
from tempfile import TemporaryDirectory

from rtstack.cells import load_description, open_cell
from rtstack.papers.reference_spreading.controllers import Controller
from rtstack.trials.demonstration import run_demonstration
from rtstack.trials.record import open_log
from rtstack.trials.run_context import RunContext
from rtstack.trials.specification import DemonstrationSpecification, TrialSpecification
from rtstack.trials.trial import prepare_trial, run_trial

DISPLACEMENTS_MM = (0.0, -30.0, 30.0, -15.0, 15.0)


def main() -> int:
    """Grab until the robot's minutes are over."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--minutes", type=float, default=10.0)
    parser.add_argument("--cell", default="lockstep")
    options = parser.parse_args()
    description, source = load_description(None)
    kinds = ((n, mm, who) for n in itertools.count(1) for mm in DISPLACEMENTS_MM for who in Controller)
    seconds, trips, successes, runs = 0.0, 0, 0, 0
    with TemporaryDirectory() as folder:
        recording = Path(folder) / "reference.mcap"
        specification = DemonstrationSpecification()
        cell = open_cell("direct", specification.object, 0.0, specification.seed, description)
        log = open_log(recording, specification, description, "direct", source)
        run_demonstration(specification, description, cell, RunContext(log))
        cell.close()
        for seed, displacement_mm, controller in kinds:
            if seconds >= 60.0 * options.minutes:
                break
            trial = TrialSpecification(str(recording), controller, specification.object, displacement_mm, seed)
            prepared = prepare_trial(trial, description)
            cell = open_cell(options.cell, trial.object, 1e-3 * displacement_mm, seed, description)
            try:
                result = run_trial(prepared, cell)
            finally:
                cell.close()
            runs, seconds = runs + 1, seconds + 1e-3 * result.ticks
            successes += result.success
            tripped = "torque control" in (result.failure_reason or "") or result.safety_interventions > 0
            trips += tripped
            if not result.success or tripped:
                print(f"{controller}, {displacement_mm:+g} mm, seed {seed}: {result.failure_reason}")
            print(f"{seconds / 60.0:5.2f} min, {runs} runs, {successes} successes, {trips} trips", end="\r", flush=True)
    print(f"{seconds / 60.0:.2f} min of the robot's time, {runs} runs, {successes} successes, {trips} trips")
    return 1 if trips else 0


if __name__ == "__main__":
    try:
        sys.exit(main())
    except KeyboardInterrupt:
        sys.exit(130)
