"""Self-collision: a link of an arm that comes near another arm or the table. Pads and hands may touch anything."""

import numpy as np

from hal.compilation import compiled
from hal.robot_errors import error_bit
from sim_robot.model import PROXIMITY_M
from sim_robot.plant import Plant

SELF_COLLISION = error_bit("self_collision_avoidance_violation")
# nearer than this the cause persists; between this and PROXIMITY_M the arm may move away again
TOO_NEAR_M = 0.2 * PROXIMITY_M
# an arm that has been away for so long comes near anew
AWAY_MS = 200
_NOBODY, _LINK, _PAD, _TABLE = -1, 0, 2, 4  # a link or pad of the second arm is one more


# one signature, compiled when imported: MuJoCo's views are contiguous or not, depending on how many contacts there are
@compiled("void(int32[:, :], float64[:], int64[:], float64[:])")
def _nearest(pairs, distances, kinds, nearest):
    for arm in range(len(nearest)):
        nearest[arm] = np.inf
    for i in range(len(pairs)):
        for one in range(2):
            a, b = kinds[pairs[i, one]], kinds[pairs[i, 1 - one]]
            if a == _NOBODY or b == _NOBODY or (a >= _PAD and b >= _PAD):
                continue  # an object, or two pads, or a pad and the table
            if a < _TABLE:
                nearest[a % 2] = min(nearest[a % 2], distances[i])


class Proximity:
    """Watches one plant. `masks` (n,): SELF_COLLISION where an arm has just come near, or is too near."""

    def __init__(self, plant: Plant) -> None:
        arms = len(plant.sides)
        self.masks = np.zeros(arms, dtype=np.int64)
        self._data = plant.data
        self._nearest, self._away_ms = np.full(arms, np.inf), [0] * arms
        names = [plant.model.geom(i).name for i in range(plant.model.ngeom)]
        self._kinds = np.array([self._kind(name, plant.sides) for name in names])

    @staticmethod
    def _kind(name: str, sides: tuple[str, ...]) -> int:
        if name == "table":
            return _TABLE
        for number, side in enumerate(sides):
            # the base stands on the table's frame
            if name.startswith(f"{side}_") and not name.startswith(f"{side}_link0"):
                return (_LINK if name.startswith(f"{side}_link") else _PAD) + number
        return _NOBODY

    def update(self) -> None:
        """Look at the present contacts."""
        if self._data.ncon == 0:
            self._nearest[:] = np.inf
        else:
            contact = self._data.contact
            _nearest(contact.geom, contact.dist, self._kinds, self._nearest)
        for arm, distance in enumerate(self._nearest):
            near = bool(distance < PROXIMITY_M)
            self.masks[arm] = SELF_COLLISION if distance < TOO_NEAR_M or (near and self._away_ms[arm] == 0) else 0
            # counts down, so that an arm that holds at the edge does not come near again and again
            self._away_ms[arm] = AWAY_MS if near else max(0, self._away_ms[arm] - 1)

    def too_near(self, arm: int) -> bool:
        """True while the cause persists."""
        return bool(self._nearest[arm] < TOO_NEAR_M)
