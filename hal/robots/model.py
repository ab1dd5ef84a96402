"""What is known of a model of robot: one record that simulation, safety, control, planning and viewers take it from."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from hal.arrays import Array
from hal.limits import ArmLimits

Three = tuple[float, float, float]


@dataclass(frozen=True, slots=True)
class CartesianLimits:
    """Limits of the end effector's motion generators: velocity, acceleration and jerk; m, rad, and the elbow's rad."""

    translation: Three
    rotation: Three
    elbow: Three


@dataclass(frozen=True, slots=True, eq=False)
class RobotModel:
    """A torque-controlled arm of 7 joints at 1 kHz. Arrays have shape (7,), SI units, and are read-only.

    reference: how a cell's file names it, a registered name or the path of its TOML. title: its name for people.
    urdf: kinematics, inertias and collision capsules; whatever its source names them, the links are link0 (base) to
    link7 and link8 (flange), the joints joint1 to joint7 and joint8 (fixed), and the limits are those of `limits`.
    B, B_theta: the motors' inertia at the joints, bare and as the torque loop reduces it, kg m^2. friction: p1 Nm, p2
    s/rad, p3 rad/s of the sigmoid p1 / (1 + exp(-p2 (dq + p3))) - p1 / (1 + exp(-p2 p3)), which a controller counts on.
    sources: where the numbers come from, by the key of the TOML. plant: what the simulated arm has instead of the
    simulated robot's own numbers (sim_robot/parameters/plant.toml); nothing that controls or plans looks at it.
    meshes: for drawing, a folder of the package example-robot-data that has visual/linkN.dae and collision/linkN.stl;
    empty: the capsules are drawn.
    """

    reference: str
    title: str
    urdf: str
    limits: ArmLimits
    cartesian: CartesianLimits
    B: Array
    B_theta: Array
    friction: tuple[Array, Array, Array]
    sources: Mapping[str, str]
    plant: Mapping[str, Any]
    meshes: str = ""

    @property
    def name(self) -> str:
        """The registered name, or that of the file."""
        return Path(self.reference).stem
