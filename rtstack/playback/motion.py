"""The motion in a log: where both arms' joints were, as smooth functions of the log's time.

What was measured has noise, and jumps in velocity where something was hit. A least-squares spline of the fifth degree
has neither, and gives velocity and acceleration without differences.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import BSpline, make_lsq_spline

from hal.arrays import Array
from rtstack.log.errors import LogError
from rtstack.log.reader import Log, read_log
from rtstack.references.recording import LARGEST_GAP_NS
from rtstack.samples import SIDES, Mode
from rtstack.trials.errors import TrialError

DEGREE = 5
KNOT_S = 0.06  # between two knots: what hands do is slower, and what an impact shakes is not played again
SHORTEST_S, LONGEST_S = 0.5, 120.0  # the second: 200 MB of points, a minute of preparing


@dataclass(frozen=True, slots=True)
class LoggedMotion:
    """What was played: joints of the left and the right arm over duration_s, with two derivatives.

    object: what the log says was there. deviation_rad: largest distance of a measured joint from the curve.
    """

    path: Path
    object: str
    duration_s: float
    curves: tuple[BSpline, BSpline]
    deviation_rad: float

    def joints(self, side: int, t_s: NDArray[np.floating], derivative: int = 0) -> Array:
        """Return the joints (n, 7) of an arm, rad, or their first or second derivative, at times since the start."""
        return self.curves[side](t_s, derivative)


def load_motion(path: Path) -> LoggedMotion:
    """Read the motion of a recording or any other log. Raises TrialError with one line."""
    try:
        log = read_log(path)
        samples = [log.topic(f"/{side}/arm") for side in SIDES]
    except LogError as error:
        raise TrialError(str(error)) from None
    if min(len(records) for records in samples) < 2:
        raise TrialError(f"{path}: it has no samples of both arms: there is nothing to play")
    first_ns = max(int(records["t_ns"][0]) for records in samples)
    last_ns = min(_end_ns(log, side, records) for side, records in zip(SIDES, samples, strict=True))
    duration_s = (last_ns - first_ns) * 1e-9
    if not SHORTEST_S <= duration_s <= LONGEST_S:
        raise TrialError(
            f"{path}: its motion lasts {duration_s:.1f} s; what is played on the arms has {SHORTEST_S:g} to "
            f"{LONGEST_S:g} s"
        )
    fitted = [_fit(path, records, first_ns, last_ns) for records in samples]
    name = log.metadata.get("trial", {}).get("object", "")
    return LoggedMotion(path, name, duration_s, (fitted[0][0], fitted[1][0]), max(far for _, far in fitted))


def _end_ns(log: Log, side: str, records: NDArray) -> int:
    """Return when the motion ended: with the last sample, or where a controlled stop cut it short."""
    control = log.topic(f"/{side}/control")
    stopping = control["t_ns"][control["mode"] == Mode.STOPPING]
    return int(min(records["t_ns"][-1], stopping[0] if len(stopping) else records["t_ns"][-1]))


def _fit(path: Path, records: NDArray, first_ns: int, last_ns: int) -> tuple[BSpline, float]:
    within = records[(records["t_ns"] >= first_ns) & (records["t_ns"] <= last_ns)]
    t_ns, kept = np.unique(within["t_ns"], return_index=True)
    gap_ns = int(np.max(np.diff(t_ns), initial=0))
    q = within["q"][kept]
    if gap_ns > LARGEST_GAP_NS:
        raise TrialError(f"{path}: {gap_ns * 1e-6:.0f} ms of the motion are missing: it cannot be played on the arms")
    if not np.isfinite(q).all():
        raise TrialError(f"{path}: some of its joint positions are no numbers: it cannot be played on the arms")
    t_s = (t_ns - first_ns) * 1e-9
    inner = np.linspace(t_s[0], t_s[-1], max(2, round(t_s[-1] / KNOT_S) + 1))
    knots = np.concatenate([np.full(DEGREE, inner[0]), inner, np.full(DEGREE, inner[-1])])
    curve = make_lsq_spline(t_s, q, knots, DEGREE)
    return curve, float(np.abs(curve(t_s) - q).max())
