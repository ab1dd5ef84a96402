"""The kinds of run that the robot process carries out, each with what prepares it from its specification."""

from collections.abc import Callable
from typing import Any

from rtstack.model.cell_description import CellDescription
from rtstack.playback.run import prepare_playback
from rtstack.trials.carry_out import PreparedRun
from rtstack.trials.demonstration import prepare_demonstration
from rtstack.trials.move import PreparedGuide, PreparedMove
from rtstack.trials.placement import prepare_placement
from rtstack.trials.specification import Specification
from rtstack.trials.teleoperation import prepare_teleoperation
from rtstack.trials.trial import prepare_trial

_KINDS: dict[str, Callable[[Any, CellDescription], PreparedRun]] = {
    "trial": prepare_trial,
    "demonstration": prepare_demonstration,
    "teleoperation": prepare_teleoperation,
    "playback": prepare_playback,
    "move": PreparedMove,
    "place": prepare_placement,
    "guide": PreparedGuide,
}


def prepare(specification: Specification, description: CellDescription) -> PreparedRun:
    """Read and check what a run needs, before anything is opened or written. Raises TrialError with one line."""
    return _KINDS[specification.verb](specification, description)
