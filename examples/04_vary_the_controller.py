"""The same trial with other numbers in the controller: how long should the interim mode last?

`parameters` has every number of a controller, as frozen records with their sources; `replace` makes a variation of
them. Three trials of each; a trial takes a second.
"""

from dataclasses import replace

import rtstack

parameters = rtstack.Simulation().parameters

for interim_s in (0.05, parameters.control.interim_s, 0.2):
    varied = replace(parameters, control=replace(parameters.control, interim_s=interim_s))
    table = rtstack.run_trials("ref.mcap", 3, displacements=[-30.0], parameters=varied, workers=1)
    norm = table.mean("average_force_norm")
    print(
        f"interim mode of {interim_s * 1e3:3.0f} ms: mean force norm {norm.mean:.1f} [{norm.low:.1f}, {norm.high:.1f}]"
    )
    print(table)
