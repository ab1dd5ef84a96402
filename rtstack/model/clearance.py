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


class Clearance:
    """The arms of a cell as capsules over its table."""

    def __init__(self, description: CellDescription) -> None:
        table = description.table
        half = np.array(table.size_xy) / 2
        self._low, self._high = np.array(table.centre_xy) - half, np.array(table.centre_xy) + half
        self._top = table.top_z
        self._bodies = [arm_body(arm.base, tool) for arm, tool in zip(description.arms, description.tools, strict=True)]
        pairs = zip(self._bodies, reversed(self._bodies), strict=True)
        self._rules = [rules(HARDWARE, StopProfile(), own, other) for own, other in pairs]
        self._memory = empty_memory(len(self._bodies))

    def at(self, q: Sequence[Array]) -> tuple[list[float], float]:
        """Return how far the links of each arm are above the table, m, inf beside it, and how far the arms are apart,
        m, at most ARM_DISTANCE_M; inf for one arm. q: (7,) rad of each arm."""
        memory, gaps, still = self._memory, [], np.zeros(7)
        for arm, (body, rule) in enumerate(zip(self._bodies, self._rules, strict=True)):
            place_arm(q[arm], still, rule[0], memory[arm])
            first = body["first"]
            links = slice(int(first[1]), int(first[-1]) - 1)  # not those of the base, and not the pad's, the last
            ends = memory[arm]["ends_world"][links]
            above = np.all((ends[:, :, :2] > self._low) & (ends[:, :, :2] < self._high), axis=2)
            gap = np.where(above, ends[:, :, 2] - rule[0]["radius"][links, None] - self._top, np.inf)
            gaps.append(float(gap.min()))
        if len(self._bodies) == 1:
            return gaps, np.inf
        return gaps, float(arm_distance(memory[0], memory[1], self._rules[0][0], ARM_DISTANCE_M))
