"""`rtstack plan`: a reference without a demonstration. Everything is checked before anything is written."""

import json as json_module
from pathlib import Path
from typing import Any

import typer

from rtstack.cells import load_description
from rtstack.log.writer import check_log_path
from rtstack.model.cell_description import CellDescription
from rtstack.planning import PlanError, PlannedMotion, TooFast, grab_plan, plan_grab, plan_push, push_plan
from rtstack.planning.file import write_plan
from rtstack.references.motion import Motion
from rtstack.samples import SIDES

_GRAB_ONLY = ("rise", "squeeze", "lift", "lift_s", "momentum_s", "carry")
_PUSH_ONLY = ("travel",)


def run(
    output: Path, motion: Motion, object_name: str, cell_file: Path | None, json: bool, watch: int | None = None,
    **values: Any,
) -> None:  # fmt: skip
    """Plan a motion and write it to `output`, which must not exist yet. values: of the plan; None for its default.

    watch: how many simulated runs its monitor is made from; None for no monitor.
    """
    description, source = load_description(cell_file)
    check_log_path(output)
    given = {key: value for key, value in values.items() if value is not None}
    foreign = _PUSH_ONLY if motion is Motion.GRAB else _GRAB_ONLY
    for key in foreign:
        if key in given:
            raise PlanError(f"--{key.replace('_', '-')} does not belong to a {motion}: leave it out")
    planned, slower = _planned(description, motion, object_name, given)
    tuning, found = None, None
    if watch is not None:
        from rtstack.cli.plan_monitor import plan_monitor

        tuning, found = plan_monitor(planned, output.stem, description, watch, not json, source)
    write_plan(output, planned, description, source, tuning)
    if json:
        watched = None if found is None else {"runs": watch, "held_out": found.runs, "margin": found.smallest_margin}
        typer.echo(json_module.dumps({**planned.as_dict(), "monitor": watched, "file": str(output)}))
        return
    for line in (*_lines(planned, output), *slower):
        typer.echo(line)
    if found is not None:
        typer.echo(f"  monitor: from {watch} simulated runs, {found.runs} of them held out: no false alarm, smallest "
                   f"margin {found.smallest_margin:.2f}")  # fmt: skip
    file = "" if cell_file is None else f" --cell-file {cell_file}"
    typer.echo(f"  follow it: rtstack trial --reference {output} --object {object_name}{file}")


def _planned(
    description: CellDescription, motion: Motion, object_name: str, given: dict[str, Any]
) -> tuple[PlannedMotion, list[str]]:
    """Return the motion, at the fastest speed that does where the default is too fast for it, and the line that says
    so. A speed that was asked for is never changed."""

    def planned(**values: Any) -> PlannedMotion:
        if motion is Motion.GRAB:
            return plan_grab(description, object_name, grab_plan(**values))
        return plan_push(description, object_name, push_plan(**values))

    try:
        return planned(**given), []
    except TooFast as error:
        if "speed" in given or error.fastest is None:
            raise
        return planned(**given, speed=error.fastest), [f"  slower than by default: {error}"]


def _lines(planned: PlannedMotion, output: Path) -> list[str]:
    recording, result = planned.recording, planned.map
    lines = [f"planned {output}: {recording.motion} of {recording.object}, impact at {recording.impact_s:.3f} s"]
    for arm, side in enumerate(SIDES):
        if side not in result.problem.names:
            continue
        before, after, single = (
            _numbers(twist[:3])
            for twist in (result.twist_before(side), result.twist(side), result.twist(side, result.single_step))
        )
        lines.append(f"  {side:<6} {before} m/s, then {after} (single step {single}), planned "
                     f"{_numbers(planned.velocities[arm])}")  # fmt: skip
    converged = result.converged
    for k, (contact, rows) in enumerate(zip(result.problem.contacts, result.problem.points, strict=True)):
        total, pressing = converged.impulses[rows, 2].sum(), converged.pressing_ns[k]
        held = f"; to be pressed with {pressing:.2g} Ns" if pressing > 0.0 else ""
        lines.append(f"  {' on '.join(contact.between)}: {total:.3f} Ns{held}")
    lines.append(f"  map: {converged.status}, {converged.detail}")
    return lines


def _numbers(values: Any) -> str:
    return " ".join(f"{value:.3f}" for value in values.round(3) + 0.0)  # no -0.000
