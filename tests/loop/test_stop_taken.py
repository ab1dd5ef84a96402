"""A STOP is answered as done when the loop has taken it, and at no other time."""

import asyncio
import os
from types import SimpleNamespace
from typing import Any

import pytest

from console.routes.control import request_stop
from rtstack.live.audit import AuditTrail
from rtstack.live.client import RobotUnreachable
from rtstack.live.control_authority import ControlAuthority
from rtstack.loop.mailbox import Mailbox
from rtstack.safety.arming import Refused

ANSWER = "^STOP was not taken by the control loop within 0.5 s: use the emergency stop$"


@pytest.fixture
def mailbox():
    box = Mailbox.create(f"stop-taken-{os.getpid()}")
    yield box
    box.close()


@pytest.fixture
def authority(mailbox, tmp_path):
    audit = AuditTrail(tmp_path / "audit.jsonl")
    yield ControlAuthority(mailbox, audit)
    audit.close()


def ask(mailbox: Mailbox) -> bool:
    """Ask as the console does."""
    parts: Any = SimpleNamespace(mailbox=mailbox, client=SimpleNamespace(stop=lambda operator: None))
    session: Any = SimpleNamespace(operator="ada")
    return asyncio.run(request_stop(parts, session))


def test_where_no_session_runs_nothing_takes_it(mailbox, authority):
    assert ask(mailbox) is False
    authority.stop("ada")


def test_it_is_taken_once_a_whole_tick_has_passed(mailbox):
    mailbox.turn(7)
    came = mailbox.request_stop()
    assert not mailbox.stop_taken(came)
    mailbox.turn(8)  # the end of a tick that may have looked before it came
    assert not mailbox.stop_taken(came)
    mailbox.turn(9)
    assert mailbox.stop_taken(came)
    mailbox.turn(0)
    assert mailbox.stop_taken(came)


def test_a_loop_that_stands_still_is_an_error(mailbox, authority):
    mailbox.turn(7)
    with pytest.raises(RobotUnreachable, match=ANSWER):
        ask(mailbox)
    with pytest.raises(Refused, match=ANSWER):
        authority.stop("ada")
    assert mailbox.stop_requested
