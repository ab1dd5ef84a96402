"""What Desk of each control box says, as far as it may be read without a password; asked every two seconds."""

import threading
from collections.abc import Mapping
from contextlib import closing
from dataclasses import dataclass

from hal.desk import Desk, DeskState, Trust
from hal.errors import HardwareError

_PERIOD_S = 2.0


@dataclass(frozen=True, slots=True)
class DeskView:
    """One box: `ready` for FCI or not, what it says in a line, and what a person has to do there, a line each."""

    side: str
    ready: bool
    line: str
    todo: tuple[str, ...] = ()


class DeskWatch:
    """A thread for each box that has a Desk in the cell's file. `views` is replaced, never changed."""

    def __init__(self, addresses: Mapping[str, str], trust: Trust | None = None) -> None:
        """addresses: of each arm's Desk by its side, "" for one that is not looked at."""
        self._trust = trust or Trust()
        looked_at = {side: address for side, address in addresses.items() if address}
        self._views = {side: DeskView(side, False, "not asked yet") for side in looked_at}
        self._ending = threading.Event()
        for each in looked_at.items():
            threading.Thread(target=self._watch, args=each, daemon=True, name=f"watch Desk, {each[0]}").start()

    @property
    def views(self) -> tuple[DeskView, ...]:
        """The boxes that are looked at, left before right."""
        return tuple(self._views.values())

    def close(self) -> None:
        """End the threads. One that waits for an answer ends after it, by itself."""
        self._ending.set()

    def _watch(self, side: str, address: str) -> None:
        while not self._ending.is_set():
            try:
                with closing(Desk(address, self._trust, name=f"{side} box")) as desk:
                    while not self._ending.is_set():
                        self._views[side] = _view(side, desk.state())
                        self._ending.wait(_PERIOD_S)
            except HardwareError as error:
                self._views[side] = DeskView(side, False, str(error))
            self._ending.wait(_PERIOD_S)


def _view(side: str, state: DeskState) -> DeskView:
    due = "" if state.self_test_s is None else f", self-test in {state.self_test_s / 3600.0:.1f} h"
    line = f"brakes {state.brakes}, FCI {state.fci.lower()}, {state.operating_mode}{due}, system {state.version}"
    held = (f"control is with {state.control}",) if state.control and not state.ready else ()
    return DeskView(side, state.ready, line, (*state.obstacles, *filter(None, [state.warning]), *held))
