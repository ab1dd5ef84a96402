"""A sensor or a tracker of another author that raises ends the run as a fault, with its place."""

import re
from dataclasses import replace

import pytest

from rtstack.cells import open_cell
from rtstack.loop.end import End
from rtstack.trials.specification import TrialSpecification
from rtstack.trials.trial import prepare_trial, run_trial

AFTER = 200
RAISED = [
    ValueError("no data"), OSError(5, "Input/output error"), KeyError("force"), ZeroDivisionError(), SystemExit(0),
    StopIteration(), RuntimeError("two\nlines"), AssertionError(), RecursionError("too deep"), TypeError("x" * 500),
    UnicodeDecodeError("utf-8", b"\xff", 0, 1, "invalid"),
]  # fmt: skip


class Broken:
    """A sensor, or a tracker, that raises after some ticks."""

    topic = "/clock"

    def __init__(self, error: BaseException, tracker=None) -> None:
        self._error, self._tracker, self.calls = error, tracker, 0

    def read(self, _sample) -> None:
        self.calls += 1
        if self.calls > AFTER:
            raise self._error

    def latest(self):
        self.read(None)
        return self._tracker.latest()


def spoilt(opened, what, error):
    broken = Broken(error, opened.tracker)
    return replace(opened, tracker=broken) if what == "tracker" else replace(opened, sensors=(broken,)), broken


CASES = [("direct", what, error) for error in RAISED for what in ("sensor", "tracker")]


@pytest.mark.parametrize(
    ("kind", "what", "error"), [*CASES, ("lockstep", *CASES[0][1:]), ("lockstep", *CASES[1][1:])],
    ids=lambda value: value if isinstance(value, str) else type(value).__name__,
)  # fmt: skip
def test_it_ends_the_run_with_its_place(cell, demonstration, kind, what, error) -> None:
    opened = open_cell(kind, "rice_box", 0.0, 0)
    spoiled, broken = spoilt(opened, what, error)
    result = run_trial(prepare_trial(TrialSpecification(str(demonstration.path)), cell), spoiled)
    opened.close()
    assert not result.success
    assert result.failure_reason.startswith(f"{End.CONTROLLER_EXCEPTION}: {type(error).__name__}: ")
    assert re.search(r"\(test_plug_ins_that_raise\.py:\d+\); mend it there$", result.failure_reason)
    assert "\n" not in result.failure_reason
    assert broken.calls <= AFTER + 2  # not asked again
