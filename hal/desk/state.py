"""What a box says of itself on its Desk, and what of that a person has to change before FCI can move the arm."""

from dataclasses import dataclass
from typing import Any

# before a self-test that is due within so long, s, a day of trials should not begin: franky's manual has 300
SELF_TEST_SOON_S = 600.0
_LONGEST_S = 1e9
UNKNOWN = "unknown"
# the types that another client (franky) names, and what leads out of them; the others need the page
_RECOVERIES = {
    "SelfTestsElapsed": "its self-test is overdue: run it (rtstack desk start --self-test), no person within reach",
    "JointPositionError": "a joint's position is not sure: confirm its reference position on its Desk page",
    "JointLimitViolation": "a joint is beyond its limit: move it back on its Desk page, with the enabling device",
    "SafetyRuleViolation": "a safety rule (Watchman) was violated: confirm it on its Desk page",
    "SafeInputUnacknowledged": "a safe input has changed: acknowledge it on its Desk page",
    "SafetyError": "its safety controller has an error: look at its Desk page; if it stays, reboot the box",
}


@dataclass(frozen=True, slots=True)
class DeskState:
    """status: Started when it has booted. brakes: locked, unlocked or mixed. control: who has control on Desk, "" for
    none. self_test: OK, Warning, Elapsed or Running; self_test_s: seconds to it, None where unknown. recovery: the
    type of a safety error that has to be confirmed, "" for none. What an answer does not have is "unknown".
    """

    status: str = UNKNOWN
    operating_mode: str = UNKNOWN
    brakes: str = UNKNOWN
    fci: str = UNKNOWN
    control: str = ""
    self_test: str = UNKNOWN
    self_test_s: float | None = None
    recovery: str = ""
    version: str = UNKNOWN
    serial: str = UNKNOWN

    @property
    def ready(self) -> bool:
        """Whether FCI is let in and the arm can move."""
        return self.fci == "Active" and self.brakes == "unlocked" and not self.obstacles

    @property
    def obstacles(self) -> tuple[str, ...]:
        """What no program may get past: a line each, what it is and what a person has to do."""
        found = []
        if self.status not in ("Started", UNKNOWN):
            found.append(f"it is not started ({self.status}): wait, or look at its Desk page")
        if self.operating_mode == "SafetyRecovery" and not self.recovery:
            found.append("its stop is pressed: look why, then release it")
        if self.operating_mode == "SelfTest" or self.self_test == "Running":
            found.append("its self-test runs: wait")
        if self.recovery:
            found.append(_RECOVERIES.get(self.recovery, f"safety: {self.recovery}: look at its Desk page"))
        elif self.self_test == "Elapsed":
            found.append(_RECOVERIES["SelfTestsElapsed"])
        return tuple(found)

    @property
    def warning(self) -> str:
        """What is to be done soon, "" for nothing."""
        soon = self.self_test_s is not None and 0.0 < self.self_test_s < SELF_TEST_SOON_S
        return f"its self-test is due in {self.self_test_s:.0f} s: run it before work begins" if soon else ""


def state_of(
    system: Any, joints: Any, fci: Any, control: Any, self_tests: Any, recovery: Any, version: Any
) -> DeskState:
    """Return the state that the answers give, each of them parsed JSON, or None where there was none."""
    brakes = {_word(joint, "brakeStatus") for joint in joints} if isinstance(joints, list) else set()
    left = self_tests.get("remaining") if isinstance(self_tests, dict) else None
    left = float(left) if isinstance(left, int | float) and abs(left) < _LONGEST_S else None
    demanded = recovery.get("recovery", recovery) if isinstance(recovery, dict) else None
    return DeskState(
        status=_word(system, "status"),
        operating_mode=_word(system.get("operatingMode") if isinstance(system, dict) else None, "status"),
        brakes={"Locked": "locked", "Unlocked": "unlocked"}.get(brakes.pop(), UNKNOWN) if len(brakes) == 1
        else "mixed" if brakes else UNKNOWN,
        fci=_word(fci, "status"),
        control=owner_of(control),
        self_test=_word(self_tests, "status"),
        self_test_s=left,
        recovery=_word(demanded, "type", ""),
        version=plain(version.strip().partition("\n")[0]) if isinstance(version, str) and version.strip() else UNKNOWN,
        serial=_word(system, "controlSerialNumber"),
    )  # fmt: skip


def owner_of(control: Any) -> str:
    """Return who has control, by the answer about the control token, "" for none."""
    return _word(control, "owner", "")


def _word(answer: Any, key: str, without: str = UNKNOWN) -> str:
    value = answer.get(key) if isinstance(answer, dict) else None
    return (plain(value) if isinstance(value, str) else "") or without


def plain(text: str, most: int = 80) -> str:
    """Return what a box has sent in one line of at most so many characters, none of which a terminal obeys."""
    return " ".join("".join(c if c.isprintable() else " " for c in text[: 10 * most]).split())[:most]
