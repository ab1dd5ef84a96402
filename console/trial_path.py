"""A process of its own: reads a trial's reference, and prints the path of both pads as the scene draws it.

    python -m console.trial_path REFERENCE.mcap CELL.toml

It takes the robot's model and seconds, beside a loop that must not wait.
"""

import sys
from pathlib import Path

import msgspec
import numpy as np
from numpy.typing import NDArray

from console.niceness import stand_back
from rtstack.model.cell_description import load_cell_description
from rtstack.references.recording import ReferenceError
from rtstack.references.source import load_reference
from rtstack.references.spreading import ExtendedReference
from rtstack.trials.assembly import arm_controllers, cell_parameters

REFUSED = 2  # exit status
EXTENSION_S = 0.15  # how much of an extension is drawn: beyond it the paths leave the table
_STEP_S = 0.02  # between two points that are drawn

Points = list[list[list[float]]]  # (2, n, 3) m, of (left, right)


class TrialPath(msgspec.Struct, frozen=True):
    """Both pads' way, (2, n, 3) m in the world. ante: to the nominal impact, extended: on from there as the ante-impact
    reference goes on; post: from the impact on, before: where the post-impact reference comes from. impact (2, 3):
    where the pads are at the nominal impact; velocity (2, 3): m/s there, before it.
    """

    ante: Points
    extended: Points
    before: Points
    post: Points
    impact: list[list[float]]
    velocity: list[list[float]]
    nominal_impact_s: float


def path_of(reference: ExtendedReference) -> TrialPath:
    """Return what is drawn of a reference."""
    impact = round(reference.nominal_impact_s / reference.period_s)
    release = min(reference.ticks - 1, round(reference.release_s / reference.period_s))
    reach, step = round(EXTENSION_S / reference.period_s), round(_STEP_S / reference.period_s)

    def way(points: NDArray, start: int, end: int) -> Points:
        places = np.unique(np.append(np.arange(max(0, start), min(end, reference.ticks - 1), step), end))
        return points["position"][:, np.clip(places, 0, reference.ticks - 1)].tolist()

    return TrialPath(
        ante=way(reference.ante, 0, impact),
        extended=way(reference.ante, impact, impact + reach),
        before=way(reference.post, impact - reach, impact),
        post=way(reference.post, impact, release),
        impact=reference.ante["position"][:, impact].tolist(),
        velocity=reference.ante["twist"][:, impact, :3].tolist(),
        nominal_impact_s=reference.nominal_impact_s,
    )


def main() -> int:
    """Print the path as JSON. Returns REFUSED where there is none, with one line on stderr."""
    stand_back()
    file, cell = Path(sys.argv[1]), load_cell_description(Path(sys.argv[2]))
    parameters = cell_parameters(cell)
    try:
        reference = load_reference(file, arm_controllers(cell, parameters), parameters.detector)
    except ReferenceError as error:
        print(error, file=sys.stderr)
        return REFUSED
    sys.stdout.buffer.write(msgspec.json.encode(path_of(reference)))
    return 0


if __name__ == "__main__":
    sys.exit(main())
