"""The plant's parameters: nominal values, seeded scatter, noise. From a file that only the plant reads."""

from collections.abc import Iterable
from dataclasses import asdict, dataclass, fields, replace
from pathlib import Path
from typing import Any

from hal.base.arrays import Seven
from hal.base.configuration import from_document, load_toml
from hal.robots import RobotModel

OWN_FILES = Path(__file__).parent  # scenes, parameters: data of the package
Vector3 = tuple[float, float, float]
ZEROS: Seven = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


def check_signs(record: object, positive: Iterable[str], not_negative: Iterable[str] = ()) -> None:
    """Raise ValueError for a field whose number, or one of whose numbers, is not as it has to be. None is left out."""
    for names, needed in ((positive, "be positive"), (not_negative, "not be negative")):
        for name in names:
            value = getattr(record, name)
            for item in value if isinstance(value, tuple) else (value,):
                if item is not None and not (item > 0.0 or (item == 0.0 and names is not_negative)):
                    raise ValueError(f"{name} must {needed}, got {item}")


@dataclass(frozen=True, slots=True)
class JointParameters:
    """Seven flexible joints: B, B_theta kg m^2; K Nm/rad; D Nms/rad; friction p1 Nm, p2 s/rad, p3 rad/s."""

    B: Seven
    B_theta: Seven
    K: Seven
    D: Seven
    friction_p1: Seven
    friction_p2: Seven
    friction_p3: Seven

    def __post_init__(self) -> None:
        check_signs(self, ("B", "B_theta", "K"), ("D", "friction_p1", "friction_p2"))


@dataclass(frozen=True, slots=True)
class Scatter:
    """Standard deviations of what differs from the nominal plant, as fractions (link_centre_mm in mm)."""

    link_mass: float
    link_inertia: float
    link_centre_mm: float
    joint_stiffness: float
    joint_damping: float
    motor_inertia: float
    friction: float
    gravity_compensation: float

    def __post_init__(self) -> None:
        check_signs(self, (), tuple(self.__slots__))


@dataclass(frozen=True, slots=True)
class Holding:
    """The robot's own joint impedance, Nm/rad."""

    stiffness: Seven

    def __post_init__(self) -> None:
        check_signs(self, ("stiffness",))


@dataclass(frozen=True, slots=True)
class SensorParameters:
    """Noise (standard deviations), quantisation and filters of what the robot reports. SI units, Hz."""

    q_quantum: float
    q_noise: float
    dq_noise: float
    theta_noise: float
    dtheta_noise: float
    tau_J_noise: Seven
    dtau_J_cutoff_hz: float
    tau_ext_cutoff_hz: float
    tau_ext_noise: Seven
    smallest_singular_value: float
    wrench_damping: float

    def __post_init__(self) -> None:
        positive = ("dtau_J_cutoff_hz", "tau_ext_cutoff_hz", "smallest_singular_value")
        check_signs(self, positive, tuple(name for name in self.__slots__ if name not in positive))


@dataclass(frozen=True, slots=True)
class TrackerParameters:
    """Motion capture: rate Hz and noise."""

    rate_hz: float
    position_noise_mm: float
    orientation_noise_deg: float

    def __post_init__(self) -> None:
        check_signs(self, ("rate_hz",), ("position_noise_mm", "orientation_noise_deg"))
        if self.rate_hz > 1000.0 or 1000.0 % self.rate_hz != 0.0:
            raise ValueError(f"rate_hz must divide 1000, got {self.rate_hz}")


@dataclass(frozen=True, slots=True)
class ReflexParameters:
    """What the robot tolerates: factor on the torque range, rad/s over the velocity limit, ms unanswered.

    first_command_timeout_ms: unanswered from Move to the first command of the motion, while the arm is held. walls: of
    the end effector, m along the base's axes; largest_power: W; swing: a joint's, rad/s, Hz.
    """

    tau_J_overload: float
    velocity_tolerance: float
    communication_timeout_ms: int
    first_command_timeout_ms: int
    walls_lower: Vector3
    walls_upper: Vector3
    largest_power: float
    swing_velocity: float
    swing_rate_hz: float

    def __post_init__(self) -> None:
        timeouts, swing = ("communication_timeout_ms", "first_command_timeout_ms"), ("swing_velocity", "swing_rate_hz")
        positive = ("tau_J_overload", *timeouts, "largest_power", *swing)
        check_signs(self, positive, ("velocity_tolerance",))
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
        """Return these with the joints of the model's own file, where its table [plant] has some. Raises
        ConfigurationError."""
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
