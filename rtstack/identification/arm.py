"""What the logs of an arm say about it, joint by joint and of its load.

The motor's side, with what the robot adds for gravity, and what its sensors show:

    B_theta ddtheta = tau_d + gamma g(q) - tau_J - friction(dtheta)        (4) and (8) of the impact-map paper
    tau_J = K (theta - q) + D (dtheta - dq)
    tau_J = M(q) ddq + C(q, dq) dq + g(q) + what is on the flange beside the pad that the description has

All signals are smoothed alike, by cubics over 31 ms, which leaves these equations as they are.
"""

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace

import numpy as np
import pinocchio as pin
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray
from scipy.signal import savgol_coeffs, savgol_filter

from hal.base.arrays import Array
from rtstack.identification.estimate import Estimate, curve, linear
from rtstack.identification.fit import sigmoid

WINDOW, EVERY = 31, 7  # ticks: of the cubics, and between two samples
SMOOTH = savgol_coeffs(WINDOW, 3)
PERIOD_S = 1e-3
BLOCK_S = 0.5  # ticks that share their errors: the tones of an excitation are 1 to 4 s long
CONTACT_N = 5.0  # of the estimated force, from how it begins: beyond it a tick does not count, nor those around it
FREE_TICKS = 300  # a log begins away from everything
GRAVITY_NM = 0.2  # of a joint's gravity torque, standard deviation: below it the compensation is not seen
SHAPES = 8
LATE_S = 0.05  # of the two shapes that stand for a signal that is late
# how far the gravity compensation, and each of the shapes, may be off, standard deviations, and the torque of a tick
# against which these count
GRAVITY_PRIOR, SHAPE_PRIOR_NM, PRIOR_NM = 0.02, 0.02, 0.02
RANK = 1e-5  # of the links' regressors: below it a direction of the inertial parameters has no effect on the torques
FITTED = 0.8  # of each log's ticks, where no log is held out: the last ones are judged on, and never fitted


@dataclass(frozen=True, slots=True)
class ArmSamples:
    """Ticks (n,) without contact. Joints (n, 7), SI units; torques: through the joint, commanded, estimated external.
    model: of the arm as its cell's file describes it. slip (n, 7, WINDOW): the motors' velocity around each tick, since
    friction is no linear function of it, and what is smoothed is the friction. blocks: which ticks are neighbours.
    held_out: not to be fitted."""

    model: pin.Model
    q: Array
    dq: Array
    ddq: Array
    wind: Array
    dwind: Array
    slip: Array
    ddtheta: Array
    tau_J: Array
    dtau_J: Array
    tau_d: Array
    dtau_d: Array
    tau_ext: Array
    blocks: NDArray[np.int64]
    held_out: NDArray[np.bool_]


@dataclass(frozen=True, slots=True)
class Joint:
    """A joint: friction p1 Nm, p2 s/rad, p3 rad/s, B_theta kg m^2 and gravity_factor; K Nm/rad and D Nms/rad."""

    motor: Estimate
    spring: Estimate

    MOTOR = ("friction_p1", "friction_p2", "friction_p3", "B_theta", "gravity_factor")
    SPRING = ("K", "D")


def arm_samples(model: pin.Model, logs: Sequence[NDArray], held_out: Sequence[NDArray] = ()) -> ArmSamples:
    """Return the samples of ARM_SAMPLE records (n,) of one arm, one array a log. held_out: logs that are not fitted;
    without any, the end of each log is not."""
    shares = [1.0 if held_out else FITTED] * len(logs) + [0.0] * len(held_out)
    parts = [
        _samples(log, number, share) for number, (log, share) in enumerate(zip([*logs, *held_out], shares, strict=True))
    ]
    return ArmSamples(model, *(np.concatenate(columns) for columns in zip(*parts, strict=True)))


def smooth(values: Array) -> Array:
    """Return values (n, ...), a tick each, by cubics over WINDOW ticks."""
    return np.asarray(savgol_filter(values, WINDOW, 3, axis=0))


def rate(values: Array) -> Array:
    """Return the rate of what is smoothed as all else is, and not a cubic's derivative."""
    return np.gradient(smooth(values), PERIOD_S, axis=0)


def touches(log: NDArray) -> NDArray[np.bool_]:
    """Return in which ticks (n,) the estimated force is no longer as it begins."""
    force = log["O_F_ext_hat_K"][:, :3] - np.median(log["O_F_ext_hat_K"][:FREE_TICKS, :3], axis=0)
    return np.linalg.norm(force, axis=1) > CONTACT_N


