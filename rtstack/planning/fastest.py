"""A motion with its checks; where it is too fast, with the fastest speed that would do."""

from collections.abc import Callable
from dataclasses import replace

from rtstack.model.cell_description import CellDescription
from rtstack.planning.feasibility import check_plan
from rtstack.planning.planned import PlannedMotion
from rtstack.planning.request import SLOWEST_M_S, Plan, PlanError, TooFast

COARSE_M_S, FINE_M_S = 0.1, 0.01


def feasible(
    motion: Callable[[CellDescription, str, Plan], PlannedMotion], description: CellDescription, name: str, plan: Plan
) -> PlannedMotion:
    """Return the motion of a plan for the object of this name. Raises PlanError with one line where it is not feasible.

    TooFast comes out with the fastest speed that would do, to 0.01 m/s, of those within 0.1 m/s over a speed that does.
    """

    def attempt(plan: Plan) -> PlannedMotion:
        planned = motion(description, name, plan)
        check_plan(planned, description.about(name))
        return planned

    try:
        return attempt(plan)
    except TooFast as error:
        found = _fastest(attempt, plan)
        advice = "no lower speed would do" if found is None else f"the fastest speed that would do is {found:.2f} m/s"
        raise TooFast(f"{error}; all else as it is, {advice}", found) from None


def _fastest(attempt: Callable[[Plan], PlannedMotion], plan: Plan) -> float | None:
    """Return that speed, m/s; None where no speed does that is whole tenths slower, nor the slowest one."""
    # in hundredths of a m/s: low ones fail for other reasons, so that there is no bisection over all of them
    too_fast = round(plan.speed / FINE_M_S + 0.499)
    slowest, step = round(SLOWEST_M_S / FINE_M_S), round(COARSE_M_S / FINE_M_S)
    for does in (*range(too_fast - step, slowest, -step), slowest):
        if does < too_fast and _does(attempt, plan, does):
            break
        too_fast = min(too_fast, does)
    else:
        return None
    while too_fast - does > 1:
        middle = (too_fast + does) // 2
        if _does(attempt, plan, middle):
            does = middle
        else:
            too_fast = middle
    return round(does * FINE_M_S, 2)


def _does(attempt: Callable[[Plan], PlannedMotion], plan: Plan, hundredths: int) -> bool:
    try:
        attempt(replace(plan, speed=round(hundredths * FINE_M_S, 2)))
    except PlanError:
        return False
    return True
