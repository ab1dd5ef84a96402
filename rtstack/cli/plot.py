"""`rtstack plot`: curves of logs as a figure, in the papers' style, or as a page for a browser."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import typer

from rtstack.cli.animation import animate
from rtstack.cli.logs import settings
from rtstack.cli.progress import progress_bar
from rtstack.figures.log_data import figure_log, with_references
from rtstack.figures.log_figure import MOST_LOGS, FigureLog, aligned, draw
from rtstack.figures.style import FORMATS, save
from rtstack.figures.web_page import web_page
from rtstack.log.errors import LogError
from rtstack.log.reader import read_log
from rtstack.log.signals import DEFAULT, matching, signals

KINDS = (*FORMATS, "html", "webp")
_AROUND_S = (0.2, 0.3)  # before and after the first impact: the papers' figures
_FACTS = ("kind", "object", "controller", "displacement_mm", "seed", "success", "failure_reason", "impact_verdict",
          "average_force_norm", "peak_force_norm", "max_lift_mm", "cell", "git_commit")  # fmt: skip


def plot(
    words: Sequence[str], kind: str | None, output: Path | None, start_s: float | None = None,
    end_s: float | None = None, impact: bool = False, reference: bool = False, together: bool = True,
) -> None:  # fmt: skip
    """Draw what `words` name, logs and signals in any order, and say where. Raises LogError with one line."""
    paths = [Path(word) for word in words if word.endswith(".mcap") or Path(word).is_file()]
    if not paths:
        raise LogError(f"{words[0]}: no log among them; give one, and signals after it")
    if len(paths) > MOST_LOGS:
        raise LogError(f"{len(paths)} logs are too many in one figure, at most {MOST_LOGS}")
    named = [word for word in words if Path(word) not in paths]
    wanted = matching(named) if named else [signals()[name] for name in DEFAULT]
    if reference:
        wanted = with_references(wanted)
    target = _target(paths[0], kind, output)
    logs: list[FigureLog] = []
    with progress_bar("reading", True) as show:
        for number, path in enumerate(paths):
            if show is not None:
                show(number / len(paths))
            logs.append(figure_log(path, wanted))
    if together:
        logs = aligned(logs)
    first, last = _window(logs[0], start_s, end_s, impact)
    if target.suffix == ".webp":
        animate(paths[0], target, first, last)
        typer.echo(f"wrote {target}")
        return
    title = ", ".join(path.name for path in paths)
    figure = draw(logs, first, last, title)
    try:
        if target.suffix == ".html":
            target.write_text(web_page(figure, logs, title, _facts(paths[0])))
        else:
            save(figure, target)
    except OSError as error:
        raise LogError(f"cannot write {target}: {error.strerror}") from None
    typer.echo(f"wrote {target}")


def _target(log: Path, kind: str | None, output: Path | None) -> Path:
    """Return where the figure goes. Raises LogError for what is none."""
    if output is None:
        return Path(f"{log.stem}.{kind or 'png'}")
    suffix = output.suffix.removeprefix(".")
    if suffix not in KINDS:
        raise LogError(f"{output}: a figure ends in {', '.join('.' + one for one in KINDS)}")
    if kind not in (None, suffix):
        raise LogError(f"--{kind} and {output} say different things: give one of them")
    return output


def _window(log: FigureLog, start_s: float | None, end_s: float | None, impact: bool) -> tuple[float, float]:
    ends = [float(trace.t_s[-1]) for trace in log.traces if len(trace.t_s)]
    if not ends:
        raise LogError(f"{log.name}: it has no samples of these signals")
    first, last = 0.0, max(ends)
    if impact:
        if not log.impacts:
            raise LogError(f"{log.name}: there was no impact in it; give --from and --to")
        hit_s = min(t_s for t_s, _ in log.impacts)
        first, last = max(first, hit_s - _AROUND_S[0]), min(last, hit_s + _AROUND_S[1])
    first, last = first if start_s is None else start_s, last if end_s is None else end_s
    if not first < last:
        raise LogError(f"--from {first:g} has to be before --to {last:g}")
    return first, last


def _facts(path: Path) -> Mapping[str, str]:
    """Return what the page's table says of a log: what was asked, and what came out."""
    log = read_log(path)
    trial = log.metadata.get("trial", {})
    known = {**trial, **settings(trial), **log.metadata.get("result", {})}
    return {name.replace("_", " "): known[name] for name in _FACTS if name in known}
