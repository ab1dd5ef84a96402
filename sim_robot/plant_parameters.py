"""The plant's parameters: nominal values, seeded scatter, noise. From a file that only the plant reads."""

from dataclasses import asdict, dataclass, fields, replace
from pathlib import Path
from typing import Any

from pydantic import PositiveInt

from hal.base.arrays import Seven
from hal.base.configuration import NotNegative, Positive, from_document, load_toml
from hal.robots import RobotModel
from hal.robots.model import SevenNotNegative, SevenPositive

OWN_FILES = Path(__file__).parent  # scenes, parameters: data of the package
Vector3 = tuple[float, float, float]
Vector3Positive = tuple[Positive, Positive, Positive]
ZEROS: Seven = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


@dataclass(frozen=True, slots=True)
class JointParameters:
    """Seven flexible joints: B, B_theta kg m^2; K Nm/rad; D Nms/rad; friction p1 Nm, p2 s/rad, p3 rad/s."""

    B: SevenPositive
    B_theta: SevenPositive
    K: SevenPositive
    D: SevenNotNegative
    friction_p1: SevenNotNegative
    friction_p2: SevenNotNegative
    friction_p3: Seven


@dataclass(frozen=True, slots=True)
class Scatter:
    """Standard deviations of what differs from the nominal plant, as fractions (link_centre_mm in mm)."""

    link_mass: NotNegative
    link_inertia: NotNegative
    link_centre_mm: NotNegative
    joint_stiffness: NotNegative
    joint_damping: NotNegative
    motor_inertia: NotNegative
    friction: NotNegative
    gravity_compensation: NotNegative


@dataclass(frozen=True, slots=True)
class Holding:
    """The robot's own joint impedance, Nm/rad."""

    stiffness: SevenPositive


@dataclass(frozen=True, slots=True)
class SensorParameters:
    """Noise (standard deviations), quantisation and filters of what the robot reports. SI units, Hz."""

    q_quantum: NotNegative
    q_noise: NotNegative
    dq_noise: NotNegative
    theta_noise: NotNegative
    dtheta_noise: NotNegative
    tau_J_noise: SevenNotNegative
    dtau_J_cutoff_hz: Positive
    tau_ext_cutoff_hz: Positive
    tau_ext_noise: SevenNotNegative
    smallest_singular_value: Positive
    wrench_damping: NotNegative


@dataclass(frozen=True, slots=True)
class TrackerParameters:
    """Motion capture: rate Hz and noise."""

    rate_hz: Positive
    position_noise_mm: NotNegative
    orientation_noise_deg: NotNegative

    def __post_init__(self) -> None:
        if self.rate_hz > 1000.0 or 1000.0 % self.rate_hz != 0.0:
            raise ValueError(f"rate_hz must divide 1000, got {self.rate_hz}")


@dataclass(frozen=True, slots=True)
class ReflexParameters:
    """What the robot tolerates: factor on the torque range, rad/s over the velocity limit, ms unanswered.

    first_command_timeout_ms: unanswered from Move to the first command of the motion, while the arm is held. walls: of
    the end effector, m along the base's axes; largest_power: W; swing: a joint's, rad/s, Hz.
    """

    tau_J_overload: Positive
    velocity_tolerance: NotNegative
    communication_timeout_ms: PositiveInt
    first_command_timeout_ms: PositiveInt
    walls_lower: Vector3
    walls_upper: Vector3
    largest_power: Positive
    swing_velocity: Positive
    swing_rate_hz: Positive

    def __post_init__(self) -> None:
        if any(low >= high for low, high in zip(self.walls_lower, self.walls_upper, strict=True)):
            raise ValueError(f"walls_lower must lie below walls_upper: {self.walls_lower}, {self.walls_upper}")


@dataclass(frozen=True, slots=True)
class PlantParameters:
    """Everything about the plant that is not the scene."""

    joints: JointParameters
    scatter: Scatter
    holding: Holding
    sensors: SensorParameters
    tracker: TrackerParameters
    reflexes: ReflexParameters

    def of(self, model: RobotModel) -> "PlantParameters":
        """Return these with the joints of the model's own file, if it has [plant]. Raises ConfigurationError."""
        if not model.plant:
            return self
        own = asdict(self.joints) | dict(model.plant)
        return replace(self, joints=from_document(own, JointParameters, f"{model.reference}: plant"))

    def nominal(self) -> "PlantParameters":
        """Return the same plant without scatter, noise and quantisation. Friction, filters, limits stay."""
        silent: dict[str, Any] = dict.fromkeys(("q_quantum", "q_noise", "dq_noise", "theta_noise", "dtheta_noise"), 0.0)
        silent |= dict.fromkeys(("tau_J_noise", "tau_ext_noise"), ZEROS)
        return replace(
            self,
            scatter=Scatter(*(0.0 for _ in fields(Scatter))),
            sensors=replace(self.sensors, **silent),
            tracker=replace(self.tracker, position_noise_mm=0.0, orientation_noise_deg=0.0),
        )


def load_plant_parameters(path: Path | None = None) -> PlantParameters:
    """Read the plant's parameters, the package's own by default. Raises ConfigurationError, naming the key."""
    return load_toml(path or OWN_FILES / "parameters" / "plant.toml", PlantParameters)
