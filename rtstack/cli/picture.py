"""A log's modes and pad forces as a few lines of letters: what `rtstack review` shows in a terminal."""

import numpy as np
from numpy.typing import NDArray

from rtstack.log.mode_spans import mode_spans
from rtstack.log.reader import Log
from rtstack.palette import MODE_STYLES
from rtstack.samples import SIDES

WIDTH = 72  # columns of time
_BARS = " ▁▂▃▄▅▆▇█"
_NS = 1e-9


def picture(log: Log) -> list[str]:
    """Return the lines, each with its largest force; none of a log without samples of both arms."""
    samples = [log.topic(f"/{side}/arm") for side in SIDES]
    if not all(len(records) for records in samples) or log.duration_s <= 0.0:
        return []
    forces = [np.linalg.norm(records["O_F_ext_hat_K"][:, :3], axis=1) for records in samples]
    highest = max(1.0, *(float(force.max()) for force in forces))
    lines = [f"  {'mode':<10} |{_modes(log)}|"]
    for side, records, force in zip(SIDES, samples, forces, strict=True):
        t_s = (records["t_ns"] - log.start_ns) * _NS
        drawn = "".join(_BARS[min(round(8 * value / highest), 8)] for value in _peaks(t_s, force, log.duration_s))
        lines.append(f"  {side + ' pad':<10} |{drawn}| {force.max():.0f} N at most")
    lines.append(f"  {'':<10}  0 s{f'{log.duration_s:.3f} s':>{WIDTH - 3}}")
    return lines


def _peaks(t_s: NDArray[np.float64], values: NDArray[np.float64], end_s: float) -> NDArray[np.float64]:
    """Return the largest value of each column, (WIDTH,)."""
    columns = np.minimum((t_s / end_s * WIDTH).astype(int), WIDTH - 1)
    peaks = np.zeros(WIDTH)
    np.maximum.at(peaks, np.maximum(columns, 0), values)
    return peaks


def _modes(log: Log) -> str:
    """Return the first letter of the mode of each column, and its whole word where there is room."""
    letters = [" "] * WIDTH
    for span in mode_spans(log):
        first, last = (min(round(t_s / log.duration_s * WIDTH), WIDTH) for t_s in (span.start_s, span.end_s))
        word = MODE_STYLES[span.mode].word
        room = max(last, min(first + 1, WIDTH)) - first
        text = f" {word} ".center(room, "-") if room > len(word) + 1 else word[0] * room
        letters[first : first + room] = text[:room]
    return "".join(letters)
