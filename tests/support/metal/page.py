"""An operator at the console of arms that are served as metal, without a browser: a held clutch."""

import contextlib
import json
import threading
import time
from collections.abc import Iterator

import httpx
import psutil
from websockets.exceptions import WebSocketException

from rtstack.teleoperation.stamp import Sender
from tests.support.console.stack import SoakFailed, Stack
from tests.support.metal.metal import LONGEST_S, Metal

OPERATOR = "operator"
_BEAT_S = 0.05
_ENDED = ("done", "stopped", "failed")


class PageOperator:
    """`rtstack up` on served arms, and a session of an operator."""

    def __init__(self, metal: Metal) -> None:
        arms = ["--left", metal.left, "--right", metal.right, "--cell-file", str(metal.cell_file)]
        self.stack = Stack(metal.folder / "logs", arms)
        self.console = self.stack.members["console"]
        self._over, self._word = threading.Event(), ""

    def begin(self) -> None:
        """Take control, arm, and lead the left arm upwards by a held clutch, in a thread. Raises SoakFailed."""
        threading.Thread(target=self._live, daemon=True).start()
        self.stack.post("take", operator=OPERATOR)
        self.stack.post("arm")
        self.stack.post("jobs/teleoperation", object="rice_box", stop_on_release=True)
        threading.Thread(target=self._hold, daemon=True).start()

    def _hold(self) -> None:
        led, sender = {"clutch": True, "deflection": {"left": [0.0, 0.0, 1.0, 0.0, 0.0, 0.0]}}, Sender()
        with contextlib.suppress(WebSocketException, OSError), self.stack.socket("/api/teleoperation/hand") as hand:
            sender.saw(self.stack.client.get("/api/teleoperation/hand").json())
            while not self._over.wait(_BEAT_S):
                hand.send(json.dumps(sender.stamped(led)))
                sender.saw(json.loads(hand.recv()))

    def _live(self) -> None:
        with contextlib.suppress(httpx.HTTPError), self.stack.beating():
            self._over.wait(LONGEST_S)

    def let_go(self) -> None:
        """Close the page: no clutch and no signs of life any more."""
        self._over.set()

    @contextlib.contextmanager
    def console_frozen(self) -> Iterator[None]:
        """Have the console's process stand still."""
        self.console.suspend()
        try:
            yield
        finally:
            with contextlib.suppress(psutil.NoSuchProcess):
                self.console.resume()

    @property
    def reason(self) -> str:
        """How the job has ended and why, empty while it has not."""
        job = self.stack.client.get("/api/status").raise_for_status().json()["job"] or {}
        return f"{job['state']}: {job['reason']}" if job.get("state") in _ENDED else ""

    def ended(self) -> str:
        """Return why the job has ended, once it has. Raises SoakFailed where it does not."""
        deadline_s = time.monotonic() + 20.0
        while not (reason := self.reason):
            if time.monotonic() > deadline_s:
                raise SoakFailed("the job does not end")
            time.sleep(0.1)
        return reason

    def second(self, path: str) -> str:
        """Have somebody else ask for something; return the answer's status and text."""
        if not self._word:
            self._word = self.stack.post("tokens", name="second", scope="operate")["word"]
        headers = {"authorization": f"Bearer {self._word}"}
        answer = httpx.post(f"{self.stack.base}/api/{path}", json={}, headers=headers, trust_env=False, timeout=60.0)
        return f"{path}: {answer.status_code} {answer.text}"

    def close(self) -> None:
        """End the stack."""
        self._over.set()
        self.stack.end()
