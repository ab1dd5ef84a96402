"""From which tick a log shows what a limit of the judge forbids, by the judge's oracle in plain Python."""

import numpy as np

from rtstack.model.cell_description import CellDescription
from rtstack.safety.judge import Base, Cause
from rtstack.safety.limits import ForcePhase
from rtstack.trials.tightening import limits_of_arms
from tests.support.faults.evidence import Evidence
from tests.support.safety.judge_oracle import arm_reason, joint_reason

OTHERS = {"tau_desired": np.zeros((1, 7)), "O_F_ext_hat_K": np.zeros((1, 6)), "O_T_EE": np.zeros((1, 4, 4))}


def first_violation(evidence: Evidence, description: CellDescription, begin: int, phase: ForcePhase) -> int | None:
    """Return the first tick from `begin` on in which a state or a residual is beyond a limit, None where none is.

    phase: of the forces; the pad's is not looked at.
    """
    limits = limits_of_arms(description)[0]
    limits = limits.tightened({"tau_ext_max": limits.tau_ext_by_phase[phase].tolist()})
    found = []
    for side, mounting in (("left", description.left), ("right", description.right)):
        base = Base(mounting.base_position, mounting.base_orientation_wxyz)
        arm = evidence.arms[side]
        for tick in range(begin, len(arm["t_ns"])):
            sample = {name: arm[name][tick : tick + 1] for name in ("q", "dq", "tau_J", "tau_ext_hat_filtered")}
            sample |= OTHERS
            reason = joint_reason(sample, arm["momentum_residual"][tick], limits)[0]
            if reason is not Cause.NONE or arm_reason(sample, base, limits)[0] is not Cause.NONE:
                found.append(tick)
                break
    return min(found, default=None)
