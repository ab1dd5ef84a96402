"""The documentation shows the table of the code, line by line."""

from pathlib import Path

from rtstack.loop.end import End
from rtstack.safety.reasons import Reason
from rtstack.watchdogs import WATCHDOGS, table

DOCUMENT = Path(__file__).parents[2] / "docs" / "watchdogs.md"


def test_the_documentation_shows_the_table():
    shown = [line for line in DOCUMENT.read_text().splitlines() if line.startswith("|")]
    assert shown == table(), "write it anew: python -m rtstack.watchdogs docs/watchdogs.md"


def test_every_fault_of_a_session_has_its_watchdog():
    reasons = {entry.reason for entry in WATCHDOGS}
    assert {end for end in End if end.is_fault} - {End.SAFETY} <= reasons
    by_time = (Reason.NOT_FINITE, Reason.STATE_AGE, Reason.STATE_GAP, Reason.TIME_BACKWARDS, Reason.PAIR_SKEW)
    assert {reason.text for reason in by_time} <= reasons
    assert len({entry.name for entry in WATCHDOGS}) == len(WATCHDOGS)