def _samples(log: NDArray, number: int, fitted: float) -> tuple[NDArray, ...]:
    touched = np.convolve(touches(log), np.ones(4 * WINDOW), "same") > 0.0
    ticks = np.arange(WINDOW, len(log) - WINDOW, EVERY)
    ticks = ticks[~touched[ticks]]
    # what was commanded acts until the next state
    tau_d = 0.5 * (log["tau_applied"] + np.roll(log["tau_applied"], 1, axis=0))
    wind = log["theta"] - log["q"]
    values = (
        smooth(log["q"]), smooth(log["dq"]), rate(log["dq"]), smooth(wind), smooth(log["dtheta"] - log["dq"]),
        _around(log["dtheta"]), rate(log["dtheta"]), smooth(log["tau_J"]), rate(log["tau_J"]),
        smooth(tau_d), rate(tau_d), smooth(log["tau_ext_hat_filtered"]),
    )  # fmt: skip
    blocks = 100_000 * number + (ticks * PERIOD_S / BLOCK_S).astype(np.int64)
    return (*(each[ticks] for each in values), blocks, np.arange(len(ticks)) >= fitted * len(ticks))


def _around(values: Array) -> Array:
    """Return a view (n, 7, WINDOW) of values (n, 7): each tick with its neighbours; wrong at both ends."""
    half = WINDOW // 2
    return sliding_window_view(np.pad(values, ((half, half), (0, 0)), "edge"), WINDOW, axis=0)


@dataclass(frozen=True, slots=True)
class Links:
    """The links' side of an arm, over the ticks (n,) of its samples with the payload, then of those without it.
    samples: all of them. torque: through the joints (n, 7) Nm; gravity: the part of it that is gravity's; shapes (7, n,
    SHAPES): what else it could be along the motion, of size one, the most likely first; what the commanded torque and
    the robot's own compensation, which act late, change in LATE_S; and a constant. payload: mass kg and first moment
    (3,) kg m in the last link's frame; infinitely uncertain without samples of the arm without it. inertial (70,): what
    the description lacks, of the arm in `samples` with its payload, and without it."""

    samples: ArmSamples
    torque: Array
    gravity: Array
    shapes: Array
    payload: Estimate
    inertial: tuple[Array, Array]


def links(samples: ArmSamples, bare: ArmSamples | None = None) -> Links:
    """Fit the inertial parameters that explain the torques; those of no effect on them stay the description's. bare: of
    the same arm without its payload, fitted together: what the description lacks, which both have, and what the last
    link carries in `samples` alone, so that the payload's interval has what is open of the links."""
    together = samples
    if bare is not None:
        bare = replace(bare, blocks=bare.blocks + samples.blocks.max() + 1)
        names = [field.name for field in fields(ArmSamples)[1:]]
        both = (np.concatenate([getattr(samples, name), getattr(bare, name)]) for name in names)
        together = ArmSamples(samples.model, *both)
    n = len(together.q)
    Y, Y_gravity, described = _regressors(together)
    if bare is not None:
        carried = (np.arange(n) < len(samples.q))[:, None, None]
        Y, Y_gravity = (np.concatenate([each, np.where(carried, each[:, :, 60:], 0.0)], axis=2)
                        for each in (Y, Y_gravity))  # fmt: skip
    left, use = together.tau_J - described[0], ~together.held_out
    blocks = np.repeat(together.blocks[use], 7)

    def weighted(weights: Array) -> Estimate:
        X, y = (Y * weights[:, None])[use].reshape(-1, Y.shape[2]), (left * weights)[use].reshape(-1)
        return linear(X, y, blocks, rank=RANK)

    found = weighted(np.ones(7))
    # joints whose torque is measured better count more
    found = weighted(1.0 / np.maximum((left - Y @ found.value)[use].std(axis=0), 1e-4))
    gravity_left = Y_gravity @ found.value
    shapes = np.ones((7, n, SHAPES))
    for j in range(7):
        columns, sizes, _ = np.linalg.svd(Y_gravity[:, j], full_matrices=False)
        shapes[j, :, :-3] = columns[:, : SHAPES - 3] * np.where(sizes[: SHAPES - 3] > 1e-6, np.sqrt(n), 0.0)
    shapes[:, :, -3], shapes[:, :, -2] = LATE_S * together.dtau_d.T, LATE_S * described[2].T
    payload = Estimate(np.zeros(4), np.full(4, np.inf))
    without, loaded = found.value[:70], found.value[:70].copy()
    if bare is not None:
        loaded[60:] += found.value[70:]
        payload = Estimate(found.value[70:74], found.half_width[70:74])
    return Links(
        together, described[0] + Y @ found.value, described[1] + gravity_left, shapes, payload, (loaded, without)
    )


