"""The same trial with other numbers in the controller: how long should the interim mode last?

`Parameters` has every number of a controller, as frozen records with their sources; `replace` makes a variation of
them. Nothing is written here: without a log a trial takes a second.
"""

from dataclasses import replace

from rtstack.cells import load_description, open_cell
from rtstack.trials.assembly import cell_parameters
from rtstack.trials.specification import TrialSpecification
from rtstack.trials.trial import prepare_trial, run_trial

description, _ = load_description(None)
parameters = cell_parameters(description)
asked = TrialSpecification("ref.mcap", displacement_mm=-30.0)

for interim_s in (0.05, parameters.control.interim_s, 0.2):
    varied = replace(parameters, control=replace(parameters.control, interim_s=interim_s))
    prepared = prepare_trial(asked, description, varied)
    cell = open_cell("direct", asked.object, asked.displacement_mm * 1e-3, asked.seed, description)
    try:
        result = run_trial(prepared, cell)
    finally:
        cell.close()
    print(
        f"interim mode of {interim_s * 1e3:3.0f} ms: mean force norm {result.average_force_norm:.1f}, "
        f"peak {result.peak_force_norm:.1f}, {'success' if result.success else result.failure_reason}"
    )
