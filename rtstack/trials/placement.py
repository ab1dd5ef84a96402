"""Places an object: both arms take it from where the tracker sees it, and set it down where it is wanted."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from math import atan2, degrees, pi
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from hal.cell import Cell
from hal.displacement import Displacement
from hal.tracker import ObjectPose
from rtstack.loop.plan import SessionPlan
from rtstack.model.cell_description import CellDescription
from rtstack.references.placement import carried
from rtstack.safety.limits import ForcePhase, PairLimits
from rtstack.samples import SIDES, Mode
from rtstack.trials.assembly import arm_controllers, cell_parameters
from rtstack.trials.carry_out import PreparedRun
from rtstack.trials.errors import TrialError
from rtstack.trials.object import check_object, check_two_arms
from rtstack.trials.result import PlacementResult
from rtstack.trials.run import Run
from rtstack.trials.run_context import RunContext
from rtstack.trials.sight import object_before
from rtstack.trials.specification import PlacementSpecification
from rtstack.trials.start_motion import StartMotion, blocked_start, start_motion
from rtstack.trials.tightening import limits_of_arms

NEAR_MM, NEAR_DEG = 5.0, 2.0  # an object that stands nearer is where it is wanted: a person with a ruler does no better
UPRIGHT_DEG = 5.0
FAR_MM = 20.0
LOST_S = 1.0  # without a pose for so long, the object may stand elsewhere by now


@dataclass(frozen=True, slots=True)
class PreparedPlacement(PreparedRun[PlacementResult]):
    """One attempt: take the object, carry it, set it down, and look where it stands."""

    keeps_open_cell: ClassVar[bool] = True
    specification: PlacementSpecification

    def start_motion(self, cell: Cell) -> StartMotion | None:
        """See PreparedRun: to home, around the object where it stands."""
        where = object_stands(cell, self.description, self.specification.object)
        return start_motion(cell, self.description, self.specification.object, where)

    def run(self, cell: Cell, context: RunContext, way: StartMotion | None) -> PlacementResult:
        """See PreparedRun. Raises TrialError where the object is not seen, has fallen or is out of reach."""
        specification, description = self.specification, self.description
        stands, wanted = object_stands(cell, description, specification.object), specification.wanted
        parameters = cell_parameters(description)
        thing, stiffness = description.objects[specification.object], parameters.control.stiffness_teleoperation
        arms, limits = arm_controllers(description, parameters), limits_of_arms(description)
        try:
            targets = carried(
                (arms[0].model, arms[1].model), description.home, thing, description.table, stands=stands,
                wanted=specification.aimed, pad_friction=thing.pad_friction or description.contact_friction.pad,
                stiffness_n_m=float(stiffness[1]), period_s=parameters.control.period_s,
            )  # fmt: skip
            _check_box(targets, limits)
        except ValueError as error:
            raise TrialError(f"{specification.object} cannot be placed: {error}") from None
        plan = SessionPlan(
            targets, targets, Mode.TELEOPERATION, stiffness, parameters.control.period_s, phase=ForcePhase.CONTACT
        )
        with Run(description, parameters, plan, limits, context, way) as run:
            outcome = run.follow(cell)
            reason, forces = outcome.problem, run.history.columns().arm["O_F_ext_hat_K"][..., :3]
            off: tuple[float | None, float | None] = (None, None)
            short: tuple[float | None, float | None, float | None] = (None, None, None)
            try:
                now = object_stands(cell, description, specification.object)
                off = off_mm, off_deg = difference(now, wanted)
                turn = degrees(_folded(wanted.yaw_rad - now.yaw_rad))
                short = (1e3 * (wanted.x_m - now.x_m), 1e3 * (wanted.y_m - now.y_m), turn)
                if reason is None and (off_mm > NEAR_MM or off_deg > NEAR_DEG):
                    reason = f"the object stands {off_mm:.1f} mm and {off_deg:.1f} degrees from where it is wanted"
            except TrialError as error:
                reason = reason or str(error)
            return run.finished(
                PlacementResult, reason, specification, outcome, carried=outcome.problem is None, off_mm=off[0],
                off_deg=off[1], short_x_mm=short[0], short_y_mm=short[1], short_yaw_deg=short[2],
                peak_force_n=float(np.linalg.norm(forces, axis=-1).max(initial=0.0)),
            )  # fmt: skip


def _check_box(targets: NDArray[np.void], limits: PairLimits) -> None:
    """Raise ValueError where a pad would leave the judge's box. targets: (2, n) of POINT."""
    for side, points, judged in zip(SIDES, targets["position"], limits, strict=True):
        outside = (points < judged.ee_lower) | (points > judged.ee_upper)
        if outside.any():
            k, axis = np.argwhere(outside)[0]
            raise ValueError(
                f"at {'xyz'[axis]} {1e3 * points[k, axis]:.0f} mm the {side} pad would leave the box of [safety]"
            )


