"""`rtstack review` and `rtstack recover`."""

import json as json_module
import sys
from collections.abc import Mapping
from pathlib import Path

import typer

from rtstack.cli.picture import picture
from rtstack.cli.progress import progress_bar
from rtstack.log.errors import LogError
from rtstack.log.reader import read_log
from rtstack.log.recover import recover as recover_log
from rtstack.trials.review import Review, review_log
from rtstack.viewers.rerun_view import missing, show, write_recording


def review(path: Path, json: bool) -> None:
    """Print what is in a log."""
    found = review_log(path)
    if json:
        typer.echo(json_module.dumps(found.as_dict()))
        return
    for line in (*_lines(found), *_pictured(path)):
        typer.echo(line)


def _pictured(path: Path) -> list[str]:
    """Return the picture, where the terminal has letters for it."""
    lines = picture(read_log(path))
    try:
        "".join(lines).encode(sys.stdout.encoding or "ascii")
    except UnicodeEncodeError:
        return []
    return lines


def review_in_rerun(path: Path, rrd: Path | None) -> None:
    """Open a log in Rerun's viewer, or write it to `rrd` for one elsewhere. Raises LogError with one line."""
    if lacking := missing():
        raise LogError(lacking)
    read_log(path)  # says what is wrong with it
    if rrd is None:
        try:
            show(path)
        except RuntimeError as error:
            raise LogError(f"Rerun's viewer does not start: {str(error).splitlines()[0]}; try --rrd OUT.rrd") from None
        return
    if rrd.suffix != ".rrd":
        raise LogError(f"{rrd}: a recording for Rerun ends in .rrd")
    try:
        write_recording(path, rrd)
    except OSError as error:
        raise LogError(f"cannot write {rrd}: {error.strerror}") from None
    typer.echo(f"wrote {rrd}: open it with rerun {rrd}")


_ASKED = ("object", "cell", "git_commit")


def settings(trial: Mapping[str, str]) -> dict[str, str]:
    """Return what a trial's specification says, a line each, from its JSON; nothing where there is none."""
    try:
        specification = json_module.loads(trial.get("specification", "{}"))
    except ValueError:
        return {}
    values = specification.items() if isinstance(specification, dict) else ()
    return {key: value if isinstance(value, str) else json_module.dumps(value) for key, value in values}


def _lines(found: Review) -> list[str]:
    lines = [f"{found.path}: {found.kind}, {found.duration_s:.3f} s"]
    asked = settings(found.trial)
    for name, value in {**asked, **{name: found.trial.get(name, "") for name in _ASKED if name not in asked}}.items():
        if value not in ("", "null", "{}"):
            lines.append(f"  {name:<22} {value}")
    for name in ("success", "failure_reason"):
        if found.recorded.get(name, "null") != "null":
            lines.append(f"  {name:<22} {found.recorded[name]}")
    if not found.recorded and found.kind != "plan":
        lines.append("  result                 none: the trial was cut off before its end")
    if found.fault is not None:
        lines += [f"  fault {name:<16} {value}" for name, value in found.fault.items() if value]
    contacts = ", ".join(
        f"{side} {'none' if t is None else f'{t:.3f} s'}"
        for side, t in zip(("left", "right"), found.first_contact_s, strict=True)
    )
    lines.append(f"  {'first contact':<22} {contacts}")
    if found.score is not None:
        values = found.score
        for name in ("average_force_norm", "average_force_norm_linear_n", "peak_force_norm", "max_lift_mm",
                     "peak_torque_ratio", "peak_velocity_ratio"):  # fmt: skip
            value = getattr(values, name)
            lines.append(f"  {name:<22} {'-' if value is None else f'{value:.3f}'}")
    if found.lateness is not None:
        lines += [f"  {'late cycles':<22} {found.lateness.line}", *(f"    {row}" for row in found.lateness.table)]
    lines.append("  events")
    lines += [f"    {e.t_ns * 1e-9:8.3f} s  {e.level.name:<7} {e.name}: {e.text}" for e in found.events]
    return lines


def recover(path: Path) -> None:
    """Recover a log that was cut off."""
    with progress_bar("recovering", True) as show:
        summary = recover_log(path, progress=(lambda done, total: show(done / total)) if show else None)
    if summary.complete:
        typer.echo(f"{path} is complete: nothing to recover")
        return
    damaged = f"; {summary.damaged} chunks could not be read" if summary.damaged else ""
    typer.echo(
        f"recovered {summary.messages} messages, up to {summary.last_t_ns * 1e-9:.3f} s, to {summary.output}{damaged}"
    )
