"""Results of a made-up campaign of the controllers' comparison, and the verdicts on them."""

from itertools import product

import numpy as np

from rtstack.experiments.registry import plan_file
from rtstack.experiments.store import columns_of, stored
from rtstack.papers.reference_spreading.claims import judge_claims
from rtstack.papers.reference_spreading.controllers import NAMES, Controller
from rtstack.papers.reference_spreading.evaluation import Evaluation
from rtstack.papers.reference_spreading.measures import Measures
from rtstack.papers.reference_spreading.plan import Trial, load_plan
from rtstack.trials.result import TrialResult

FORCE = {
    Controller.NO_REFERENCE_SPREADING: 33.0,
    Controller.NO_VELOCITY_FEEDBACK: 32.0,
    Controller.NO_INTERIM: 29.0,
    Controller.PROPOSED: 25.0,
}
# the paper's Table II
LIFT = dict(zip(FORCE, (9.81, -17.07, 0.78, 6.47), strict=True))
GRABS = dict(zip(FORCE, (64, 32, 68, 72), strict=True))


def rows(force=FORCE, lift=LIFT, grabs=GRABS, noise=0.1):
    """Results of a made-up campaign: 80 trials a controller for Table II, 30 a cell for Figure 11.

    grabs: successes in 20 references, two displacements and two repetitions of each; those that fail are spread.
    """
    rng = np.random.default_rng(1)
    made = []
    for controller in NAMES:
        good = set(rng.permutation(80)[: grabs[controller]].tolist())
        for k in range(80):
            made.append(
                row("table2", f"rice_box/{k // 4}", "rice_box", -30.0 if k % 2 else 30.0, k // 2 % 2, controller)
                | {"success": k in good, "failure_reason": "the object was not held until release"}
                | {"max_lift_mm": 250.0 + k // 4 + lift[controller] + rng.normal(0.0, noise)}
            )
        for name, d, k in product(("rice_box/0", "parcel/0"), (-30.0, -15.0, 0.0, 15.0, 30.0), range(5)):
            made.append(
                row("figure11", name, name.split("/")[0], d, k, controller)
                | {
                    "average_force_norm": force[controller] + rng.normal(0.0, noise),
                    "max_lift_mm": 250.0 + lift[controller] + rng.normal(0.0, noise),
                }
            )
    return made


def row(experiment, reference, thing, displacement_mm, repetition, controller):
    return dict.fromkeys(stored(columns_of(Trial, TrialResult, Measures))) | {
        "experiment": experiment, "conditions": "nominal", "reference": reference, "object": thing, "success": True,
        "displacement_mm": displacement_mm, "repetition": repetition, "controller": str(controller),
        "ticks": 6000, "nominal_impact_time_s": 1.3,
    }  # fmt: skip


def verdicts(made, judges=("lowest_force_norm", "fewest_grabs", "most_grabs", "lift_order", "dropped")):
    """The verdicts of the paper's plan on made-up results, by judge and what it is asked about."""
    planned = [claim for claim in load_plan(plan_file("reference-spreading").path).claims if claim.judge in judges]
    claims = judge_claims(planned, Evaluation(made))
    return {(one.judge, one.at): claim.verdict for one, claim in zip(planned, claims, strict=True)}
