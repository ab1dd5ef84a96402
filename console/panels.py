"""The panels of installed packages, each in a process of its own, which alone it can hold up, break or end.

The console imports none of them. It sends the live state, and waits for the answer in a thread of a request, never in
the event loop. A panel's process: python -m console.panels NAME LOGS
"""

import contextlib
import json
import math
import os
import subprocess
import sys
import threading
import time
from collections.abc import Mapping
from dataclasses import dataclass, replace
from multiprocessing.connection import Connection
from pathlib import Path
from socket import socketpair
from typing import TYPE_CHECKING, Any

from console.child_process import end, stand_back, start, within
from console.refused import Refused
from hal.extensions import PLUG_INS_RAISE, ExtensionError, raised
from rtstack.live.panel import PANELS, Panel, PanelView

if TYPE_CHECKING:
    from console.live.watch import Watch

_LOAD_S, _LIMIT_S, _GRACE_S = 20.0, 2.0, 3.0  # for its modules; for one answer; then its process is ended
_RETRY_S = 5.0  # before a process that has ended is started again
_MOST_BYTES = 1 << 20  # of the fragment, and of an answer


@dataclass(frozen=True, slots=True)
class PanelAnswer:
    """title: the panel's, its name until it is loaded; package: its name and version; data: of the newest answer, None
    without one; period_s: when to ask again; error: why there is none, in one line."""

    title: str
    package: str
    data: Any = None
    period_s: float = 1.0
    error: str | None = None


class _Process:
    """One panel. One thread at a time waits for it; others get its newest answer."""

    def __init__(self, name: str, logs: Path) -> None:
        self._name, self._logs = name, logs
        self._lock = threading.Lock()
        self._running: subprocess.Popen[bytes] | None = None
        self._pipe: Connection
        self._due_s = -math.inf
        self.html = ""
        self.newest = PanelAnswer(name, " ".join(PANELS.package(name)))

    def answer(self, view: bytes) -> PanelAnswer:
        """Return its answer to a view, or the newest one where it is not due yet."""
        if self._lock.acquire(blocking=False):
            try:
                if time.monotonic() >= self._due_s:
                    self._ask(view)
                    self._due_s = time.monotonic() + (_RETRY_S if self._running is None else self.newest.period_s / 2)
            finally:
                self._lock.release()
        return self.newest

    def close(self) -> None:
        """End its process."""
        running, self._running = self._running, None
        if running is not None:
            self._pipe.close()
            end(running, 0.0)

    def _ask(self, view: bytes) -> None:
        try:
            if self._running is None and not self._begin():
                return
            pipe = self._pipe
            pipe.send_bytes(view)
            self._take(_heard(pipe, _LIMIT_S))
        except (OSError, EOFError, ValueError):  # it has ended, does not answer, or sends what is no JSON
            self.close()
            reason = f"its process has ended, or did not answer within {_LIMIT_S + _GRACE_S:g} s"
            self._take({"error": f"panel {self._name!r} of {self.newest.package}: {reason}; it is started again"})

    def _begin(self) -> bool:
        """Start its process; return whether the panel could be loaded."""
        ours, theirs = socketpair()
        self._pipe = Connection(ours.detach())
        with theirs:
            command = "console.panels", self._name, str(self._logs)
            self._running = start(*command, stdin=theirs.fileno(), preexec_fn=stand_back)
        loaded = _heard(self._pipe, _LOAD_S)
        self.html = loaded.get("html", "")
        self._take(loaded)
        if "error" in loaded:
            self.close()
        return "error" not in loaded

    def _take(self, told: Mapping[str, Any]) -> None:
        known = {name: told[name] for name in ("title", "period_s") if name in told}
        self.newest = replace(self.newest, **known, data=told.get("data"), error=told.get("error"))


def _heard(pipe: Connection, limit_s: float) -> Mapping[str, Any]:
    if not pipe.poll(limit_s + _GRACE_S):
        raise TimeoutError
    return json.loads(pipe.recv_bytes(2 * _MOST_BYTES))


class Panels:
    """The panels that are offered. May be used from any thread."""

    def __init__(self, logs: Path, watch: "Watch") -> None:
        self._watch = watch
        self._of = {name: _Process(name, logs) for name in PANELS.names()}

    def packages(self) -> dict[str, str]:
        """Return the package of each panel, by the panel's name."""
        return {name: panel.newest.package for name, panel in self._of.items()}

    def html(self, name: str) -> str:
        """Return a panel's fragment, empty until it is loaded. Raises Refused."""
        return self._named(name).html

    def answer(self, name: str) -> PanelAnswer:
        """Return what a panel's function says now; wait for it at most _LOAD_S + _GRACE_S. Raises Refused."""
        return self._named(name).answer(self._watch.document)

    def close(self) -> None:
        """End all of their processes."""
        for panel in self._of.values():
            panel.close()

    def _named(self, name: str) -> _Process:
        if name not in self._of:
            raise Refused(404, f"no installed package offers a panel {name[:80]!r}")
        return self._of[name]


def _answer(panel: Panel, view: PanelView) -> str:
    with within(_LIMIT_S):
        data = panel.data(view)
        try:
            text = json.dumps({"data": data}, allow_nan=False)
        except ValueError as error:
            raise TypeError(f"data: {error}") from None
    if len(text) > _MOST_BYTES:
        raise TypeError(f"data: {len(text) >> 10} KiB are too many, at most {_MOST_BYTES >> 10}")
    return text


def main(name: str, logs: str) -> None:
    """Answer each view that comes by standard input, a socket, until the console closes it."""
    console = Connection(os.dup(0))

    def tell(text: str) -> None:
        console.send_bytes(text.encode())

    try:
        with within(_LOAD_S):
            panel = PANELS.load(name)
        if len(panel.html) > _MOST_BYTES // 4:
            raise ExtensionError(f"panel {name!r}: html is longer than {_MOST_BYTES >> 12} KiB")
    except ExtensionError as error:
        tell(json.dumps({"error": str(error)}))
        return
    tell(json.dumps({"title": panel.title, "html": panel.html, "period_s": panel.period_s}))
    with contextlib.suppress(EOFError, OSError):
        while True:
            view = PanelView(json.loads(console.recv_bytes()), Path(logs))
            try:
                tell(_answer(panel, view))
            except PLUG_INS_RAISE as error:
                tell(json.dumps({"error": f"panel {name!r}: {raised(error, panel.data)}"}))


if __name__ == "__main__":
    main(*sys.argv[1:])