def place(
    prepared: PreparedPlacement, attempts: int, carry: Callable[[PreparedPlacement], PlacementResult]
) -> PlacementResult:
    """Place an object in so many attempts at most, each carried out by `carry` and aimed by what those before fell
    short; return the last result."""
    result = carry(prepared)
    for _ in range(attempts - 1):
        if result.success or not result.carried or result.short_x_mm is None:
            break
        prepared = replace(prepared, specification=corrected(prepared.specification, result))
        result = carry(prepared)
    return result


def corrected(asked: PlacementSpecification, result: PlacementResult) -> PlacementSpecification:
    """Return the next attempt's specification. What fell short by more than FAR_MM is no matter of aim."""
    short = (result.short_x_mm or 0.0, result.short_y_mm or 0.0, result.short_yaw_deg or 0.0)
    if (result.off_mm or 0.0) > FAR_MM:
        return replace(asked, aim_x_mm=0.0, aim_y_mm=0.0, aim_yaw_deg=0.0)
    x_mm, y_mm, yaw_deg = asked.aim_x_mm + short[0], asked.aim_y_mm + short[1], asked.aim_yaw_deg + short[2]
    return replace(asked, aim_x_mm=x_mm, aim_y_mm=y_mm, aim_yaw_deg=yaw_deg)


def prepare_placement(specification: PlacementSpecification, description: CellDescription) -> PreparedPlacement:
    """Check the object and the arms. Raises TrialError with one line."""
    check_object(specification.object, description)
    check_two_arms(description, "placing an object")
    return PreparedPlacement(specification, description)


def object_is_seen(cell: Cell, description: CellDescription) -> bool:
    """Return whether the tracker sees an object now. Raises HardwareError."""
    pose = object_before(cell, description)
    return bool(pose.record["seen"][0]) and _age_s(cell, pose) <= LOST_S


def blocks_start(cell: Cell, description: CellDescription, name: str) -> str:
    """Return in one line that the object stands where a pad starts; "" where it does not, or is not seen."""
    if name not in description.objects or not object_is_seen(cell, description):
        return ""
    return blocked_start(description, name, object_before(cell, description))


def _age_s(cell: Cell, pose: ObjectPose) -> float:
    return 1e-9 * (max(int(arm.read().record["t_ns"][0]) for arm in cell.arms) - pose.t_ns)


def object_stands(cell: Cell, description: CellDescription, name: str) -> Displacement:
    """Return where the tracker sees the object stand, from its nominal place, its yaw within half a turn. Raises
    TrialError with one line where it is not seen now, or does not stand upright on the table; HardwareError."""
    pose, thing = object_before(cell, description), description.objects[name]
    if not pose.record["seen"][0]:
        raise TrialError(f"the tracker does not see {name}: put it upright on the table, within the arms' reach")
    if (age_s := _age_s(cell, pose)) > LOST_S:
        raise TrialError(
            f"the tracker has not seen {name} for {age_s:.0f} s: see to its markers, and that nothing hides them"
        )
    w, x, y, z = pose.orientation_wxyz.tolist()
    lean = degrees(2.0 * np.arcsin(min(1.0, float(np.hypot(x, y)))))
    above = float(pose.position[2]) - description.table.top_z - thing.size[2] / 2.0
    if lean > UPRIGHT_DEG or abs(above) > description.tracker.place_tolerance_m:
        raise TrialError(
            f"{name} does not stand upright on the table (it leans by {lean:.0f} degrees, {1e3 * above:+.0f} mm above "
            "it): set it up, within the arms' reach"
        )
    return Displacement(float(pose.position[0]), float(pose.position[1]), _folded(2.0 * atan2(z, w)))


def difference(stands: Displacement, wanted: Displacement) -> tuple[float, float]:
    """Return by how much an object is off, mm and degrees; a box that is turned by half a turn is the same."""
    off_m = np.hypot(stands.x_m - wanted.x_m, stands.y_m - wanted.y_m)
    return 1e3 * float(off_m), degrees(abs(_folded(stands.yaw_rad - wanted.yaw_rad)))


def _folded(angle: float) -> float:
    """Return an angle between -90 and 90 degrees, rad, of what looks the same after half a turn."""
    return (angle + pi / 2.0) % pi - pi / 2.0
