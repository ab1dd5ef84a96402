"""A process of its own that answers one question about a log, which takes seconds, and says how far it is.

    python -m console.questions.answering

It reads the question from its standard input, pickled, and writes lines of JSON: {"share": 0.4} now and then, and at
the end {"answer": ...} or {"refused": "one line"}. console.questions.questions asks it.
"""

import json
import os
import pickle
import sys
from collections.abc import Callable
from dataclasses import asdict
from datetime import date
from pathlib import Path
from typing import Any

from console.child_process import stand_back
from console.questions.trial_path import path_of
from rtstack.calibration.points import load_points, outcome
from rtstack.model.cell_description import CellDescription
from rtstack.playback.run import fastest_playback
from rtstack.references.recording import ReferenceError
from rtstack.references.source import load_reference
from rtstack.trials.assembly import arm_controllers, cell_parameters
from rtstack.trials.errors import TrialError
from rtstack.trials.extraction import extract

Progress = Callable[[float], None]


def _calibration(path: Path, cell: CellDescription, today: str, progress: Progress) -> dict[str, Any]:
    found = outcome(load_points(path), cell, date.fromisoformat(today))
    return {**found.document(), "lines": found.lines, "refusal": found.refusal}


def _path(path: Path, cell: CellDescription, _: None, progress: Progress) -> dict[str, Any]:
    parameters = cell_parameters(cell)
    return asdict(path_of(load_reference(path, arm_controllers(cell, parameters), parameters.detector, cell.sides)))


QUESTIONS: dict[str, Callable[[Path, CellDescription, Any, Progress], Any]] = {
    "extraction": lambda path, cell, acceptance, progress: asdict(extract(path, cell, acceptance, progress)),
    "fastest": lambda path, cell, _, progress: fastest_playback(path, cell),
    "calibration": _calibration,
    "path": _path,
}


def main() -> None:
    """Answer."""
    stand_back()
    out = os.fdopen(os.dup(sys.stdout.fileno()), "w", buffering=1)
    os.dup2(sys.stderr.fileno(), sys.stdout.fileno())  # what libraries print is no answer
    kind, path, cell, more = pickle.load(sys.stdin.buffer)

    def say(**words: Any) -> None:
        print(json.dumps(words), file=out)

    try:
        say(answer=QUESTIONS[kind](path, cell, more, lambda share: say(share=round(share, 3))))
    except (TrialError, ReferenceError) as error:
        say(refused=str(error).replace(f"{path}: ", ""))


if __name__ == "__main__":
    main()
