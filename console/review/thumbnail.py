"""A log at a glance: the largest force on both pads over its time, as a small SVG of its own."""

from pathlib import Path

import numpy as np

from console.review.columns import Columns, Index
from rtstack.figures.style import COLOURS
from rtstack.log.signals import signals
from rtstack.samples import SIDES

WIDTH, HEIGHT = 160, 36  # px
_LEAST_N = 5.0  # of the height: noise does not fill the picture


def forces_svg(folder: Path, index: Index) -> str:
    """Return the drawing. Raises ColumnsGone."""
    peaks = [_peaks(folder, index, side) for side in SIDES]
    highest = max(_LEAST_N, *(float(peak.max()) for peak in peaks))
    lines = "".join(
        f'<polyline points="{_points(peak / highest)}" fill="none" stroke="{colour}" stroke-width="1.3"/>'
        for peak, colour in zip(peaks, COLOURS, strict=False)
    )
    size = f'width="{WIDTH}" height="{HEIGHT}" viewBox="0 0 {WIDTH} {HEIGHT}"'
    return f'<svg xmlns="http://www.w3.org/2000/svg" {size}><title>{highest:.0f} N at most</title>{lines}</svg>'


def _peaks(folder: Path, index: Index, side: str) -> np.ndarray:
    """Return the largest force of each pixel, (WIDTH,) N."""
    signal, found = signals()[f"{side}.pad_force"], np.zeros(WIDTH)
    rows = index.rows.get(signal.topic, 0)
    if rows:
        high = np.nan_to_num(Columns(folder, signal.topic, rows).high(signal.column))
        high = np.repeat(high, -(-WIDTH // len(high)))  # a short log has fewer buckets than there are pixels
        np.maximum.at(found, (np.arange(len(high)) * WIDTH / len(high)).astype(int), high)
    return found


def _points(shares: np.ndarray) -> str:
    return " ".join(f"{px},{HEIGHT - 1 - share * (HEIGHT - 3):.1f}" for px, share in enumerate(shares))
