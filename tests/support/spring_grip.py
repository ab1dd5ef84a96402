"""Two springs that grip an object, lift it and hold it."""

import numpy as np
import pinocchio as pin

from sim_robot.cell import SimulatedCell
from sim_robot.scene import load_scene
from tests.support.plant_object import object_pose
from tests.support.rigid_arm import RigidArm

STIFFNESS = np.diag([1000.0, 1000.0, 2000.0, 30.0, 30.0, 30.0])
DAMPING = np.diag([60.0, 60.0, 80.0, 2.0, 2.0, 2.0])
SPEED = 0.2  # m/s, approach


class SpringGrip:
    """A Cartesian spring at each pad: its rest position comes together until it presses, then rises by 0.1 m."""

    def __init__(self, cell: SimulatedCell, press_n: float) -> None:
        self._cell = cell
        self._travel = 0.2 + press_n / STIFFNESS[1, 1]
        self._arm = RigidArm(load_scene().pad)
        self._start = [self._arm.pose(arm.read().q) for arm in cell.arms]
        self._tau = np.zeros((2, 7))
        self.time_s = 0.0

    def run(self, seconds: float) -> np.ndarray:
        """Tick both arms; return the object's position, ms by ms, (n, 3)."""
        cell, positions = self._cell, []
        for _ in range(round(seconds * 1e3)):
            for side, (arm, inwards) in enumerate(zip(cell.arms, (-1.0, 1.0), strict=True)):
                state = arm.read()
                arm.write(self._torque(side, inwards, state.q, state.record["dq"][0]))
            self.time_s += 1e-3
            positions.append(object_pose(cell.plant)[0])
        return np.array(positions)

    def _torque(self, side: int, inwards: float, q: np.ndarray, dq: np.ndarray) -> np.ndarray:
        J, T, start = self._arm.jacobian(q), self._arm.pose(q), self._start[side]
        lift = np.clip(0.1 * (self.time_s - 1.5), 0.0, 0.1)
        target = start.translation + (0.0, inwards * min(self._travel, SPEED * self.time_s), lift)
        error = np.concatenate([target - T.translation, T.rotation @ pin.log3(T.rotation.T @ start.rotation)])
        wanted = J.T @ (STIFFNESS @ error - DAMPING @ (J @ dq)) - 0.3 * dq
        self._tau[side] += np.clip(wanted - self._tau[side], -1.0, 1.0)
        return self._tau[side]
