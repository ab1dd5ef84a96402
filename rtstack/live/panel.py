"""A panel of the console from an installed package: what it shows, and the function that gives it data."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from hal.extensions import ExtensionPoint

LEAST_PERIOD_S = 0.2  # a person reads no number that changes faster


@dataclass(frozen=True, slots=True)
class PanelView:
    """What a panel's function sees: a copy, so that nothing it does to it reaches the console.

    Attributes:
        live: The newest state of the cell, as the stream `/live` sends it, without what is of one session.
        logs: The folder of logs, which `rtstack.log.reader.read_log` reads from.
    """

    live: dict[str, Any]
    logs: Path


@dataclass(frozen=True, slots=True)
class Panel:
    """A panel: HTML in a frame without network, cookies or storage, and one function whose answers are sent to it.

    Args:
        title: Heading of the panel on the page.
        html: Markup, style and script. Each answer of `data` arrives in it as a `message` event, in `event.data`.
        data: Function of a PanelView, called in a process of its own; returns what JSON can express.
        period_s: Time between two calls, s; LEAST_PERIOD_S at least.

    Raises:
        TypeError: An argument is of another type, or the period is too short.
    """

    title: str
    html: str
    data: Callable[[PanelView], Any]
    period_s: float = 1.0

    def __post_init__(self) -> None:
        if not (isinstance(self.title, str) and isinstance(self.html, str) and callable(self.data)):
            raise TypeError("a Panel takes a title and html, both text, and a function data")
        if not self.period_s >= LEAST_PERIOD_S:
            raise TypeError(f"period_s: expected {LEAST_PERIOD_S:g} or more, found {self.period_s!r}")


PANELS = ExtensionPoint("rtstack.panels", "panel", Panel, ours=False)
