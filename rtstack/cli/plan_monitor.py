"""`rtstack plan --watch`: the monitor of a plan, made from runs of the plan itself on the simulated cell.

What is expected is the plan's own (rtstack.references.recording). How far a good run may be from that only runs can
say: sensors, friction, placement (up to SHIFTED_MM along y) and what vibrates after an impact are in no plan.
"""

from contextlib import closing
from pathlib import Path

import numpy as np

from rtstack.cells import open_cell
from rtstack.cli.interrupt import interruptible
from rtstack.cli.monitor import Recorded, split, tuning_toml
from rtstack.cli.progress import progress_bar
from rtstack.loop.watchdogs import Parent
from rtstack.model.cell_description import CellDescription, base_poses
from rtstack.planning import PlanError, PlannedMotion
from rtstack.references.motion import Motion
from rtstack.trials.assembly import cell_parameters
from rtstack.trials.record import RunSamples
from rtstack.trials.run_context import RunContext
from rtstack.trials.specification import TrialSpecification
from rtstack.trials.tightening import limits_of_arms
from rtstack.trials.trial import PreparedTrial, run_trial
from rtstack.trials.tuning import Check, GoodRun, check, tune

SHIFTED_MM = 30.0  # the reference-spreading paper's experiments, and the tunings in deploy/monitor
FIRST_SEED = 10_000  # trials count from 0: they are to be judged by runs that are none of them
SENSITIVITY = 1.5  # as `rtstack tune-monitor` has it by default


def plan_monitor(
    planned: PlannedMotion, name: str, description: CellDescription, runs: int, shown: bool,
    cell_file: Path | None = None,
) -> tuple[str, Check]:  # fmt: skip
    """Run the plan `runs` times, tune on two thirds of the runs, check on the others. Returns the tuning as TOML.

    name: of the plan. Raises PlanError where a run fails, or one that was held out is a false alarm.
    """
    recording = planned.recording
    if recording.motion is not Motion.GRAB:
        raise PlanError(f"--watch: a {recording.motion} is not watched, only what both arms do: leave it out")
    good: list[Recorded] = []
    with progress_bar("runs of the plan", shown) as progress:
        # rolled: the furthest ones come first, and `split` holds back every third
        for k, place_mm in enumerate(np.roll(np.linspace(-SHIFTED_MM, SHIFTED_MM, runs), 1).round(1).tolist()):
            thing, seed = recording.object, FIRST_SEED + k
            asked = TrialSpecification(name, object=thing, displacement_mm=place_mm, seed=seed)
            good.append(Recorded(_run(planned, asked, description, cell_file), thing, name, place_mm, seed))
            progress((k + 1) / runs)
    used, held_out = split(good)
    parameters = tune([record.run for record in used], SENSITIVITY)
    found = check([record.run for record in held_out], parameters)
    if found.false_alarms:
        raise PlanError(
            f"--watch: {len(found.false_alarms)} of {found.runs} runs that were held out would be false alarms: "
            f"tune on more than {runs} runs"
        )
    command = f"rtstack plan --watch {runs}"
    return tuning_toml(parameters, SENSITIVITY, found, used, held_out, command), found


def _run(
    planned: PlannedMotion, specification: TrialSpecification, description: CellDescription, cell_file: Path | None
) -> GoodRun:
    """Run the plan once, on the plant in this process. Raises PlanError where it fails, KeyboardInterrupt."""
    thing, place_mm, seed = specification.object, specification.displacement_mm, specification.seed
    reference, parameters = planned.reference, cell_parameters(description)
    assert reference.impact is not None  # of a grab
    prepared = PreparedTrial(specification, description, parameters, reference, limits_of_arms(description))
    log = RunSamples(Path(specification.reference))
    opened = open_cell("direct", thing, place_mm * 1e-3, seed, description, cell_file=cell_file)
    with closing(opened) as cell, interruptible() as stop:
        result = run_trial(prepared, cell, RunContext(log, stop=stop, watchdogs=(Parent(),)))
    if stop.stop_requested:
        raise KeyboardInterrupt
    if not result.success or log.columns is None:
        raise PlanError(
            f"--watch: the plan fails in simulation with the object at {place_mm:+g} mm (seed {seed}): "
            f"{result.failure_reason}; change the plan"
        )
    return GoodRun(f"{place_mm:+g} mm, seed {seed}", log.columns, reference.impact, base_poses(description))
