"""The figure of logs, for a notebook."""

from collections.abc import Sequence
from pathlib import Path

from matplotlib.figure import Figure

from rtstack.figures.log_data import figure_log, window
from rtstack.figures.log_figure import aligned, draw
from rtstack.log.analysis.signals import DEFAULT, matching
from rtstack.log.errors import LogError
from rtstack.trials.result import Result


def plot(*logs: Result | Path | str, show: Sequence[str] = DEFAULT, impact: bool = False) -> Figure:
    """Draw curves of a log, or of several over each other with their first impacts at one time, as `rtstack plot` does.

    Args:
        logs: Results that have a log, or paths of logs; five at most.
        show: Names of signals, or parts of names, such as left.tau_J, pad_force, tau_J.4.
        impact: From 0.2 s before to 0.3 s after the first impact, not all of the log.

    Returns:
        A figure that a notebook shows; `savefig` writes it.

    Raises:
        LogError: In one line, for a log that is not there or has no such samples.
    """
    paths = [getattr(log, "log", None) if isinstance(log, Result) else log for log in logs]
    if not paths or None in paths:
        raise LogError("no log to draw: give log_folder to run_trials, or a result that has a log")
    drawn = aligned([figure_log(Path(str(path)), matching(show)) for path in paths])
    return draw(drawn, *window(drawn[0], None, None, impact), ", ".join(log.name for log in drawn))
