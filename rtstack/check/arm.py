"""What an arm says of itself while it rests, beside what its cell's file makes of its joints: do both mean the same?

Not where its tool was set otherwise, nor where other authors' robots leave fields at zero or mean another frame.
"""

from dataclasses import dataclass

import numpy as np

from hal.base.arrays import Array
from hal.pad import Pad
from hal.state import ArmState
from rtstack.check.finding import Finding, finding
from rtstack.model.arm_model import ArmModel
from rtstack.model.cell_description import ArmMounting
from rtstack.references.demonstration import end_effector_pose
from rtstack.trials.estimate import torque_offset

GRAVITY = 9.81  # m/s^2
# Ours, above what two calibrated arms differ by: kinematics by a millimetre, gravity torques by 1 Nm
PLACE_M = 5e-3
TURN_RAD = 0.02
TORQUE_NM = 5.0
# of the mean external torque of a held arm: as much is an offset of some 2 N at the pad, or 0.2 kg not told to it
RESTING_NM = 1.0
_TOOL = "set the tool in Desk as the cell's file has it ([pad])"
_WIDER = "; a robot that leaves gravity out moves only with a wider tau_ext_approach_max in [safety]"


@dataclass(frozen=True, slots=True)
class Felt:
    """A held arm's estimate: mean and deviation of external torques (7,), Nm; mean wrench (6,), its base, N, Nm."""

    tau_ext: Array
    tau_ext_sd: Array
    O_F_ext: Array


def missing_payload(model: ArmModel, q: Array, tau_ext: Array) -> tuple[float, float]:
    """Return by how much the tool would have to be heavier than the robot was told, kg, to explain external torques
    (7,), Nm, best (least squares), and the largest torque that is left then, Nm. The mass is at the pad's face."""
    place, _ = end_effector_pose(model, q)
    J = model.J0
    weight = GRAVITY * (J[2] + J[3] * place[1] - J[4] * place[0])  # Nm/kg: the world's z at the pad's face
    mass = float(weight @ tau_ext / (weight @ weight))
    return mass, float(np.abs(tau_ext - mass * weight).max())


def torques_finding(side: str, state: ArmState, mounting: ArmMounting, pad: Pad) -> Finding:
    """Judge the measured torques of an arm that rests."""
    off, said = torque_offset(state, ArmModel(mounting, pad))
    cost = "the momentum residual begins with as much: that much less is left to the judge's bound"
    return finding(f"{side} torques", said, bool(off.max() <= TORQUE_NM), cost, _TOOL + _WIDER)


def resting_findings(side: str, state: ArmState, felt: Felt, mounting: ArmMounting, pad: Pad) -> list[Finding]:
    """Judge the state of an arm that rests and that nothing touches, and what it has felt while it was held."""
    model = ArmModel(mounting, pad)
    position, rotation = end_effector_pose(model, state.q)
    said = model.T_world_base @ state.O_T_EE
    place_m = float(np.linalg.norm(said[:3, 3] - position))
    turn_rad = float(np.arccos(np.clip((np.trace(rotation.T @ said[:3, :3]) - 1.0) / 2.0, -1.0, 1.0)))
    outside, blind = np.abs(felt.tau_ext), not felt.O_F_ext.any()
    pairs = ", ".join(f"{mean:.2f}+-{sd:.2f}" for mean, sd in zip(felt.tau_ext, felt.tau_ext_sd, strict=True))
    mass, left_nm = missing_payload(model, state.q, felt.tau_ext)
    estimate = (
        f"external torques {pairs} Nm, force {np.linalg.norm(felt.O_F_ext[:3]):.1f} N; "
        f"a payload that is off by {mass:+.2f} kg would leave {left_nm:.2f} Nm of them"
    )
    return [
        finding(
            f"{side} pad", f"O_T_EE is {1e3 * place_m:.1f} mm and {turn_rad:.3f} rad from where q puts the pad",
            place_m <= PLACE_M and turn_rad <= TURN_RAD,
            "logs and scores show the pad where the robot says; the controller takes it where q puts it", _TOOL,
        ),
        torques_finding(side, state, mounting, pad),
        finding(
            f"{side} estimate", estimate + ", O_F_ext_hat_K is zero" * blind,
            bool(outside.max() <= RESTING_NM and not blind),
            "impacts are told from this estimate: a trial sees none, or the judge one that is none",
            f"{_TOOL}; play, by hand and free motions need no estimate", required=not blind,
        ),
    ]  # fmt: skip
