"""`rtstack teach` and `rtstack trial`: everything is checked before the cell is opened and the log is begun."""

import sys
from dataclasses import replace
from pathlib import Path

import typer

from hal.cell import Cell
from hal.displacement import Displacement
from rtstack.cells import load_description, open_cell
from rtstack.cli.hold_to_run import HoldToRun
from rtstack.cli.interrupt import interruptible
from rtstack.cli.progress import progress_bar
from rtstack.log.writer import check_log_path
from rtstack.loop.watchdogs import Parent
from rtstack.trials.demonstration import run_demonstration
from rtstack.trials.estimate import check_estimate
from rtstack.trials.followed import Followed
from rtstack.trials.monitoring import load_tuning
from rtstack.trials.object import check_object, object_of
from rtstack.trials.record import open_log
from rtstack.trials.result import DemonstrationResult, TrialResult
from rtstack.trials.run_context import RunContext
from rtstack.trials.specification import DemonstrationSpecification, TrialSpecification
from rtstack.trials.start_motion import start_motion
from rtstack.trials.tightening import load_tightening
from rtstack.trials.trial import prepare_trial, run_trial

FAILED = 1


def teach(
    output: Path, specification: DemonstrationSpecification, cell_kind: str, cell_file: Path | None, json: bool
) -> None:
    """Record a demonstration to `output`, which must not exist yet."""
    description, source = load_description(cell_file)
    object_name, seed = specification.object, specification.seed
    check_object(object_name, description)
    check_log_path(output)
    hold = HoldToRun(cell_kind, description, source)
    cell = open_cell(cell_kind, object_name, 0.0, seed, description, cell_file=source)
    _warn(cell)
    try:
        way = start_motion(cell, description, object_name)
        with (
            interruptible() as stop,
            hold.held(f"demonstration of {object_name}", stop) as held,
            progress_bar("demonstration", not json and not cell.own_clocks) as progress,
        ):
            log = open_log(output, specification, description, cell_kind, source, cell=cell)
            context = RunContext(log, stop=stop, progress=progress, watchdogs=(Parent(), *held))
            result = run_demonstration(specification, description, cell, context, way=way)
    finally:
        cell.close()
    _report(result, json, _demonstration_line(result))


def trial(
    asked: TrialSpecification, log_path: Path | None, cell_kind: str, cell_file: Path | None, json: bool, *,
    safety: Path | None = None, friction: Path | None = None, monitor: Path | None = None,
    faults: Path | None = None, whole_reference: bool = False,
) -> None:  # fmt: skip
    """Run a trial; without an object it is what the reference is about. Without `log_path` nothing is written.

    safety: limits to tighten. friction: the arms', instead of what the cell's file names. monitor: its parameters, by
    default those of the object. faults: what goes wrong in a simulated cell. whole_reference: attach the reference's
    file to the log, which else only names it.
    """
    description, source = load_description(cell_file)
    if friction is not None:
        description = replace(description, joint_friction=friction)
    reference = Path(asked.reference)
    object_name = asked.object or object_of(reference)
    tightening = load_tightening(safety) if safety is not None else ()
    specification = replace(asked, object=object_name, safety=tightening)
    if log_path is not None:
        check_log_path(log_path)
    check_object(object_name, description)
    tuning = load_tuning(monitor).monitor if monitor is not None else None
    prepared = prepare_trial(specification, description, monitor=tuning)
    specification = prepared.specification
    if prepared.unwatched is not None:
        print(f"rtstack: not watched: {prepared.unwatched}", file=sys.stderr)
    displacement = specification.displacement
    hold = HoldToRun(cell_kind, description, source)
    cell = open_cell(cell_kind, object_name, displacement, asked.seed, description, faults, cell_file=source)
    _warn(cell)
    try:
        bias = check_estimate(cell, description, prepared.parameters.detector)
        if bias:
            print(f"rtstack: warning: {bias}", file=sys.stderr)
        way = start_motion(cell, description, object_name, displacement, prepared.reference.ante[:, 0])
        with (
            interruptible() as stop,
            hold.held(f"trial of {object_name}", stop) as held,
            progress_bar(f"trial, {asked.controller}", not json and not cell.own_clocks) as progress,
        ):
            log = None
            if log_path is not None:
                log = open_log(
                    log_path, specification, description, cell_kind, source, reference=prepared.reference,
                    followed=Followed(reference, whole_reference), cell=cell,
                )  # fmt: skip
            context = RunContext(log, stop=stop, progress=progress, watchdogs=(Parent(), *held))
            result = run_trial(prepared, cell, context, way=way)
    finally:
        cell.close()
    _report(result, json, _trial_line(result))


def _warn(cell: Cell) -> None:
    if cell.warning:
        print(f"rtstack: warning: {cell.warning}", file=sys.stderr)


def _report(result: TrialResult | DemonstrationResult, json: bool, line: str) -> None:
    typer.echo(result.as_json() if json else line)
    if not result.success:
        raise typer.Exit(FAILED)


def _demonstration_line(result: DemonstrationResult) -> str:
    if not result.success:
        return f"demonstration failed: {result.failure_reason}"
    lift = "the object was never seen" if result.max_lift_mm is None else f"lifted {result.max_lift_mm:.0f} mm"
    return (
        f"recorded {result.log}: {result.object}, variation {result.variation}, impact at "
        f"{result.detected_impact_time_s:.3f} s, {lift}"
    )


def _trial_line(result: TrialResult) -> str:
    outcome = "success" if result.success else f"failed: {result.failure_reason}"
    detected = result.detected_impact_time_s
    impact = "none" if detected is None else f"{detected:.3f} s"
    verdict = result.impact_verdict or "not watched"
    if result.impact_kind is not None:
        verdict += f" ({result.impact_kind}: {(result.impact_reason or '').replace('_', ' ')})"
    lift = "not observed" if result.max_lift_mm is None else f"{result.max_lift_mm:.0f} mm"
    shift = Displacement.given(result.displacement_mm, result.displacement_x_mm, result.yaw_deg)
    norm = "-" if result.average_force_norm is None else f"{result.average_force_norm:.1f}"
    return (
        f"{outcome} | {result.controller}, {result.object}, {shift.in_words}, seed {result.seed} | "
        f"impact {impact} (nominal {result.nominal_impact_time_s:.3f} s), {verdict} | mean force norm {norm} | "
        f"lift {lift} | compute p50 {result.compute_us_p50:.0f} us | {result.real_time_factor:.1f} x real time"
    )
