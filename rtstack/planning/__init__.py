"""References without a demonstration: via-point quintics, joined by the impact map.

from rtstack.planning import GrabPlan, PushPlan, plan_grab, plan_push
planned = plan_grab(description, "rice_box", GrabPlan(speed=0.4, post_impact_scale=0.9))
planned.reference               # what a trial follows (rtstack.references.spreading.ExtendedReference)
planned.map.twist("left")       # the pad's predicted velocity after the impact
"""

from rtstack.planning.grab import plan_grab
from rtstack.planning.planned import PlannedMotion
from rtstack.planning.push import plan_push
from rtstack.planning.request import GrabPlan, PlanError, PushPlan, TooFast, checked_plan

__all__ = ["GrabPlan", "PlanError", "PlannedMotion", "PushPlan", "TooFast", "checked_plan", "plan_grab", "plan_push"]
