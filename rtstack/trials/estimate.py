"""What the robots estimate as force while nothing touches the pads: the offset that a detector has to cope with. On
metal it reads 2 N without a tool, changes with the pose, and grows by 9.8 N with each kg that the payload is off."""

import numpy as np
from numpy.typing import NDArray

from hal.cell import Cell
from hal.state import ArmState
from rtstack.control.parameters import DetectorParameters
from rtstack.model.arm_model import ArmModel
from rtstack.model.cell_description import CellDescription, base_frame
from rtstack.references.demonstration import end_effector_pose
from rtstack.safety.limits import ForcePhase
from rtstack.trials.errors import TrialError
from rtstack.trials.tightening import limits_of_arms

LOOKS = 50  # states: 50 ms
# of the largest tare: what is left is for how much the offset changes on the way from here to the object
REST_SHARE = 0.75


def resting_force(cell: Cell, description: CellDescription, looks: int = LOOKS) -> NDArray[np.float64]:
    """Return the mean force (arms, 3) of each pad on its surroundings over so many states, N, along the world's axes.
    Raises HardwareError."""
    forces = np.zeros((len(cell.arms), 3))
    for _ in range(looks):
        for side, arm in enumerate(cell.arms):
            forces[side] += arm.read().O_F_ext_hat_K[:3] / looks
    return np.stack([
        base_frame(mounting).rotation @ force
        for mounting, force in zip(description.arms, forces, strict=True)
    ])  # fmt: skip


def torque_offset(state: ArmState, model: ArmModel) -> tuple[NDArray[np.float64], str]:
    """Return by how much the measured torques of an arm at rest differ from what its model weighs, (7,) Nm, and the
    largest in words."""
    end_effector_pose(model, state.q)  # and with it g
    off = np.abs(state.tau_J - model.g)
    joint = int(off.argmax())
    if np.abs(state.tau_J).max() < 0.5 * off[joint]:
        return off, f"tau_J leaves gravity out, {off[joint]:.1f} Nm at joint {joint + 1}"
    return off, f"tau_J is {off[joint]:.1f} Nm from the arm's weight at joint {joint + 1}"


def check_torques(cell: Cell, description: CellDescription) -> None:
    """Raise TrialError for an arm at rest whose torques the judge would stop in the first tick; HardwareError from the
    arms."""
    arms = zip(cell.sides, cell.arms, description.arms, description.pads, limits_of_arms(description), strict=True)
    for side, arm, mounting, pad, limits in arms:
        off, said = torque_offset(arm.read(), ArmModel(mounting, pad))
        allowed = limits.tau_ext_by_phase[ForcePhase.APPROACH]
        if np.any(off > allowed):
            raise TrialError(
                f"the {side} arm's {said}: the momentum residual begins with as much, and the judge, which allows "
                f"{allowed[off.argmax()]:g} Nm there, would stop each motion in its first tick. Correct the tool "
                "(Desk, [pad]); for a simulated robot that leaves gravity out, widen tau_ext_approach_max and "
                "tau_ext_contact_max in [safety]"
            )


def check_estimate(cell: Cell, description: CellDescription, detector: DetectorParameters, detects: bool = True) -> str:
    """Look at the arms of an open cell at rest, before a motion; return in one line what is to be known, "" for
    nothing. The plant in this process is not asked. detects: an impact is to be detected. Raises TrialError where it
    cannot be, or where an arm feels so much that it would sink under our torque; HardwareError from the arms."""
    if cell.link is None:
        return ""
    check_torques(cell, description)
    said = []
    largest = REST_SHARE * detector.largest_tare_n
    for side, force in zip(cell.sides, resting_force(cell, description), strict=True):
        size = float(np.linalg.norm(force))
        if size == 0.0 and not detects:
            continue
        if size == 0.0:
            raise TrialError(
                f"the {side} arm estimates no force at all (O_F_ext_hat_K is zero): no impact would be detected; "
                "play, by hand and free motions need no estimate"
            )
        kg = force[2] / 9.81
        if size > largest:
            raise TrialError(
                f"the {side} arm feels {size:.1f} N with nothing at its pad, more than {largest:g} N: it would sink, "
                f"and no impact could be told from it. A payload that is off by {kg:+.2f} kg would explain "
                f"{abs(force[2]):.1f} N of it: clear the pad, then correct the tool (Desk, [pad]); rtstack check says "
                "more"
            )
        if size >= detector.tare_n:
            said.append(f"{side} {size:.1f} N (payload off by {kg:+.2f} kg?)")
    return f"the force estimate is biased at rest, and the detector counts from it: {', '.join(said)}" if said else ""
