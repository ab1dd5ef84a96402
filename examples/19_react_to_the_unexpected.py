"""Going on by itself only where it was no crash: an impact that was not meant, and what the trial then does.

The monitor judges each impact in the tick. `reaction` says what an unexpected verdict leads to; where it was no planned
impact at all, an operator has to recover.
"""

from contextlib import closing

from rtstack.cells import load_description, open_cell
from rtstack.samples import Reaction
from rtstack.trials.specification import TrialSpecification
from rtstack.trials.trial import prepare_trial, run_trial

description, _ = load_description(None)
for displacement_mm, reaction in ((0.0, Reaction.STOP), (60.0, Reaction.HOLD)):
    asked = TrialSpecification("ref.mcap", displacement_mm=displacement_mm, reaction=reaction)
    with closing(open_cell("direct", asked.object, displacement_mm * 1e-3, asked.seed, description)) as cell:
        result = run_trial(prepare_trial(asked, description), cell)
    verdict = f"{result.impact_verdict}: {result.impact_kind or 'as planned'}"
    print(f"box at {displacement_mm:.0f} mm, {reaction}: {verdict}; {result.failure_reason or 'success'}")
