"""What a client can set on an arm, with the values that hold until it does, and the limits that it cannot set."""

import numpy as np

from hal.base.arrays import Array
from hal.limits import COLLISION_TORQUES
from hal.pad import Pad
from hal.robots import RobotModel
from sim_robot.arm_description import JOINTS
from sim_robot.hand_parameters import FrankaHand

# Transforms are row-major here. thresholds: lower and upper while accelerating, lower and upper at constant velocity.
SETTINGS_RECORD = np.dtype(
    [
        *((name, "f8", (4, 4)) for name in ("F_T_EE", "EE_T_K", "F_T_NE", "NE_T_EE")),
        ("face_T_EE", "f8", (4, 4)),  # from the pad's face, where the sensors estimate the wrench
        ("face_T_K", "f8", (4, 4)),
        ("face_T_F", "f8", (4, 4)),  # the flange in the pad's face
        ("m_ee", "f8"),
        ("I_ee", "f8", 9),
        ("F_x_Cee", "f8", 3),
        ("m_load", "f8"),
        ("I_load", "f8", 9),
        ("F_x_Cload", "f8", 3),
        ("torque_thresholds", "f8", (4, JOINTS)),
        ("force_thresholds", "f8", (4, 6)),
        ("K_theta", "f8", JOINTS),
        ("K_x", "f8", 6),
        # of the model: rows q_lower, q_upper, dq_max, velocity_offset, deceleration, ddq_max, dddq_max, tau_max; and
        # velocity, acceleration and jerk of translation, rotation and elbow
        ("joint_limits", "f8", (8, JOINTS)),
        ("cartesian_limits", "f8", (3, 3)),
    ]
)

# Contact flags: the values of the vendor's own examples. Collision flags: generous, because what the robot has before
# SetCollisionBehavior is not published; an ordinary grab at 0.4 m/s passes, see tests/fci.
CONTACT_TORQUES = (20.0, 20.0, 18.0, 18.0, 16.0, 14.0, 12.0)
CONTACT_FORCES = (20.0, 20.0, 20.0, 25.0, 25.0, 25.0)
COLLISION_FORCES = (250.0, 250.0, 250.0, 80.0, 80.0, 80.0)
LARGEST_JOINT_STIFFNESS = 14250.0  # Nm/rad, SetJointImpedance of the interface
LARGEST_TRANSLATION_STIFFNESS, LARGEST_ROTATION_STIFFNESS = 3000.0, 300.0  # SetCartesianImpedance
LARGEST_LOAD_KG = 10.0


class InvalidSetting(ValueError):
    """A value that the robot refuses."""


def _transform(values: tuple[float, ...]) -> Array:
    """Return a checked transform from the wire's 16 numbers, column-major. Raises InvalidSetting."""
    T = np.array(values).reshape(4, 4).T
    if not np.all(np.isfinite(T)) or np.abs(T[3] - (0, 0, 0, 1)).max() > 1e-6:
        raise InvalidSetting("not a transform")
    if np.abs(T[:3, :3].T @ T[:3, :3] - np.eye(3)).max() > 1e-3 or np.linalg.det(T[:3, :3]) < 0.0:
        raise InvalidSetting("not a rotation")
    return T


def _within(values: Array, lower: float, upper: Array | float) -> Array:
    if not np.all(np.isfinite(values)) or np.any(values < lower) or np.any(values > upper):
        raise InvalidSetting("out of range")
    return values


