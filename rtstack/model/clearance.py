"""How near the links of a cell's arms come to its table and to each other, by the judge's capsules."""

from collections.abc import Sequence

import numpy as np

from hal.base.arrays import Array
from rtstack.model.cell_description import CellDescription
from rtstack.safety.body import arm_body
from rtstack.safety.geometry import arm_distance, place_arm
from rtstack.safety.limits import HARDWARE
from rtstack.safety.records import StopProfile, empty_memory, rules

ARM_DISTANCE_M = 0.05  # of two arms that are clear of each other
ALONG = np.linspace(0.0, 1.0, 5)  # of a capsule's axis, where its distance is looked at


class Clearance:
    """The arms of a cell as capsules over its table."""

    def __init__(self, description: CellDescription) -> None:
        table = description.table
        half = np.array(table.size_xy) / 2
        self._low = np.array([*(np.array(table.centre_xy) - half), -np.inf])
        self._high = np.array([*(np.array(table.centre_xy) + half), table.top_z])
        self._bodies = [arm_body(arm.base, tool) for arm, tool in zip(description.arms, description.tools, strict=True)]
        others = reversed(self._bodies)
        self._rules = [rules(HARDWARE, StopProfile(), *both) for both in zip(self._bodies, others, strict=True)]
        self._memory = empty_memory(len(self._bodies))

    def at(self, q: Sequence[Array]) -> tuple[list[float], float]:
        """Return how far the links of each arm are from the table, m, negative inside, and how far the arms are apart,
        m, at most ARM_DISTANCE_M; inf for one arm. q: (7,) rad of each arm."""
        memory, gaps, still = self._memory, [], np.zeros(7)
        for arm, (body, rule) in enumerate(zip(self._bodies, self._rules, strict=True)):
            place_arm(q[arm], still, rule[0], memory[arm])
            first = body["first"]
            links = slice(int(first[1]), int(first[-1]) - 1)  # not those of the base, and not the pad's, the last
            a, b = memory[arm]["ends_world"][links].swapaxes(0, 1)
            points = a + ALONG[:, None, None] * (b - a)
            away = np.maximum(self._low - points, points - self._high)
            gap = np.linalg.norm(np.maximum(away, 0.0), axis=2) + np.minimum(away.max(axis=2), 0.0)
            gaps.append(float((gap - rule[0]["radius"][links]).min()))
        if len(self._bodies) == 1:
            return gaps, np.inf
        return gaps, float(arm_distance(memory[0], memory[1], self._rules[0][0], ARM_DISTANCE_M))
