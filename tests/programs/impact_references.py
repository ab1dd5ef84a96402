"""On what of a grab's reference the validation's estimate depends, beside the velocity upwards that it is about.

The method of the impact-map paper estimates the velocity after the impact by the feedback along z (Section V). Here
one part of the reference after the impact at a time is the single step's instead of the converged map's. Published
joint friction, two references (0.8 and 1.2), one trial each, all with the same seed: the differences count, not the
estimates themselves.

Takes some minutes.
"""

import tempfile
from dataclasses import replace
from pathlib import Path
from typing import Annotated

import typer

from rtstack.cells import load_description
from rtstack.experiments.registry import plan_file
from rtstack.impact_map import MapKind
from rtstack.papers.conditions import LOGS, RECORDINGS
from rtstack.papers.impact_maps import worker
from rtstack.papers.impact_maps.evaluation import zero_feedback
from rtstack.papers.impact_maps.plan import JointFriction, PlannedReference, ValidationTrial, load_validation_plan
from rtstack.planning import grab
from rtstack.references.motion import Motion
from tests.programs import program

SCALES = (0.8, 1.2)
# which part of the single step's velocities, by index of the pads' twist; None: no angular velocities, (IV-A)
PARTS = {
    "converged map": (), "constant orientation": None, "x of the single step": (0,), "y of the single step": (1,),
    "z of the single step": (2,), "x and y of the single step": (0, 1),
}  # fmt: skip


def estimate(bench, plan, asked, number, parts):
    """Return the estimate of one kind of reference, m/s."""
    scenario, conditions = plan.scenario(Motion.GRAB), bench.nominal
    both = grab.grab_impact

    def mixed(*values, kind, **further):
        impact = both(*values, kind=MapKind.CONVERGED, **further)
        twist = impact.twist.copy()
        if parts is None:
            twist[:, 3:] = 0.0
        else:
            twist[:, list(parts)] = both(*values, kind=MapKind.SINGLE_STEP, **further).twist[:, list(parts)]
        return replace(impact, twist=twist)

    grab.grab_impact = mixed
    worker._planned.cache_clear()
    worker._prepared.cache_clear()
    try:
        points = []
        for scale in SCALES:
            grab_of = (*asked, scale)
            reference = PlannedReference(number, Motion.GRAB, *grab_of, True, False, MapKind.CONVERGED)
            if reason := worker.plan_reference(bench, reference, scenario):
                raise SystemExit(reason)
            trial = ValidationTrial("nominal", Motion.GRAB, *grab_of, 0, 5, number)
            (row,) = worker.run(bench, trial, reference, scenario.gains, conditions)
            points.append((row["planned_m_s"], row["net_feedback_m_s"]))
    finally:
        grab.grab_impact = both
    return zero_feedback(*zip(*points, strict=True)).estimate


def main(
    thing: Annotated[str, typer.Option("--object")] = "box_130",
    case: str = "1",
    robot: int = 101,
    out: Path | None = None,
) -> None:
    """Print the estimates."""
    plan = load_validation_plan(plan_file("impact-map-validation").path)
    out = out or Path(tempfile.mkdtemp(prefix="impact-references-"))
    for name in (worker.SWEEPS, RECORDINGS, LOGS):
        (out / name).mkdir(parents=True, exist_ok=True)
    conditions = replace(plan.conditions["nominal"], joint_friction=JointFriction.PUBLISHED, map=MapKind.CONVERGED)
    bench = worker.ValidationBench(out.resolve(), "direct", load_description(None)[1], "", conditions)
    first = None
    for name, parts in PARTS.items():
        found = estimate(bench, plan, (thing, case), robot, parts)
        first = first or found
        print(f"{name:28} {found:.4f} m/s  {100.0 * (found / first - 1.0):+.2f} %", flush=True)


if __name__ == "__main__":
    program(main)
