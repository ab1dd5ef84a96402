"""The example's tasks and limits of the QP along random references: distances kept, and what they cost of a tick.

Two ideal arms, which accelerate as the torque says, go from home to random places near each other, both pads across the
other arm's way: without the limit their wrists come as near as 12 cm. Exit status 1 where the distance is not kept to
1 mm.

Takes ten minutes.
"""

import json
import sys
import time
from collections import Counter
from collections.abc import Sequence
from statistics import median

import numpy as np

from hal.base.arrays import Array
from rtstack.cells import load_description
from rtstack.control.limits import paper_limits
from rtstack.control.link_point import LinkPoint
from rtstack.control.qp_law import QpLaw
from rtstack.control.tasks import ImpedanceTask
from rtstack.control.tick import ArmController
from rtstack.samples import Mode, QpStatus
from rtstack.trials.assembly import arm_controllers, default_parameters
from tests.programs import program
from tests.support.example_module import example

arms_apart, elbow = example("arms_apart"), example("elbow")
JOINTS, LEAST_M = arms_apart.JOINTS, arms_apart.LEAST_M

PERIOD_S, KEPT_M = 1e-3, 1e-3
LAWS = {
    "paper": lambda arm, other: QpLaw(arm),
    "arms_apart": lambda arm, other: QpLaw(arm, limits=[*paper_limits(arm), arms_apart.ArmsApart(arm, other)]),
    "elbow": lambda arm, other: QpLaw(arm, [ImpedanceTask(arm), elbow.ElbowHeight(arm, 0.45)]),
}


class Arms:
    """Both arms of the default cell, ideal: no friction, no flexibility, no robot between torque and motion."""

    def __init__(self, kind: str) -> None:
        self.description, parameters = load_description(None)[0], default_parameters()
        self.arms = arm_controllers(self.description, parameters)
        self.laws = [LAWS[kind](a, b) for a, b in zip(self.arms, reversed(self.arms), strict=True)]
        for arm in self.arms:
            arm.pursue(np.array(parameters.control.stiffness), parameters.control.posture_gain)
        self._watched = [[LinkPoint(arm, joint) for joint in JOINTS] for arm in self.arms]
        self.statuses: Counter[str] = Counter()
        self.took_us: list[float] = []

    def begin(self) -> list[Array]:
        """Put both arms at home, at rest; return the pads' places, m."""
        for arm, q in zip(self.arms, self.description.home, strict=True):
            work = arm.observed_at(q, np.zeros(7))
            work["tau_previous"] = 0.0
            setpoint = arm.setpoint[0]
            setpoint["rotation"], setpoint["twist"], setpoint["xi"] = work["rotation"], 0.0, q[0]
            setpoint["velocity_weight"] = 1.0
        return [arm.workspace["position"][0].copy() for arm in self.arms]

    def distance(self) -> float:
        """Return the least distance of the watched points, m."""
        for point in (*self._watched[0], *self._watched[1]):
            point.update()
        return min(float(np.linalg.norm(a.position - b.position)) for a in self._watched[0] for b in self._watched[1])

    def tick(self, places: Sequence[Array], velocities: Sequence[Array]) -> float:
        """Ask both pads for a place and a velocity, and move; return the distance before."""
        for arm, place, velocity in zip(self.arms, places, velocities, strict=True):
            arm.observe()
            arm.setpoint["position"][0], arm.setpoint["twist"][0, :3] = place, velocity
        before = self.distance()
        for arm, law in zip(self.arms, self.laws, strict=True):
            began_ns = time.perf_counter_ns()
            status = law.command(Mode.ANTE_IMPACT)
            self.took_us.append(1e-3 * (time.perf_counter_ns() - began_ns))
            self.statuses[status.name] += 1
            _move(arm)
        return before


def _move(arm: ArmController) -> None:
    work, sample = arm.workspace[0], arm.sample[0]
    tau = sample["tau_desired"]
    ddq = np.linalg.solve(work["M"], tau - work["coriolis"] - work["friction"])
    work["tau_previous"] = tau
    sample["q"] += PERIOD_S * sample["dq"] + 0.5 * PERIOD_S**2 * ddq
    sample["dq"] += PERIOD_S * ddq


def least_distance(arms: Arms, rng: np.random.Generator) -> float:
    """Follow one random reference to 0.3 s after its end; return the least distance, m."""
    starts = arms.begin()
    middle = sum(starts) / 2.0 + rng.uniform((-0.1, -0.15, -0.1), (0.1, 0.15, 0.2))
    ways = [middle + rng.uniform(-0.1, 0.1, 3) - start for start in starts]
    duration_s, least = rng.uniform(0.6, 1.5), np.inf
    for k in range(round((duration_s + 0.3) / PERIOD_S)):
        s = min(1.0, k * PERIOD_S / duration_s)
        share, rate = s**3 * (10 - 15 * s + 6 * s**2), 30 * s**2 * (1 - s) ** 2 / duration_s
        places = [start + share * way for start, way in zip(starts, ways, strict=True)]
        least = min(least, arms.tick(places, [rate * way for way in ways]))
    return least


def main(references: int = 1000, seed: int = 39) -> int:
    """Follow the same random references with each law; print the distances and the time of a law's command."""
    found = {}
    for kind in LAWS:
        arms, rng = Arms(kind), np.random.default_rng(seed)
        least = []
        for number in range(references):
            least.append(least_distance(arms, rng))
            print(f"{kind}: {number + 1} of {references}", end="\r", file=sys.stderr, flush=True)
        found[kind] = {
            "least_m": round(min(least), 4),
            "nearer_than_least": sum(one < LEAST_M - KEPT_M for one in least),
            "command_us_p50": round(median(arms.took_us), 2),
            "python_us": arms.laws[0].costs(),
            "qp": dict(arms.statuses),
        }
    print(json.dumps({"references": references, "seed": seed, "wanted_m": LEAST_M, **found}, indent=1))
    failed = sum(count for name, count in found["arms_apart"]["qp"].items() if QpStatus[name] > QpStatus.SOLVED)
    return int(bool(found["arms_apart"]["nearer_than_least"] or failed))


if __name__ == "__main__":
    program(main)
