"""The robot models' numbers and sources, as the reference shows them."""

from collections.abc import Iterable

from hal.robots import ROBOTS, RobotModel, robot

_LIMITS = {
    "q_lower": "rad",
    "q_upper": "rad",
    "dq_max": "rad/s",
    "velocity_offset": "rad/s",
    "deceleration": "rad/s²",
    "ddq_max": "rad/s²",
    "dddq_max": "rad/s³",
    "tau_max": "Nm",
}


def robot_models() -> str:
    """Return a section for each registered model, in Markdown."""
    return "\n".join(line for name in ROBOTS.names() for line in _section(name, robot(name)))


def _section(name: str, model: RobotModel) -> list[str]:
    limits, cartesian = model.limits, model.cartesian
    whose = "the robot itself stops beyond it" if limits.velocity_law_enforced else "ours, the robot stops at `dq_max`"
    rate = f"The torque changes by {limits.tau_rate_max:g} Nm/s at most. Velocity law near a position limit: {whose}."
    rows = [_row(f"`{key}`, {unit}", getattr(limits, key)) for key, unit in _LIMITS.items()]
    rows += [_row("`B`, kg m²", model.B), _row("`B_theta`, kg m²", model.B_theta)]
    units = ("Nm", "s/rad", "rad/s")
    rows += [_row(f"`p{k}`, {unit}", row) for k, (unit, row) in enumerate(zip(units, model.friction, strict=True), 1)]
    moved = [_row(kind, getattr(cartesian, kind)) for kind in ("translation", "rotation", "elbow")]
    return [
        f"## `{name}`: {model.title}", "", "| joint | 1 | 2 | 3 | 4 | 5 | 6 | 7 |", "|---|---|---|---|---|---|---|---|",
        *rows, "", rate, "",
        "| end effector | velocity | acceleration | jerk |", "|---|---|---|---|", *moved, "",
        *(f"- `{key}`: {source}" for key, source in model.sources.items()), "",
    ]  # fmt: skip


def _row(title: str, values: Iterable[float]) -> str:
    return f"| {title} | {' | '.join(f'{value:.6g}' for value in values)} |"
