"""Where a trial starts: both pads flat beside the object's place, clear of joint limits, the table and each other.

A pad is flat where its face looks at the object along the world's y, with level edges. Seven joints hold such a pose
in a line of configurations: inverse kinematics finds some of them, and each climbs along its line to the best one.
"""

from itertools import product

import numpy as np
from scipy.spatial.transform import Rotation

from hal.base.arrays import Array
from rtstack.impact_map.bodies import moved_to
from rtstack.impact_map.grab import POSTURE_JOINT, placed
from rtstack.model.arm_model import ArmModel
from rtstack.model.cell_description import CellDescription
from rtstack.model.clearance import ARM_DISTANCE_M, Clearance
from rtstack.planning.feasibility import POSITION_MARGIN_RAD
from rtstack.planning.request import GrabPlan, PlanError
from rtstack.references.demonstration import LEAST_RISE_M
from rtstack.safety.limits import hardware_limits

# Chosen by us; the shipped cells have the first of each. Distances above the table and beside the widest object
ABOVE_M, BESIDE_M = (0.01, 0.04), (0.2, 0.12)
BEFORE_M, BELOW_M = 0.07, 0.03  # where a hand is 0.2 s before it meets an object (rtstack.references.demonstration)
# What is kept of joint limits (rad), table (m) and singular postures (smallest singular value of the twist of the pad
# and joint 1, m and rad; below 0.08 a robot estimates no wrench): at a start, in a grab, and from where on it is enough
LEAST, LEAST_IN_GRAB = (0.1, 0.01, 0.1), (POSITION_MARGIN_RAD, 0.01, 0.05)
ENOUGH = np.array([0.5, 0.02, 0.2])
REASONS = ("joint {} is at its limit", "its links touch the table", "the posture is singular")
GUESSES, STEPS, KEPT, SEED = 24, 40, 12, 1  # first guesses of a rotation, Newton's steps from each, what climbs
CLIMB_RAD = (0.3, 0.1, 0.03, 0.01)
MIRROR = np.array([-1.0, 1.0, -1.0, 1.0, -1.0, 1.0, -1.0])  # the right arm's first guesses are the left one's mirrored

# checks that are passed, the share of what is enough in the next one, what is in the way, and where the pad is then
Rank = tuple[int, float, str, tuple[float, float, float]]


class NoHome(PlanError):
    """A cell without a start pose. One line: the arm, what is in the way, and where."""


def find_home(description: CellDescription) -> dict[str, Array]:
    """Return where a trial starts.

    The pads go where those of the cells that come with rtstack are, 10 mm above the table and 0.2 m beside the widest
    object, or higher and nearer, from where the poses of a grab are in reach, too. `home` of the cell is not used.

    Args:
        description: The cell, of one arm or two.

    Returns:
        The joints (7,) of each arm, rad to six digits, by its side, left before right.

    Raises:
        NoHome: The arm and what is in the way at the first of these places: the box of [safety], its reach, a joint's
            limit, the table, a singular posture, the other arm.
    """
    refused, clearance = [], Clearance(description)
    for above, beside in product(ABOVE_M, BESIDE_M):
        try:
            found = [_Arm(description, side, above, beside).starts() for side in description.sides]
        except NoHome as error:
            refused.append(error)
            continue
        for ranks in sorted(product(*(range(len(starts)) for starts in found)), key=sum):
            pair = [starts[rank] for starts, rank in zip(found, ranks, strict=True)]
            if clearance.at(pair)[1] >= ARM_DISTANCE_M:
                return dict(zip(description.sides, pair, strict=True))
        near = f"the arms come nearer than {ARM_DISTANCE_M} m to each other"
        refused.append(NoHome(f"no start pose: {near} in all of them: move their bases apart"))
    raise refused[0]


