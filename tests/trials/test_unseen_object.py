"""A trial that no tracker has watched says so."""

from dataclasses import replace

from hal.tracker_link import NoTracker
from rtstack.cells import open_cell
from rtstack.trials.specification import TrialSpecification
from rtstack.trials.trial import prepare_trial, run_trial


class Frozen:
    """A tracker that saw the object before the trial, and then went blind."""

    def __init__(self, tracker) -> None:
        self._pose = tracker.latest()
        self._pose.record["seen"] = 1
        self._pose.record["t_ns"] = 0

    def latest(self):
        return self._pose


def test_an_object_that_was_never_seen_is_no_object_that_slipped(cell, demonstration):
    for watcher in (NoTracker(), Frozen(NoTracker())):
        prepared = prepare_trial(TrialSpecification(str(demonstration.path)), cell)
        opened = open_cell("direct", "rice_box", 0.0, 0)
        result = run_trial(prepared, replace(opened, tracker=watcher))
        opened.close()
        assert not result.success
        assert result.failure_reason.startswith("the object was never seen")
        assert result.max_lift_mm is None
