"""The table of watchdogs has everything that ends a session."""

import sys
from pathlib import Path

from rtstack.loop.end import End
from rtstack.safety.reasons import Cause

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "docs/generate"))

from watchdogs import WATCHDOGS


def test_every_fault_of_a_session_has_its_watchdog():
    reasons = {entry.reason for entry in WATCHDOGS}
    assert {end for end in End if end.is_fault} - {End.SAFETY} <= reasons
    by_time = (Cause.NOT_FINITE, Cause.STATE_AGE, Cause.STATE_GAP, Cause.TIME_BACKWARDS, Cause.PAIR_SKEW)
    assert {reason.text for reason in by_time} <= reasons
    assert len({entry.name for entry in WATCHDOGS}) == len(WATCHDOGS)