class _Arm:
    """One arm and one place for its pad."""

    def __init__(self, description: CellDescription, side: str, above: float, beside: float) -> None:
        alone, sign, plan = description.only([side]), -1.0 if side == "right" else 1.0, GrabPlan()
        (mounting,), (pad,), top = alone.arms, alone.pads, description.table.top_z
        self._side, self._clearance, self._model = side, Clearance(alone), ArmModel(mounting, description.pad)
        limits = self._limits = hardware_limits(mounting.robot).tightened(description.safety)
        self._low, self._high = np.array(limits.q_lower), np.array(limits.q_upper)
        self._middle, self._half = (self._low + self._high) / 2.0, (self._high - self._low) / 2.0
        self._mirror = MIRROR if sign < 0.0 else np.ones(7)
        # the face's z looks at the object, its y up; or else it may stand on another edge that is as long
        level = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -sign], [0.0, sign, 0.0]])
        turns = range(0, 4, 1 if pad.size[0] == pad.size[1] else 2)
        self._rotations = [level @ Rotation.from_euler("z", turn * np.pi / 2.0).as_matrix() for turn in turns]
        widths, heights = ([each.size[axis] / 2.0 for each in description.objects.values()] for axis in (1, 2))
        start = top + above + pad.size[1] / 2.0
        low, high = (max(top + of(heights) + plan.height, start + LEAST_RISE_M) for of in (min, max))
        self._places = [
            (0.0, sign * (max(widths) + beside), start),
            (0.0, sign * (max(widths) + (beside + BEFORE_M) / 2.0), start),
            (0.0, sign * (max(widths) + BEFORE_M), low - BELOW_M),
            (0.0, sign * min(widths), low),
            (0.0, sign * max(widths), high),
            (plan.carry, sign * min(widths), high + plan.lift),
        ][: len(description.arms) + 4]  # one arm pushes and does not lift

    def starts(self) -> list[Array]:
        """Return start poses (7,), the best one first. Raises NoHome."""
        start, (low, high) = self._places[0], (self._limits.ee_lower, self._limits.ee_upper)
        inside = bool(np.all((low < np.array(start)) & (start < np.array(high))))
        reason = "out of reach" if inside else "the pad is outside of its box ([safety] ee_lower, ee_upper)"
        best, climbed = (-1, 0.0, reason, start), []
        for rotation in self._rotations if inside else ():
            found = sorted(self._solutions(rotation), key=lambda each: each[0], reverse=True)[:KEPT]
            climbed = sorted((self._climbed(*each, rotation) for each in found), key=lambda each: each[0], reverse=True)
            best = max([best, *(rank for rank, _ in climbed)])
            if best[0] > len(REASONS):
                return [q.round(6) for rank, q in climbed if rank[0] == best[0]]
        at = ", ".join(f"{metres:.3g}" for metres in best[3])
        what = f"{self._side} arm: no start pose: {best[2]}, its pad flat at ({at}) m"
        raise NoHome(f"{what}: move its base or the table, or mount another pad")

    def _solutions(self, rotation: Array) -> list[tuple[Rank, Array]]:
        """Return the rank of configurations with the pad at the start, and each joint turned into its range."""
        rng, middle, solutions = np.random.default_rng(SEED), self._middle, []
        for guess in rng.uniform(-1.0, 1.0, (GUESSES, 7)):
            q = middle + self._half * guess * self._mirror
            if (found := placed(self._model, q, self._places[0], rotation, steps=STEPS)) is not None:
                q = middle + np.remainder(found[0] - middle + np.pi, 2.0 * np.pi) - np.pi
                solutions.append((self._rank(q, rotation), q))
        return solutions

    def _rank(self, q: Array, rotation: Array) -> Rank:
        """Return how far a start comes, through a grab that holds joint 1."""
        worst = np.inf
        for number, place in enumerate(self._places):
            found = placed(self._model, q, place, rotation, float(q[POSTURE_JOINT]), STEPS)
            if found is None:
                return len(REASONS), -np.inf, "out of reach in a grab from there", place
            q, J = found
            rooms, (gap,) = np.minimum(q - self._low, self._high - q), self._clearance.at([q])[0]
            terms = np.array([rooms.min(), gap, np.linalg.svd(J, compute_uv=False)[-1]])
            least = LEAST_IN_GRAB if number else LEAST
            shares = np.minimum((terms - least) / (ENOUGH - least), 1.0)
            for passed, (share, reason) in enumerate(zip(shares.tolist(), REASONS, strict=True)):
                if share < 0.0:
                    reason = reason.format(rooms.argmin() + 1) + " in a grab from there" * bool(number)
                    return len(REASONS) if number else passed, share, reason, place
            centred = (
                1.0 - np.abs(q - self._middle) / self._half
            )  # of postures that are as good, the one amid its range
            worst = min(worst, float(shares.min() + 0.02 * centred.mean()))
        return len(REASONS) + 1, worst, "", self._places[0]

    def _climbed(self, best: Rank, q: Array, rotation: Array) -> tuple[Rank, Array]:
        """Return the best configuration on the line of those with the pad at the start, from q, and its rank."""
        for step, sign in product(CLIMB_RAD, (1.0, -1.0)):
            while True:
                self._model.update(q, np.zeros(7))
                face = self._model.p7 + self._model.R7 @ self._model.face
                along = np.linalg.svd(moved_to(face, self._model.J0))[2][-1]
                along *= sign * np.sign(along[np.abs(along).argmax()])
                found = placed(self._model, q + step * along, self._places[0], rotation, steps=STEPS)
                if found is None or (rank := self._rank(found[0], rotation)) <= best:
                    break
                q, best = found[0], rank
        return best, q
