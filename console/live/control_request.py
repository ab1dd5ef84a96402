"""One operator's request for control, which the holder answers. It is a question: the robot process decides."""

import time
from collections.abc import Callable
from dataclasses import dataclass

ANSWER_S = 15.0  # without an answer for so long the pages offer to take over
_LASTS_S = 60.0


@dataclass(frozen=True, slots=True)
class RequestView:
    """operator: who asks; holder: who is asked; kept: the holder answered no; silent: no answer for ANSWER_S."""

    operator: str
    holder: str
    kept: bool = False
    silent: bool = False


class ControlRequest:
    """The newest request. For the event loop and its threads: the view is replaced, never changed."""

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock, self._request, self._since_s = clock, RequestView("", ""), 0.0

    def ask(self, operator: str, holder: str) -> None:
        """Note that an operator asks the holder for control."""
        self._request, self._since_s = RequestView(operator, holder), self._clock()

    def keep(self, holder: str) -> RequestView:
        """Note that the holder keeps control; return the request."""
        if self._request.holder == holder:
            self._request = RequestView(self._request.operator, holder, kept=True)
        return self._request

    def view(self, holder: str | None) -> RequestView | None:
        """Return the request to the one who has control now, None where there is none."""
        request, age_s = self._request, self._clock() - self._since_s
        if not holder or request.holder != holder or age_s > _LASTS_S:
            return None
        silent = not request.kept and age_s > ANSWER_S
        return RequestView(request.operator, holder, request.kept, silent)
