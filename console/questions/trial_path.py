"""The path of both pads in a trial, as the scene draws it."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rtstack.references.spreading import ExtendedReference

EXTENSION_S = 0.15  # how much of an extension is drawn: beyond it the paths leave the table
_STEP_S = 0.02  # between two points that are drawn

Points = list[list[list[float]]]  # (2, n, 3) m, of (left, right)


@dataclass(frozen=True, slots=True)
class TrialPath:
    """Both pads' way, (2, n, 3) m in the world: ante to the nominal impact, extended as that reference goes on; post on
    from the impact, before: where that one comes from. impact, velocity (2, 3): of the pads at the impact, m, m/s.
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
