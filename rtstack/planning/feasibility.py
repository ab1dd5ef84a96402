"""Whether a plan can be run: each check ends in one line that says what is wrong and what to change.

Where it is too fast, the fastest speed that would do is found. The margins are what feedback and an impact's vibrations
need beside the plan.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from hal.base.arrays import Array
from rtstack.impact_map import ImpactMap, Status
from rtstack.model.cell_description import CellDescription, ObjectDescription
from rtstack.model.clearance import ARM_DISTANCE_M, Clearance
from rtstack.planning.impact_loads import impact_loads
from rtstack.planning.planned import PlannedMotion
from rtstack.planning.request import SLOWEST_M_S, GrabPlan, Plan, PlanError, TooFast
from rtstack.safety.limits import SafetyLimits, hardware_limits
from rtstack.trials.errors import TrialError
from rtstack.trials.object import check_object

GRAVITY = 9.81

POSITION_MARGIN_RAD = 0.05
VELOCITY_SHARE = 0.9  # of the velocity limit at that position
TORQUE_SHARE = 0.8  # of the largest torque
# of a limit: what the impact may take a joint to. From one run to the next the wrist's torque scatters by 14 %, the
# residual by 4 % (impact_loads); the power is larger in the lift that follows than in the impact
IMPACT_SHARE = {"torque": 0.9, "momentum residual": 0.95, "velocity": VELOCITY_SHARE, "power": 0.6}
STIFFEST = 2e-5  # m/N: a pad's silicone on a wooden box, where an object's stiffness is not given
FRICTION_SHARE = 0.7  # of the friction cone: the impact shakes what is held
SPREAD_SHARE = 0.005  # of the speed: how much of the velocity after the impact the law may leave open
AGREED_M_S = 1e-6
CLEARANCE_M = 0.004  # of pads and links over the table: at home a pad's edge is 10 mm above it
LOOK_TICKS = 10
COARSE_M_S, FINE_M_S = 0.1, 0.01


def object_named(description: CellDescription, name: str) -> ObjectDescription:
    """Return the cell's object. Raises PlanError for an unknown one."""
    try:
        check_object(name, description)
    except TrialError as error:
        raise PlanError(str(error)) from None
    return description.objects[name]


def check_place(description: CellDescription, object_name: str, height: float) -> None:
    """Refuse a height at which the pads do not lie on the object's face as a whole, or touch the table."""
    thing, length = description.objects[object_name], max(pad.size[1] for pad in description.pads)
    room = (thing.size[2] - length) / 2
    lowest = max(-room, CLEARANCE_M + (length - thing.size[2]) / 2)
    if not lowest - 1e-9 <= height <= room + 1e-9:
        raise PlanError(
            f"height {height:g} m: on {object_name} the pads have to be within {lowest:.3f} and {room:.3f} m of its "
            "centre to lie on its face and clear the table"
        )


def feasible(
    motion: Callable[[CellDescription, str, Plan], PlannedMotion], description: CellDescription, name: str, plan: Plan
) -> PlannedMotion:
    """Return the motion of a plan for the object of this name. Raises PlanError where it is not feasible; TooFast with
    the fastest speed that would do, to 0.01 m/s, of those within 0.1 m/s over a speed that does."""

    def attempt(plan: Plan) -> PlannedMotion:
        planned = motion(description, name, plan)
        check_plan(planned, description.about(name))
        return planned

    def does(hundredths: int) -> bool:
        try:
            attempt(replace(plan, speed=round(hundredths * FINE_M_S, 2)))
        except PlanError:
            return False
        return True

    try:
        return attempt(plan)
    except TooFast as error:
        found = _fastest(does, round(plan.speed / FINE_M_S + 0.499))
        advice = "no lower speed would do" if found is None else f"the fastest speed that would do is {found:.2f} m/s"
        raise TooFast(f"{error}; all else as it is, {advice}", found) from None


def _fastest(does: Callable[[int], bool], too_fast: int) -> float | None:
    """Return the fastest speed, m/s, that does; None where none does that is whole tenths slower, nor the slowest one.
    does, too_fast: in hundredths of a m/s. Low speeds fail for other reasons: there is no bisection over all of
    them."""
    slowest, step = round(SLOWEST_M_S / FINE_M_S), round(COARSE_M_S / FINE_M_S)
    for good in (*range(too_fast - step, slowest, -step), slowest):
        if good < too_fast and does(good):
            break
        too_fast = min(too_fast, good)
    else:
        return None
    while too_fast - good > 1:
        middle = (too_fast + good) // 2
        good, too_fast = (middle, too_fast) if does(middle) else (good, middle)
    return round(good * FINE_M_S, 2)


