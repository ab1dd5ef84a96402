"""One box as its Desk knows it: who has control, what its brakes do, whether FCI is let in, when the self-test is due.

Of the codes of refusals BrakesClosed, EmergencyStopPressed and Timeout are the vendor's; the others are guesses, as is
that FCI stays as it is when control is given back, and ends when a self-test is overdue.
"""

import secrets
import threading
import time
from dataclasses import dataclass
from typing import Any

import numpy as np

SELF_TEST_EVERY_S = 86_400.0  # franky's manual: a safety self-test every 24 h
SELF_TEST_WARNING_S = 3_600.0  # ours: from when the box says Warning
_LONGEST_WAIT_S = 300.0
_BRAKES_S, _SELF_TEST_S = 0.2, 1.0  # ours: on a real box seconds, and some minutes
JOINTS = 7


class Refused(Exception):
    """A request that is not carried out: HTTP status, the interface's code, and details."""

    def __init__(self, status: int, code: str, message: str, details: tuple[str, ...] = ()) -> None:
        super().__init__(message)
        self.status, self.code, self.details = status, code, details


@dataclass(frozen=True, slots=True)
class _Control:
    owner: str
    token: str
    number: int


class DeskBox:
    """The state behind the interface. Every method may be called from any thread. flags: FLAGS of this box."""

    def __init__(self, flags: np.void, serial: str, self_test_due_s: float) -> None:
        self.serial, self._flags = serial, flags
        self._due_s = time.monotonic() + self_test_due_s
        self._control: _Control | None = None
        self._taken = 0
        self._requested_by: str | None = None
        self._testing = False
        self._changed = threading.Condition()

    # what it shows

    def system(self) -> dict[str, Any]:
        self._look()
        return {"status": "Started", "operatingMode": self.operating_mode(), "controlSerialNumber": self.serial}

    def operating_mode(self) -> dict[str, Any]:
        """GET /api/system/operating-mode. A user stop that is pressed shows as SafetyRecovery."""
        if self._testing:
            return {"status": "SelfTest"}
        return {"status": "SafetyRecovery" if self._flags["user_stop"] else "Execution"}

    def joints(self) -> list[dict[str, Any]]:
        self._look()
        brake = "Locked" if self._flags["locked"] else "Unlocked"
        return [{"joint": number, "brakeStatus": brake} for number in range(1, JOINTS + 1)]

    def fci(self) -> dict[str, Any]:
        self._look()
        return {"status": "Active" if self._flags["fci"] else "Inactive"}

    def control_token(self) -> dict[str, Any]:
        with self._changed:
            held = self._control
            return {"owner": held and held.owner, "tokenId": held and held.number, "requester": self._requested_by}

    def self_tests(self) -> dict[str, Any]:
        """GET /api/safety/self-tests: remaining in s."""
        left_s = self._due_s - time.monotonic()
        status = "Elapsed" if left_s <= 0.0 else "Warning" if left_s < SELF_TEST_WARNING_S else "OK"
        return {"status": "Running" if self._testing else status, "remaining": max(0, int(left_s))}

    def recovery(self) -> dict[str, Any]:
        return {"recovery": {"type": "SelfTestsElapsed"} if self._overdue() else None}

    # what it is told

    def take_control(self, owner: str, timeout_s: float | None) -> dict[str, Any]:
        """POST /api/system/control-token:take: at once where it is free, else as soon as its owner gives it back."""
        wait_s = _LONGEST_WAIT_S if timeout_s is None else min(timeout_s, _LONGEST_WAIT_S)
        with self._changed:
            self._requested_by = owner
            free = self._changed.wait_for(lambda: self._control is None, wait_s)
            self._requested_by = None
            if not free:
                raise Refused(424, "Timeout", "the control token was not released in time")
            self._taken += 1
            self._control = _Control(owner, secrets.token_urlsafe(16), self._taken)
            return {"token": self._control.token, "tokenId": self._control.number}

    def release_control(self) -> None:
        with self._changed:
            self._control = None
            self._changed.notify_all()

    def check(self, token: str | None) -> None:
        """Raise Refused where a request comes without control."""
        if token is None:
            raise Refused(400, "MissingHeader", "X-Control-Token is missing")
        held = self._control
        if held is None or not secrets.compare_digest(token.encode(), held.token.encode()):
            raise Refused(423, "InvalidControlToken", "the control token is not valid, or not any more")

    def unlock(self) -> None:
        """POST /api/arm/joints:unlock; answered once the brakes are open."""
        self._allow()
        time.sleep(_BRAKES_S)
        self._flags["locked"] = 0

    def lock(self) -> None:
        """POST /api/arm/joints:lock. Needs no control: a user who is signed in may lock."""
        self._flags["locked"] = 1
        time.sleep(_BRAKES_S)

    def change_mode(self, wanted: str) -> None:
        """POST /api/system/operating-mode:change. Only to Execution: Programming is of the page's own button."""
        if wanted != "Execution":
            raise Refused(400, "InvalidOperatingMode", f"{wanted} cannot be asked for here")
        self._allow()

    def activate_fci(self) -> None:
        self._allow()
        if self._flags["locked"]:
            raise Refused(424, "FailedDependency", "the joints are locked", ("BrakesClosed",))
        self._flags["fci"] = 1

    def deactivate_fci(self) -> None:
        self._flags["fci"] = 0

    def execute_self_tests(self) -> None:
        """POST /api/safety/self-tests:execute; answered when they are over. The brakes are locked meanwhile."""
        if self._flags["fci"]:
            raise Refused(424, "FailedDependency", "FCI is active", ("FciActive",))
        before = int(self._flags["locked"])
        self._testing = True
        self._flags["locked"] = 1
        time.sleep(_SELF_TEST_S)
        self._due_s = time.monotonic() + SELF_TEST_EVERY_S
        self._testing = False
        self._flags["locked"] = before

    def confirm_recovery(self, kind: str) -> None:
        if kind != "SelfTestsElapsed" or not self._overdue():
            raise Refused(424, "FailedDependency", f"there is no {kind}")

    def shut_down(self) -> None:
        """POST /api/system:shutdown. A real box is then silent until it is switched off and on."""
        self._flags["fci"], self._flags["locked"], self._flags["off"] = 0, 1, 1

    @property
    def off(self) -> bool:
        return bool(self._flags["off"])

    def _allow(self) -> None:
        self._look()
        if self._testing:
            raise Refused(424, "FailedDependency", "a self-test runs", ("SelfTestsRunning",))
        if self._flags["user_stop"]:
            raise Refused(424, "FailedDependency", "the stop is pressed", ("EmergencyStopPressed",))
        if self._overdue():
            raise Refused(424, "FailedDependency", "the self-tests are overdue", ("SelfTestsElapsed",))

    def _overdue(self) -> bool:
        return time.monotonic() >= self._due_s

    def _look(self) -> None:
        if self._overdue() and not self._testing:
            self._flags["fci"], self._flags["locked"] = 0, 1
