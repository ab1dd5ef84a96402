"""The judge in plain Python, from the definitions of its limits (hal.limits, rtstack.safety.limits): slow and obvious.

Kinematics by homogeneous matrices of the vendor's published Denavit-Hartenberg table; velocities by differences.
"""

from collections.abc import Mapping
from math import cos, hypot, isfinite, pi, sin, sqrt

import numpy as np

from hal.robots import FR3
from rtstack.safety.judge import Base, Cause, SafetyLimits

# Craig's convention: a of the previous link, d, alpha of the previous link; the flange last
DH = [
    (0.0, 0.333, 0.0), (0.0, 0.0, -pi / 2), (0.0, 0.316, pi / 2), (0.0825, 0.0, pi / 2), (-0.0825, 0.384, -pi / 2),
    (0.0, 0.0, pi / 2), (0.088, 0.0, pi / 2), (0.0, 0.107, 0.0),
]  # fmt: skip
BRAKING = [max(a, b) for a, b in zip(FR3.limits.ddq_max, FR3.limits.deceleration, strict=True)]
REACTION_S = 2e-3
Sample = np.ndarray | Mapping[str, np.ndarray]  # (1,) of ARM_SAMPLE, or its fields


def frames(q: np.ndarray, base: Base) -> list[np.ndarray]:
    """Return T_world_link of link 0 to 7 and of the flange."""
    w, x, y, z = np.array(base.orientation_wxyz) / np.linalg.norm(base.orientation_wxyz)
    vector = np.array([x, y, z])
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    T = np.eye(4)
    T[:3, :3] = np.outer(vector, vector) + w * w * np.eye(3) + 2 * w * cross + cross @ cross
    T[:3, 3] = base.position
    found = [T]
    for (a, d, alpha), theta in zip(DH, [*q, 0.0], strict=True):
        T = T @ np.array(
            [
                [cos(theta), -sin(theta), 0, a],
                [sin(theta) * cos(alpha), cos(theta) * cos(alpha), -sin(alpha), -d * sin(alpha)],
                [sin(theta) * sin(alpha), cos(theta) * sin(alpha), cos(alpha), d * cos(alpha)],
                [0, 0, 0, 1],
            ]
        )
        found.append(T)
    return found


def face(q: np.ndarray, base: Base, flange_to_face: float = 0.03) -> np.ndarray:
    """Return the pad's face in the world, m."""
    return (frames(q, base)[-1] @ [0.0, 0.0, flange_to_face, 1.0])[:3]


def face_velocity(q: np.ndarray, dq: np.ndarray, base: Base) -> np.ndarray:
    """Return its velocity, by central differences: exact to 1e-8."""
    h = 1e-6
    return (face(q + h * dq, base) - face(q - h * dq, base)) / (2 * h)


# ends and radius in the link's frame: what hal/robots/franka.urdf draws, and the pad as the judge bounds it
CAPSULES = [
    (0, (-0.09, 0, 0.06), (-0.06, 0, 0.06), 0.06), (1, (0, 0, -0.333), (0, 0, -0.05), 0.06),
    (2, (0, 0, -0.06), (0, 0, 0.06), 0.06), (3, (0, 0, -0.22), (0, 0, -0.07), 0.06),
    (4, (0, 0, -0.06), (0, 0, 0.06), 0.06), (5, (0, 0, -0.31), (0, 0, -0.21), 0.06),
    (5, (0, 0.08, -0.2), (0, 0.08, -0.06), 0.025), (6, (0, 0, -0.07), (0, 0, 0.01), 0.05),
    (7, (0, 0, -0.06), (0, 0, 0.08), 0.04), (8, (-0.05, 0, 0.015), (0.05, 0, 0.015), hypot(0.05, 0.015)),
]  # fmt: skip


def nearest(a, b, c, d) -> float:
    """Return the distance of two segments: of all inner minima and of all ends, the smallest."""
    a, b, c, d = map(np.asarray, (a, b, c, d))
    u, v = b - a, d - c

    def to_segment(p, start, along) -> float:
        s = np.clip((p - start) @ along / (along @ along), 0.0, 1.0)
        return float(np.linalg.norm(p - start - s * along))

    best = min(to_segment(a, c, v), to_segment(b, c, v), to_segment(c, a, u), to_segment(d, a, u))
    matrix = np.array([[u @ u, -u @ v], [-u @ v, v @ v]])
    if np.linalg.det(matrix) > 1e-14:
        s, t = np.linalg.solve(matrix, [-u @ (a - c), v @ (a - c)])
        if 0.0 <= s <= 1.0 and 0.0 <= t <= 1.0:
            best = min(best, float(np.linalg.norm(a + s * u - c - t * v)))
    return best


