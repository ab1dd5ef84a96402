"""What an arm carries beside what its robot was told, by least squares from its external torques at rest."""

from dataclasses import dataclass

import numpy as np
import pinocchio as pin
import scipy  # loads its statistics when they are used: half a second

from hal.base.arrays import Array
from hal.robots.description import FLANGE
from rtstack.calibration.fit import CONFIDENCE, CalibrationError

FEWEST = 3  # postures: four numbers of the load, and an offset of each joint's torque


@dataclass(frozen=True, slots=True)
class Payload:
    """mass kg and centre (3,) m in the flange's frame, of all that is on the flange; half widths of their 95 %
    intervals; rms_nm: what is left of a joint's torque, beside an offset of its own."""

    mass: float
    centre: Array
    mass_half: float
    centre_half: Array
    rms_nm: float


def payload(model: pin.Model, told: tuple[float, Array], q: Array, tau_ext: Array) -> Payload:
    """Fit the load that explains external torques tau_ext (n, 7), Nm, of an arm that rests at q (n, 7), rad, beside an
    offset of each joint.

    model: of the arm in the world; told: mass, kg, and centre (3,), m in the flange's frame, that the robot counts on.
    Raises CalibrationError.
    """
    if len(q) < FEWEST:
        raise CalibrationError(f"the payload takes {FEWEST} postures at rest, not {len(q)}")
    data, still = model.createData(), np.zeros(7)
    flange = model.frames[model.getFrameId(FLANGE)].placement
    # of a mass and of its first moments along the axes of the last joint; those of the flange are turned against them
    to_joint = np.zeros((4, 4))
    to_joint[0, 0], to_joint[1:, 0], to_joint[1:, 1:] = 1.0, flange.translation, flange.rotation
    regressors = [pin.computeJointTorqueRegressor(model, data, row, still, still)[:, -10:-6] @ to_joint for row in q]
    X = np.vstack([np.hstack([Y, np.eye(7)]) for Y in regressors])
    y = tau_ext.ravel()
    if np.linalg.cond(X) > 1e4:
        raise CalibrationError("the postures at rest are too much alike: turn the pads, upwards and sideways too")
    found, *_ = np.linalg.lstsq(X, y, rcond=None)
    freedom = len(y) - X.shape[1]
    variance = float(np.sum((y - X @ found) ** 2)) / freedom
    mass = told[0] + found[0]
    moment = told[0] * told[1] + found[1:4]
    if mass <= 0.0:
        raise CalibrationError(f"the torques at rest need a load of {mass:.2f} kg: is the robot told the pad's mass?")
    centre = moment / mass
    covariance = variance * np.linalg.inv(X.T @ X)[:4, :4]
    # centre = moment / mass, linearised
    D = np.hstack([-centre[:, None], np.eye(3)]) / mass
    quantile = float(scipy.stats.t.ppf(0.5 + CONFIDENCE / 2.0, freedom))
    half = quantile * np.sqrt(np.diag(D @ covariance @ D.T))
    return Payload(mass, centre, quantile * float(np.sqrt(covariance[0, 0])), half, float(np.sqrt(variance)))
