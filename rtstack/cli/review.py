"""`rtstack review`: what is in a log, as text with a small picture of the forces, or in another viewer."""

import json as json_module
import sys
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import numpy as np
import typer
from numpy.typing import NDArray

from rtstack.cli.options import Json
from rtstack.cli.plot import plot as draw
from rtstack.cli.plot import settings
from rtstack.log.errors import LogError

if TYPE_CHECKING:
    from rtstack.log.analysis.offered import Analysed
    from rtstack.log.reader import Log
    from rtstack.trials.review import Review

commands = typer.Typer()
WIDTH = 72  # columns of time
_BARS = " ▁▂▃▄▅▆▇█"
_NS = 1e-9
_ASKED = ("object", "cell", "git_commit")


@commands.command()
def review(
    log: Annotated[Path, typer.Argument(metavar="LOG.mcap")],
    json: Json = False,
    rerun: Annotated[bool, typer.Option("--rerun", help="Open it in Rerun's viewer instead.")] = False,
    rrd: Annotated[
        Path | None, typer.Option(metavar="OUT.rrd", help="Write it for Rerun instead, to be opened elsewhere.")
    ] = None,
    plot: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Write a figure instead, as `rtstack plot` does.")
    ] = None,
) -> None:
    """Say what is in a log: result, events, impacts, recomputed from its samples, and a small picture of the forces."""
    from rtstack.log.analysis.offered import analysed
    from rtstack.log.reader import read_log
    from rtstack.trials.review import review_log

    if plot is not None:
        draw([str(log)], output=plot)
        return
    if rerun or rrd is not None:
        _review_in_rerun(log, rrd)
        return
    found = review_log(log)
    analyses = [said for said, _ in analysed(read_log(log))]
    if json:
        typer.echo(json_module.dumps({**found.as_dict(), "analyses": [asdict(said) for said in analyses]}))
        return
    typer.echo("\n".join([*_lines(found), *_analysis_lines(analyses)]))
    pictured = picture(read_log(log))
    with suppress(UnicodeEncodeError):  # a terminal that has no letters for it
        "".join(pictured).encode(sys.stdout.encoding or "ascii")
        typer.echo("\n".join(pictured), nl=bool(pictured))


def picture(log: "Log") -> list[str]:
    """Return the lines, each with its largest force; none of a log without samples of an arm."""
    samples = [log.topic(f"/{side}/arm") for side in log.sides]
    if not all(len(records) for records in samples) or log.duration_s <= 0.0:
        return []
    forces = [np.linalg.norm(records["O_F_ext_hat_K"][:, :3], axis=1) for records in samples]
    highest = max(1.0, *(float(force.max()) for force in forces))
    lines = [f"  {'mode':<10} |{_modes(log)}|"]
    for side, records, force in zip(log.sides, samples, forces, strict=True):
        t_s = (records["t_ns"] - log.start_ns) * _NS
        drawn = "".join(_BARS[min(round(8 * value / highest), 8)] for value in _peaks(t_s, force, log.duration_s))
        lines.append(f"  {side + ' pad':<10} |{drawn}| {force.max():.0f} N at most")
    lines.append(f"  {'':<10}  0 s{f'{log.duration_s:.3f} s':>{WIDTH - 3}}")
    return lines


def _peaks(t_s: NDArray[np.float64], values: NDArray[np.float64], end_s: float) -> NDArray[np.float64]:
    """Return the largest value of each column, (WIDTH,)."""
    peaks = np.zeros(WIDTH)
    np.maximum.at(peaks, (t_s / end_s * WIDTH).astype(int).clip(0, WIDTH - 1), values)
    return peaks


def _modes(log: "Log") -> str:
    """Return the first letter of the mode of each column, and its whole word where there is room."""
    from rtstack.log.analysis.mode_spans import mode_spans
    from rtstack.palette import MODE_STYLES

    letters = [" "] * WIDTH
    for span in mode_spans(log):
        first, last = (min(round(t_s / log.duration_s * WIDTH), WIDTH) for t_s in (span.start_s, span.end_s))
        word = MODE_STYLES[span.mode].word
        room = max(last, min(first + 1, WIDTH)) - first
        text = f" {word} ".center(room, "-") if room > len(word) + 1 else word[0] * room
        letters[first : first + room] = text[:room]
    return "".join(letters)


def _review_in_rerun(path: Path, rrd: Path | None) -> None:
    """Open a log in Rerun's viewer, or write it to `rrd` for one elsewhere. Raises LogError with one line."""
    from rtstack.log.reader import read_log
    from rtstack.viewers.rerun_view import missing, show, write_recording

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


def _when(found: "Review") -> str:
    """Return when a log begins, UTC, and how sure that is."""
    time = found.time
    if time is None:
        return "at an unknown time of day: the log is of an older version, or has no tick"
    words = [f"{found.utc(found.start_ns)} +- {1e3 * time.uncertainty_s:.1f} ms"]
    words += ["the robot's time is simulated"] * time.simulated
    words += ["the host's clock was not synchronised"] * (time.synchronised is False)
    words += [f"the host's clock was set by {time.set_s:+.3f} s during the run"] * (time.set_s != 0.0)
    return "; ".join(words)


def _analysis_lines(analyses: "Sequence[Analysed]") -> Iterator[str]:
    for said in analyses:
        yield f"  {said.name} of {said.package}" if said.error is None else f"  {said.error}"
        for number in said.numbers:
            value = "-" if number.value is None else f"{number.value:.4g} {number.unit}".rstrip()
            yield f"    {number.name:<20} {value}"


def _lines(found: "Review") -> list[str]:
    lines = [f"{found.path}: {found.kind}, {found.duration_s:.3f} s"]
    lines += [f"  {'recorded':<22} {_when(found)}"] * (found.kind != "plan")
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
        for side, t in zip(found.sides, found.first_contact_s, strict=True)
    )
    lines.append(f"  {'first contact':<22} {contacts}")
    if found.score is not None:
        for name in ("average_force_norm", "average_force_norm_linear_n", "peak_force_norm", "max_lift_mm",
                     "peak_torque_ratio", "peak_velocity_ratio"):  # fmt: skip
            value = getattr(found.score, name)
            lines.append(f"  {name:<22} {'-' if value is None else f'{value:.3f}'}")
    if found.lateness is not None:
        lines += [f"  {'late cycles':<22} {found.lateness.line}", *(f"    {row}" for row in found.lateness.table)]
    lines.append("  events")
    lines += [f"    {e.t_ns * 1e-9:8.3f} s  {e.level.name:<7} {e.name}: {e.text}" for e in found.events]
    return lines