def distance(q_left: np.ndarray, q_right: np.ndarray, left: Base, right: Base) -> float:
    """Return the smallest distance of a capsule of one arm to one of the other, m."""
    sets = []
    for q, base in ((q_left, left), (q_right, right)):
        T = frames(q, base)
        sets.append([((T[k] @ [*a, 1.0])[:3], (T[k] @ [*b, 1.0])[:3], r) for k, a, b, r in CAPSULES])
    return min(nearest(a, b, c, d) - r - s for a, b, r in sets[0] for c, d, s in sets[1])


def joint_reason(sample: Sample, residual: np.ndarray, limits: SafetyLimits) -> tuple[Cause, int]:
    """Return why a stop is needed by a joint's values, and which joint (1 to 7, 0 the whole arm)."""
    for i in range(7):
        names = ("q", "dq", "tau_J", "tau_ext_hat_filtered", "tau_desired")
        if not all(isfinite(sample[n][0, i]) for n in names) or not isfinite(residual[i]):
            return Cause.NOT_FINITE, i + 1
    if not np.isfinite(sample["O_F_ext_hat_K"]).all() or not np.isfinite(sample["O_T_EE"]).all():
        return Cause.NOT_FINITE, 0
    for i in range(7):
        q, dq = float(sample["q"][0, i]), float(sample["dq"][0, i])
        travel = dq * REACTION_S + dq * abs(dq) / (2.0 * BRAKING[i])
        end = q + travel
        lower, upper = limits.q_lower[i], limits.q_upper[i]
        if not (lower <= q <= upper and lower <= end <= upper):
            return Cause.JOINT_POSITION, i + 1
        room = upper - q if dq > 0 else q - lower
        allowed = sqrt(2.0 * FR3.limits.deceleration[i] * room) - FR3.limits.velocity_offset[i]
        if abs(dq) > min(limits.dq_max[i], max(0.0, allowed)):
            return Cause.JOINT_VELOCITY, i + 1
        if not -limits.tau_J_max[i] <= sample["tau_J"][0, i] <= limits.tau_J_max[i]:
            return Cause.MEASURED_TORQUE, i + 1
        if not -limits.tau_ext_max[i] <= sample["tau_ext_hat_filtered"][0, i] <= limits.tau_ext_max[i]:
            return Cause.EXTERNAL_TORQUE, i + 1
        if not -limits.tau_ext_max[i] <= residual[i] <= limits.tau_ext_max[i]:
            return Cause.RESIDUAL, i + 1
    if np.linalg.norm(sample["O_F_ext_hat_K"][0, :3]) > limits.force_max:
        return Cause.FORCE, 0
    return Cause.NONE, 0


def arm_reason(sample: Sample, base: Base, limits: SafetyLimits) -> tuple[Cause, float]:
    """Return why the arm as a whole needs a stop, and how far, relatively, the closest of these limits is."""
    place, velocity = face(sample["q"][0], base), face_velocity(sample["q"][0], sample["dq"][0], base)
    speed, power = float(np.linalg.norm(velocity)), abs(float(sample["tau_J"][0] @ sample["dq"][0]))
    rooms = [*(place - limits.ee_lower), *(limits.ee_upper - place)]
    rooms += [limits.ee_speed_max - speed, limits.power_max - power]
    margin = min(abs(room) for room in rooms)
    if min(rooms[:6]) < 0:
        return Cause.WORKSPACE, margin
    if rooms[6] < 0:
        return Cause.SPEED, margin
    return (Cause.POWER if rooms[7] < 0 else Cause.NONE), margin


def limited(desired: np.ndarray, last: np.ndarray, limits: SafetyLimits) -> np.ndarray:
    """Return the torque (7,) nearest to the desired one that keeps torque and torque rate."""
    step = limits.tau_rate_max * 1e-3 * (1.0 - 1e-4)
    tau = np.clip(desired, -np.array(limits.tau_max), limits.tau_max)
    return np.clip(tau, last - step, last + step)
