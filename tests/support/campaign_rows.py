"""Results of a made-up campaign of the controllers' comparison, and the verdicts on them."""

from itertools import product

import numpy as np

from rtstack.experiments.store import columns_of, stored
from rtstack.papers.reference_spreading.claims import judge_claims
from rtstack.papers.reference_spreading.controllers import Controller
from rtstack.papers.reference_spreading.evaluation import Evaluation
from rtstack.papers.reference_spreading.measures import Measures
from rtstack.papers.reference_spreading.names import NAMES
from rtstack.papers.reference_spreading.trial import Trial
from rtstack.trials.result import TrialResult

FORCE = {
    Controller.NO_REFERENCE_SPREADING: 33.0,
    Controller.NO_VELOCITY_FEEDBACK: 32.0,
    Controller.NO_INTERIM: 29.0,
    Controller.PROPOSED: 25.0,
}
# the paper's Table II
LIFT = dict(zip(FORCE, (9.81, -17.07, 0.78, 6.47), strict=True))
GRABS = dict(zip(FORCE, (16, 8, 17, 18), strict=True))


def rows(force=FORCE, lift=LIFT, grabs=GRABS, noise=0.1):
    """Results of a made-up campaign: 20 trials a controller for Table II, 30 a cell for Figure 11."""
    rng = np.random.default_rng(1)
    made = []
    for controller in NAMES:
        for k in range(20):
            made.append(
                row("table2", f"rice_box/{k // 2}", "rice_box", -30.0 if k % 2 else 30.0, 0, controller)
                | {"success": k < grabs[controller], "failure_reason": "dropped"}
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
    }  # fmt: skip


def verdicts(made):
    return {claim.says: claim.verdict for claim in judge_claims(Evaluation(made))}
