"""`rtstack commission`: which steps of a cell's commissioning are signed, what is next, and a step that a log shows."""

import json as json_module
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import numpy as np
import typer

from rtstack.cli.exit_status import fail
from rtstack.cli.options import CellFile, Json, Sign
from rtstack.trials.errors import TrialError

if TYPE_CHECKING:
    from rtstack.model.cell_description import CellDescription

commands = typer.Typer()
MOVED_M = 0.05  # ours: with each pad, so that a wrong base or payload is seen
PRESSED_N = (10.0, 65.0)  # ours: felt clearly, and what the capped robots stop at


@commands.command()
def commission(
    step: Annotated[
        Literal["motion", "foam", "object"] | None,
        typer.Argument(help="A step that a log shows; the others are signed by their own commands."),
    ] = None,
    log: Annotated[Path | None, typer.Option(metavar="LOG.mcap", help="The run that shows the step.")] = None,
    cell_file: CellFile = None,
    sign: Sign = None,
    json: Json = False,
) -> None:
    """Show which steps of commissioning are signed, and which one is next. With --log sign one that a log shows."""
    from rtstack.cells import load_description
    from rtstack.cells.commissioning import Commissioning, states
    from rtstack.cells.commissioning import sign as sign_step
    from rtstack.cli.tables import print_table

    description, file = load_description(cell_file)
    if description.simulated:
        raise TrialError(f"{file}: only a cell of real arms is commissioned, and this one says simulated = true")
    if step is not None:
        if log is None or sign is None:
            raise TrialError(f"step {step}: name the log that shows it (--log), and who signs it (--sign NAME)")
        before = next(each for each in states(description, file) if not each.done or each.step.name == step)
        if before.step.name != step:
            raise TrialError(f"step {step} comes after {before.step.name}: {before.step.command}")
        sign_step(step, sign, _shown(step, log, description, file), description, file, log=log.name)
    found = Commissioning(states(description, file))
    if json:
        rows = [
            {"step": each.step.name, "done": each.done, "changed": each.changed, "command": each.step.command}
            | ({} if each.signature is None else {"by": each.signature.by, "at": each.signature.at.isoformat(),
                                                  "values": each.signature.values, "log": each.signature.log})
            for each in found.states
        ]  # fmt: skip
        typer.echo(json_module.dumps({"steps": rows, "line": found.line}))
        return
    rows, name, line = [], description.name, found.line
    for each in found.states:
        signed = "" if each.signature is None else f"{each.signature.by}, {each.signature.at:%Y-%m-%d %H:%M} UTC"
        state = "signed" if each.done else f"open: changed {', '.join(each.changed)}" if each.changed else "open"
        rows.append((each.step.name, each.step.what, state, signed))
    print_table(("step", "what", "state", "signed by"), rows, "")
    typer.echo(f"{name} is {line}" if line else f"{name}: commissioning is complete, and nothing is capped")


def _shown(step: str, path: Path, description: "CellDescription", file: Path) -> dict[str, float | str]:
    """Return the measured values of a step by its log. Raises TrialError, LogError; exits where it does not show it."""
    from importlib.metadata import version

    from rtstack.cells.kinds import profile_of
    from rtstack.log.reader import read_log

    log = read_log(path)
    trial, result = log.metadata.get("trial", {}), log.metadata.get("result", {})
    if profile_of(trial.get("cell", "")):
        raise TrialError(f"{path}: it was made in simulation, on {trial['cell']}")
    if log.attachment("cell.toml") != file.read_bytes():
        raise TrialError(f"{path}: it was made with another state of {file.name}: repeat the run")
    if json_module.loads(trial.get("versions", "{}")).get("rtstack") != version("rtstack"):
        raise TrialError(f"{path}: it was made with another version of rtstack: repeat the run")
    if log.sides != description.sides:
        raise TrialError(f"{path}: it has the {' and '.join(log.sides)} arm alone")
    values: dict[str, float | str] = {"kind": trial.get("kind", "")}
    for side in log.sides:
        arm = log.topic(f"/{side}/arm")
        place, force = arm["O_T_EE"][:, :3, 3], np.linalg.norm(arm["O_F_ext_hat_K"][:, :3], axis=1).max()
        moved = np.linalg.norm(place - place[0], axis=1).max()
        values |= {f"{side}_force_n": round(float(force), 1), f"{side}_moved_m": round(float(moved), 4)}
        values[f"{side}_speed_m_s"] = round(float(np.linalg.norm(np.gradient(place, 1e-3, axis=0), axis=1).max()), 3)
        if step == "motion" and not moved >= MOVED_M:
            fail(f"not signed: the {side} pad moved {1e3 * moved:.0f} mm, and {1e3 * MOVED_M:.0f} mm are to be seen")
        if step == "foam" and not PRESSED_N[0] <= force <= PRESSED_N[1]:
            wanted = f"{PRESSED_N[0]:.0f} to {PRESSED_N[1]:.0f} N are to be seen"
            fail(f"not signed: the {side} pad pressed with {force:.0f} N at most, and {wanted}")
    if step != "foam" and result.get("success") != "true":
        fail(f"not signed: the run was no success: {result.get('failure_reason', 'it has no result')}")
    if step == "object" and result.get("detected_impact_time_s", "null") == "null":
        fail("not signed: no impact was detected in this run")
    return values
