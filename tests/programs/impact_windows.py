"""How far the validation's estimates depend on the end of (29)'s window, from a campaign's logs.

    .venv/bin/python -m tests.programs.impact_windows OUT [--motion grab] [--repetitions 2]

For each object and case: the error of the prediction with B_theta, %, for windows that end 0.45 to 0.6 s after the
nominal impact. The paper's ends "after any impact-induced vibrations have vanished": where they have not, the columns
differ. Exit status 2 where OUT is no campaign's folder.
"""

import argparse
import sqlite3
import sys
from pathlib import Path

import numpy as np

from rtstack.cells import default_cell_file
from rtstack.log.reader import read_log
from rtstack.loop.history import Columns
from rtstack.model.cell_description import load_cell_description
from rtstack.papers.impact_maps.feedback import feedback_signal
from rtstack.papers.impact_maps.fit import zero_feedback
from rtstack.papers.impact_maps.plan import DIRECTIONS
from rtstack.references.motion import Motion
from rtstack.samples import SIDES
from rtstack.trials.assembly import arm_controllers, cell_parameters

ENDS_S = (0.45, 0.475, 0.5, 0.525, 0.55, 0.575, 0.6)


def main() -> int:
    """Print the table; return the exit status."""
    arguments = argparse.ArgumentParser(description="Estimates by the end of the window of (29).")
    arguments.add_argument("out", type=Path)
    arguments.add_argument("--motion", type=Motion, choices=list(Motion), default=Motion.GRAB)
    arguments.add_argument("--repetitions", type=int, default=2)
    options = arguments.parse_args()
    table = options.out / "campaign.sqlite"
    if not table.is_file():
        arguments.error(f"{options.out}: no campaign.sqlite there: name a campaign's folder")
    rows = sqlite3.connect(table).execute(
        "SELECT object, case_name, planned_m_s, predicted_B_theta_m_s, nominal_impact_time_s, log FROM results "
        "WHERE motion = ? AND repetition < ? AND success AND complete AND conditions = 'nominal' ORDER BY id",
        (str(options.motion), options.repetitions),
    )
    description = load_cell_description(default_cell_file())
    arms = arm_controllers(description, cell_parameters(description))
    cells: dict[tuple[str, str], list[tuple[float, float, list[float]]]] = {}
    for thing, case, planned, predicted, nominal_s, name in rows:
        log = read_log(options.out / name)
        arm, control = (np.stack([log.topic(f"/{side}/{what}") for side in SIDES]) for what in ("arm", "control"))
        columns = Columns(arm, control, timing=np.empty(0), object=np.empty(0))
        signal = feedback_signal(columns, nominal_s, arms, DIRECTIONS[options.motion])
        net = [float(np.interp(end, signal.t_s, signal.integral)) for end in ENDS_S]
        cells.setdefault((thing, case), []).append((planned, predicted, net))
    print(f"{'':12} " + " ".join(f"{end:>7.3f}" for end in ENDS_S) + "  s")
    for (thing, case), trials in cells.items():
        errors = [
            zero_feedback([planned for planned, _, _ in trials], [net[k] for _, _, net in trials])
            .error_percent(trials[0][1])
            for k in range(len(ENDS_S))
        ]  # fmt: skip
        print(f"{thing:8} {case:3} " + " ".join(f"{error:>+7.2f}" for error in errors) + "  %")
    return 0


if __name__ == "__main__":
    sys.exit(main())