def _regressors(samples: ArmSamples) -> tuple[Array, Array, tuple[Array, Array, Array]]:
    """Return what inertial parameters do to the torques (n, 7, 70), to gravity's, and both as described (n, 7), with
    gravity's rate, Nm/s."""
    data = samples.model.createData()
    n, rest = len(samples.q), np.zeros(7)
    Y, Y_gravity = np.empty((n, 7, 70)), np.empty((n, 7, 70))
    torque, gravity, rate = np.empty((n, 7)), np.empty((n, 7)), np.empty((n, 7))
    for k, (q, dq, ddq) in enumerate(zip(samples.q, samples.dq, samples.ddq, strict=True)):
        Y[k] = pin.computeJointTorqueRegressor(samples.model, data, q, dq, ddq)
        torque[k] = pin.rnea(samples.model, data, q, dq, ddq)
        Y_gravity[k] = pin.computeJointTorqueRegressor(samples.model, data, q, rest, rest)
        gravity[k] = pin.computeGeneralizedGravity(samples.model, data, q)
        rate[k] = pin.computeGeneralizedGravity(samples.model, data, q + PERIOD_S * dq) - gravity[k]
    return Y, Y_gravity, (torque, gravity, rate / PERIOD_S)


def joint(link: Links, j: int, friction: Sequence[float], B_theta: float) -> Joint:
    """Fit joint 0 to 6, from friction and B_theta on. One without gravity tells nothing of its compensation."""
    samples = link.samples
    use = ~samples.held_out
    blocks = samples.blocks[use]
    heavy = link.gravity[use, j].std() > GRAVITY_NM
    prior = blocks.max() + 1 + np.arange(1 + SHAPES)  # blocks of their own
    free = np.full(SHAPES, 1.0)

    def residual(x: Array) -> Array:
        left = predicted(link, j, x)[use] - samples.tau_J[use, j]
        return np.concatenate([left, PRIOR_NM * np.append((x[4] - 1.0) / GRAVITY_PRIOR, x[5:] / SHAPE_PRIOR_NM)])

    motor = curve(
        residual, np.array([*friction, B_theta, 1.0, *(0.0 * free)]),
        (np.array([0.0, 0.5, -0.3, 0.0, 0.5, *-free]), np.array([20.0, 100.0, 0.3, 2.0, 1.5, *free])),
        np.array([1.0, 10.0, 0.05, 0.1, 0.1, *(0.1 * free)]), np.concatenate([blocks, prior]),
    )  # fmt: skip
    if not heavy:
        motor.half_width[4] = np.inf
    one = np.ones(int(use.sum()))
    X = np.column_stack([samples.wind[use, j], samples.dwind[use, j], one])
    Z = np.column_stack([link.torque[use, j], samples.dtau_J[use, j], one])  # without the encoders' noise
    spring = linear(X, samples.tau_J[use, j], blocks, Z)
    return Joint(motor, Estimate(spring.value[:2], spring.half_width[:2]))


def predicted(link: Links, j: int, x: Array) -> Array:
    """Return the torque through a joint (n,) as the motor's side has it. x: Joint.MOTOR, and how much of each shape."""
    samples = link.samples
    resisted = sigmoid(samples.slip[:, j], *x[:3]) @ SMOOTH + x[3] * samples.ddtheta[:, j]
    return samples.tau_d[:, j] + x[4] * link.gravity[:, j] + link.shapes[j] @ x[5:] - resisted


def bias(samples: ArmSamples) -> Estimate:
    """Return what the estimate of the external torque (7,) shows where nothing is touched, Nm."""
    use = ~samples.held_out
    each = [linear(np.ones((int(use.sum()), 1)), samples.tau_ext[use, j], samples.blocks[use]) for j in range(7)]
    return Estimate(np.array([e.value[0] for e in each]), np.array([e.half_width[0] for e in each]))
