"""The table of the joints' limits in their order, from the code that draws them."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hal.robots import FR3
from rtstack.safety.limits import (
    APPROACH_S,
    CONTROL_MEASURED_FRACTION,
    CONTROL_VELOCITY_MARGIN,
    FORCES_BY_PHASE,
    HARDWARE,
    LARGEST_VELOCITY_SHARE,
    RATE_FRACTION,
    ForcePhase,
    control_limits,
)


def limit_table() -> str:
    """Return the rows of vendor, judge and controller for each limit, in Markdown."""
    line = control_limits(HARDWARE)[0]
    rest = line["velocity_offset"] ** 2 / (2.0 * line["deceleration"])
    rows = [
        ("`q_lower`, rad", FR3.limits.q_lower, HARDWARE.q_lower, line["q_lower"] + rest),
        ("`q_upper`, rad", FR3.limits.q_upper, HARDWARE.q_upper, line["q_upper"] - rest),
        ("`dq_max`, rad/s", FR3.limits.dq_max, HARDWARE.dq_max, line["dq_max"]),
        ("`velocity_offset`, rad/s", FR3.limits.velocity_offset, FR3.limits.velocity_offset, line["velocity_offset"]),
        ("`deceleration`, rad/s²", FR3.limits.deceleration, FR3.limits.deceleration, line["deceleration"]),
        ("`tau_max`, Nm", FR3.limits.tau_max, HARDWARE.tau_max, line["tau_max"]),
        ("`tau_J_max`, Nm", FR3.limits.tau_max, HARDWARE.tau_J_max, line["tau_J_max"]),
        ("torque's step, Nm a tick", *_steps(float(line["tau_step"]))),
        ("at rest before a position limit, mrad", np.zeros(7), 1e3 * (FR3.limits.q_upper - HARDWARE.q_upper),
         1e3 * (FR3.limits.q_upper - line["q_upper"] + rest)),
    ]  # fmt: skip
    head = ["| limit | vendor | judge | controller |", "|---|---|---|---|"]
    return "\n".join([*head, *(f"| {name} | {' | '.join(map(_numbers, values))} |" for name, *values in rows)])


def _steps(controllers: float) -> list[NDArray[np.float64]]:
    rate = FR3.limits.tau_rate_max * 1e-3
    return [np.array([rate]), np.array([rate * RATE_FRACTION]), np.array([controllers])]


def _numbers(values: ArrayLike) -> str:
    return ", ".join(f"{value:.5g}" for value in np.asarray(values))


def force_table() -> str:
    """Return the rows of the forces by phase, without a cell's table, in Markdown."""
    limits = HARDWARE.tightened(FORCES_BY_PHASE)
    head = ["| phase | judge: pad, N | joints, Nm | robot: pad, N | joints, Nm |", "|---|---|---|---|---|"]
    rows = []
    for phase in reversed(ForcePhase):
        robots = limits.collisions(phase)
        forces, torques = limits.force_by_phase, limits.tau_ext_by_phase
        cells = (forces[phase : phase + 1], torques[phase], robots.collision_forces[:1], robots.collision_torques)
        rows.append(f"| {phase.name.lower()} | {' | '.join(map(_numbers, cells))} |")
    return "\n".join(head + rows)


def velocity_margin() -> str:
    """Return how large the controller's margin of velocity is, in words."""
    return (
        f"{100.0 * CONTROL_VELOCITY_MARGIN:.0f} % of the vendor's `dq_max`, at most "
        f"{100.0 * LARGEST_VELOCITY_SHARE:.0f} % of the cell's"
    )


def approach_ms() -> str:
    """Return the time constant of the approach, ms."""
    return f"{1e3 * APPROACH_S:.0f}"


def measured_share() -> str:
    """Return the share of tau_J_max that the QP may ask for."""
    return f"{100.0 * CONTROL_MEASURED_FRACTION:.0f} %"
