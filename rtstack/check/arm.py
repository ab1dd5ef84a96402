"""What an arm says of itself while it rests, beside what its cell's file makes of its joints: do both mean the same?

Other authors' robots leave fields at zero, measure torques without gravity, or mean another end effector; a real one
does where its tool was set otherwise than the cell's file has it.
"""

import numpy as np

from hal.state import ArmState
from rtstack.check.finding import Finding, finding
from rtstack.model.arm_model import ArmModel
from rtstack.model.cell_description import ArmMounting, Pad
from rtstack.references.demonstration import end_effector_pose

# Ours, above what two calibrated arms differ by: kinematics by a millimetre, gravity torques by 1 Nm, the estimate of
# an outer torque by 2 Nm
PLACE_M = 5e-3
TURN_RAD = 0.02
TORQUE_NM = 5.0
_TOOL = "set the tool in Desk as the cell's file has it ([pad])"


def resting_findings(side: str, state: ArmState, mounting: ArmMounting, pad: Pad) -> list[Finding]:
    """Judge the state of an arm that rests and that nothing touches."""
    model = ArmModel(mounting, pad)
    position, rotation = end_effector_pose(model, state.q)
    said = model.T_world_base @ state.O_T_EE
    place_m = float(np.linalg.norm(said[:3, 3] - position))
    turn_rad = float(np.arccos(np.clip((np.trace(rotation.T @ said[:3, :3]) - 1.0) / 2.0, -1.0, 1.0)))
    off = np.abs(state.tau_J - model.g)
    joint = int(off.argmax())
    without = bool(off[joint] > TORQUE_NM and np.abs(state.tau_J).max() < 0.5 * off[joint])
    torques = "leaves gravity out" if without else f"is {off[joint]:.1f} Nm from the arm's weight at joint {joint + 1}"
    outside = np.abs(state.tau_ext_hat_filtered)
    blind = not state.O_F_ext_hat_K.any()
    estimate = f"tau_ext_hat_filtered reads {outside.max():.1f} Nm at joint {int(outside.argmax()) + 1}"
    return [
        finding(
            f"{side} pad", f"O_T_EE is {1e3 * place_m:.1f} mm and {turn_rad:.3f} rad from where q puts the pad",
            place_m <= PLACE_M and turn_rad <= TURN_RAD,
            "logs and scores show the pad where the robot says; the controller takes it where q puts it", _TOOL,
        ),
        finding(
            f"{side} torques", f"tau_J {torques}", bool(off[joint] <= TORQUE_NM),
            "the momentum residual begins with as much: that much less is left to the judge's bound", _TOOL,
        ),
        finding(
            f"{side} estimate", estimate + ", O_F_ext_hat_K is zero" * blind,
            bool(outside.max() <= TORQUE_NM and not blind),
            "impacts are told from this estimate: a trial sees none, or the judge one that is none",
            f"{_TOOL}; play, by hand and free motions need no estimate",
        ),
    ]  # fmt: skip
