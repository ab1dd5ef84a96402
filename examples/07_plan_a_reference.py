"""A reference without a demonstration: plan a grab, look at what the impact map predicts, and follow it.

The file (`plan.mcap`) is a log of what was planned; a trial does not know where its reference came from.
"""

from pathlib import Path

from rtstack.cells import load_description, open_cell
from rtstack.log.writer import check_log_path
from rtstack.planning import GrabPlan, PlanError, plan_grab
from rtstack.planning.file import write_plan
from rtstack.trials.specification import TrialSpecification
from rtstack.trials.trial import prepare_trial, run_trial

check_log_path(Path("plan.mcap"))
description, source = load_description(None)
planned = plan_grab(description, "rice_box", GrabPlan(speed=0.4, rise=0.3, height=0.03))
print(f"impact at {planned.recording.impact_s:.3f} s; the left pad leaves it with {planned.velocities[0].round(3)} m/s")

write_plan(Path("plan.mcap"), planned, description, source)
prepared = prepare_trial(TrialSpecification("plan.mcap", "no_interim"), description)
cell = open_cell("direct", "rice_box", 0.0, 0, description)
try:
    result = run_trial(prepared, cell)
finally:
    cell.close()
print("success" if result.success else result.failure_reason, f"{result.max_lift_mm:.0f} mm lifted")

# what cannot be run is refused, with what to change
try:
    plan_grab(description, "rice_box", GrabPlan(squeeze=5.0))
except PlanError as refusal:
    print("refused:", refusal)