def check_plan(planned: PlannedMotion, description: CellDescription) -> None:
    """Raise PlanError where a plan cannot be run, TooFast where a slower one may be. description: about its object."""
    request = planned.request
    check_impact(planned.map, request.speed)
    if isinstance(request, GrabPlan):
        check_lift(planned, description.contact_friction.pad, request.squeeze)
    else:
        check_travel(planned, description)
    check_motion(planned, description)
    check_loads(planned, description)


def check_impact(result: ImpactMap, speed: float) -> None:
    """Refuse an impact whose map is infeasible, unsolved, or leaves open which velocity follows."""
    for name, impact in (("single step", result.single_step), ("converged", result.converged)):
        if impact.status in (Status.INFEASIBLE, Status.UNSOLVED):
            raise PlanError(f"impact map ({name}): {impact.status}, {impact.detail}; plan another height or speed")
        if impact.status is Status.NOT_UNIQUE:
            apart, spread = impact.second_opinion_m_s or 0.0, impact.spread_m_s or 0.0
            if apart > AGREED_M_S or spread > SPREAD_SHARE * speed:
                raise PlanError(f"impact map ({name}): not unique, {impact.detail}; plan another height or speed")
        for contact, rows in zip(result.problem.contacts, result.problem.points, strict=True):
            total = float(impact.impulses[rows, 2].sum())
            if total < -1e-9:
                raise PlanError(
                    f"impact map ({name}): {' on '.join(contact.between)} would have to pull with {-total:.3g} Ns; "
                    "plan another height or speed"
                )


def check_lift(planned: PlannedMotion, friction: float, squeeze: float) -> None:
    """Refuse a squeeze whose friction does not hold what is lifted."""
    recording = planned.recording
    sideways = np.linalg.norm(planned.force[:, recording.impact : recording.release][:, :, [0, 2]], axis=2)
    needed = float(sideways.max()) / (FRICTION_SHARE * friction)
    if squeeze < needed:
        raise PlanError(
            f"squeeze {squeeze:g} N: friction {friction:g} does not hold {recording.object} on this path; squeeze with "
            f"{np.ceil(needed):.0f} N at least, or lift more slowly"
        )


def check_travel(planned: PlannedMotion, description: CellDescription) -> None:
    """Refuse a push that would have to pull to slow the object down, or that pushes it off the table."""
    recording = planned.recording
    inward = -float(np.sign(recording.points[0]["position"][0, 1]))
    pressing = inward * planned.force[0, recording.impact : recording.release, 1]
    if pressing.min() < 0.0:  # 0 throughout where the plan does not compensate the object
        raise PlanError(
            f"the object would run ahead of the pad: it has to be slowed down by {-pressing.min():.1f} N more than "
            "its friction on the table; plan a longer travel"
        )
    table, thing = description.table, description.objects[recording.object]
    end = planned.object_position[-1]
    edge = table.centre_xy[1] + inward * table.size_xy[1] / 2
    over = inward * (end[1] - edge) + thing.size[1] / 2
    if over > 0.0:
        raise PlanError(f"the object would end {over * 1e3:.0f} mm over the table's edge: plan a shorter travel")


def check_motion(planned: PlannedMotion, description: CellDescription) -> None:
    """Refuse joints beyond their limits, and pads or links too near to the table or to the other arm."""
    for arm, side in enumerate(description.sides):
        limits = hardware_limits(description.robots[arm]).tightened(description.safety)
        _check_joints(planned, arm, side, limits)
        _check_pad(planned, arm, side, limits)
    period_s = planned.recording.period_s
    for tick, side in near_misses(description, [motion.q for motion in planned.joints], planned.recording.points):
        if side:
            raise PlanError(f"{side} arm: it would touch the table at {tick * period_s:.2f} s: plan a greater height")
        raise PlanError(f"the arms come nearer than {ARM_DISTANCE_M} m to each other at {tick * period_s:.2f} s")