class Settings:
    """One arm's settings; `record` is one SETTINGS_RECORD. A setter that raises InvalidSetting changes nothing."""

    def __init__(
        self, record: np.void, model: RobotModel, pad: Pad, joint_stiffness: tuple[float, ...], hand: FrankaHand | None
    ) -> None:
        """hand: what Desk has set as the end effector instead of the pad."""
        self.record = record
        limits, cartesian = model.limits, model.cartesian
        record["joint_limits"] = [
            limits.q_lower, limits.q_upper, limits.dq_max, *limits.enforced_velocity_law(), limits.ddq_max,
            limits.dddq_max, limits.tau_max,
        ]  # fmt: skip
        record["cartesian_limits"] = cartesian.translation, cartesian.rotation, cartesian.elbow
        record["F_T_NE"] = pad.F_T_face
        record["NE_T_EE"], record["EE_T_K"] = np.eye(4), np.eye(4)
        record["m_ee"] = pad.mass
        record["F_x_Cee"], record["I_ee"] = pad.F_x_centre, pad.I_centre.ravel()
        record["face_T_F"] = np.linalg.inv(pad.F_T_face)
        self._face_T_NE = np.eye(4)
        if hand is not None:
            record["F_T_NE"], record["m_ee"], record["F_x_Cee"] = hand.F_T_NE(), hand.mass, hand.centre
            record["I_ee"] = np.diag(hand.inertia).ravel()
            self._face_T_NE[:3, :3] = record["F_T_NE"][:3, :3]  # the face has the flange's axes
            record["face_T_F"] = np.eye(4)
            record["face_T_F"][2, 3] = -hand.tip_offset_z
        record["torque_thresholds"] = (CONTACT_TORQUES, COLLISION_TORQUES) * 2
        record["force_thresholds"] = (CONTACT_FORCES, COLLISION_FORCES) * 2
        record["K_theta"] = joint_stiffness
        record["K_x"] = (LARGEST_TRANSLATION_STIFFNESS,) * 3 + (LARGEST_ROTATION_STIFFNESS,) * 3
        self._chain()

    def _chain(self) -> None:
        record = self.record
        record["F_T_EE"] = record["F_T_NE"] @ record["NE_T_EE"]
        # exactly the identity for the default: the wire then carries the sensors' own numbers
        record["face_T_EE"] = self._face_T_NE @ record["NE_T_EE"]
        record["face_T_K"] = record["face_T_EE"] @ record["EE_T_K"]

    def set_frame(self, name: str, values: tuple[float, ...]) -> None:
        """Place NE_T_EE, or EE_T_K, the stiffness frame in the end effector. values: 16 numbers, column-major."""
        self.record[name] = _transform(values)
        self._chain()

    def set_load(self, values: tuple[float, ...]) -> None:
        """Set mass kg, centre in the flange's frame (3,) m, and inertia (9,) kg m^2, column-major."""
        mass, centre, inertia = values[0], np.array(values[1:4]), np.array(values[4:])
        _within(np.array(mass), 0.0, LARGEST_LOAD_KG)
        _within(centre, -2.0, 2.0)
        _within(np.linalg.eigvalsh(_within(inertia, -10.0, 10.0).reshape(3, 3)).astype(float), -1e-9, 10.0)
        self.record["m_load"], self.record["F_x_Cload"], self.record["I_load"] = mass, centre, inertia

    def set_collision_behavior(self, values: tuple[float, ...]) -> None:
        """Set 52 thresholds as on the wire, Nm and N: the lower ones raise contact flags, the upper ones stop."""
        thresholds = _within(np.array(values), 0.0, np.inf)
        self.record["torque_thresholds"] = thresholds[:28].reshape(4, 7)
        self.record["force_thresholds"] = thresholds[28:].reshape(4, 6)

    def set_joint_impedance(self, values: tuple[float, ...]) -> None:
        """Set the joint impedance controller's stiffness, (7,) Nm/rad."""
        self.record["K_theta"] = _within(np.array(values), 0.0, LARGEST_JOINT_STIFFNESS)

    def set_cartesian_impedance(self, values: tuple[float, ...]) -> None:
        """Set the Cartesian impedance controller's stiffness, (6,) N/m and Nm/rad."""
        limits = np.repeat((LARGEST_TRANSLATION_STIFFNESS, LARGEST_ROTATION_STIFFNESS), 3)
        self.record["K_x"] = _within(np.array(values), 0.0, limits)