def check_loads(planned: PlannedMotion, description: CellDescription) -> None:
    """Refuse an impact beyond what is allowed of torque, velocity, power, or what the judge sees of the contact."""
    thing = description.objects[planned.recording.object]
    give = planned.request.give or thing.give or STIFFEST
    for side, loads in impact_loads(planned, give, thing.mass).items():
        arm = planned.sides.index(side)
        limits = hardware_limits(description.robots[arm]).tightened(description.safety)
        q = planned.joints[arm].q[planned.recording.impact]
        lower, upper = limits.dq_lower(q), limits.dq_upper(q)
        for what, values, limit, unit in (
            ("torque", loads.torque, np.array(limits.tau_J_max), "Nm"),
            ("momentum residual", loads.external, np.array(limits.tau_ext_max), "Nm"),
            ("velocity", loads.fastest, upper, "rad/s"),
            ("velocity", -loads.slowest, -lower, "rad/s"),
            ("power", np.array([loads.power]), np.array([limits.power_max]), "W"),
        ):
            share, allowed = values / np.maximum(limit, 1e-9), IMPACT_SHARE[what]
            worst = int(share.argmax())
            if share[worst] > allowed:
                where = f"the {what} of joint {worst + 1}" if len(values) > 1 else f"its {what}"
                raise TooFast(
                    f"{side} arm: the impact takes {where} to {values[worst]:.1f} {unit}, "
                    f"{allowed * limit[worst]:.1f} are allowed ({allowed:g} of {limit[worst]:.3g})"
                )


def _check_joints(planned: PlannedMotion, arm: int, side: str, limits: SafetyLimits) -> None:
    motion, period_s = planned.joints[arm], planned.recording.period_s
    room = np.minimum(motion.q - limits.q_lower, np.asarray(limits.q_upper) - motion.q)
    lower, upper = limits.dq_lower(motion.q), limits.dq_upper(motion.q)
    speed = np.where(motion.dq > 0.0, motion.dq / np.maximum(upper, 1e-9), motion.dq / np.minimum(lower, -1e-9))
    torque = planned.torque(arm)
    for values, bound, what, kind in (
        (POSITION_MARGIN_RAD - room, 0.0, "rad too near to its position limit", PlanError),
        (speed, VELOCITY_SHARE, "times its velocity limit", TooFast),
        (np.abs(torque) / limits.tau_max, TORQUE_SHARE, "times its torque limit", TooFast),
    ):
        tick, joint = np.unravel_index(int(values.argmax()), values.shape)
        if values[tick, joint] > bound:
            raise kind(
                f"{side} arm: joint {joint + 1} is at {values[tick, joint]:.2f} {what} after {tick * period_s:.2f} s, "
                f"{bound:g} is allowed; plan another posture or a smaller motion"
            )


def _check_pad(planned: PlannedMotion, arm: int, side: str, limits: SafetyLimits) -> None:
    points = planned.recording.points[arm]
    place, speed = points["position"], np.linalg.norm(points["twist"][:, :3], axis=1)
    outside = np.maximum(np.asarray(limits.ee_lower) - place, place - np.asarray(limits.ee_upper))
    tick, axis = np.unravel_index(int(outside.argmax()), outside.shape)
    if outside[tick, axis] > 0.0:
        raise PlanError(
            f"{side} arm: the pad leaves the cell's box by {outside[tick, axis] * 1e3:.0f} mm along {'xyz'[axis]} at "
            f"{tick * planned.recording.period_s:.2f} s (ee_lower, ee_upper): plan a smaller motion"
        )
    if speed.max() > VELOCITY_SHARE * limits.ee_speed_max:
        raise TooFast(
            f"{side} arm: the pad moves at {speed.max():.2f} m/s, more than {VELOCITY_SHARE} of the cell's "
            f"ee_speed_max = {limits.ee_speed_max:g}: give it more time"
        )


def near_misses(description: CellDescription, q: Sequence[Array], points: NDArray) -> Iterator[tuple[int, str]]:
    """Look at the judge's capsules and the pads' boxes every LOOK_TICKS of a path; yield the ticks at which something
    comes too near, with the side of the arm that does to the table, "" for two arms to each other. q: (n, 7) rad of
    each arm; points (arms, n): position and rotation of the pads at the same ticks."""
    clearance, top = Clearance(description), description.table.top_z
    reaches = [np.array(pad.size) / 2 for pad in description.pads]
    for tick in range(0, points.shape[1], LOOK_TICKS):
        links, apart = clearance.at([each[tick] for each in q])
        for arm, (side, reach) in enumerate(zip(description.sides, reaches, strict=True)):
            point = points[arm, tick]
            lowest = point["position"][2] - point["rotation"][2, 2] * reach[2] - np.abs(point["rotation"][2]) @ reach
            if min(float(lowest) - top, links[arm]) < CLEARANCE_M:
                yield tick, side
        if apart < ARM_DISTANCE_M:
            yield tick, ""
