"""Four trials on the workers of a Dask scheduler: two controllers, the box displaced to either side.

The scheduler and its two workers are processes of this machine; in a lab they are `dask scheduler` and `dask worker
tcp://HOST:PORT --nthreads 1` on others, with the same version of rtstack. The results are the same to the bit.
"""

import csv
import logging
from pathlib import Path

from distributed import LocalCluster

from rtstack.cli.campaign import campaign
from rtstack.experiments.registry import plan_file

FOLDER = Path("campaign")
QUIET = {"dashboard": False, "dashboard_address": "127.0.0.1:0"}
EXPERIMENT = """
[[experiments]]
name = "table2"
references = ["rice_box/0"]
displacements_mm = [-30.0, 30.0]
repetitions = 1
"""

if __name__ == "__main__":  # the workers import this file
    # a plan of our own: contact and success as in the paper's campaign, with one small experiment
    lines = plan_file("reference-spreading").path.read_text().split("[[experiments]]")[0].splitlines()
    lines = ['controllers = ["no_interim", "proposed"]' if line.startswith("controllers") else line for line in lines]
    Path("small.toml").write_text("\n".join(lines) + EXPERIMENT)

    with LocalCluster(n_workers=2, threads_per_worker=1, silence_logs=logging.ERROR, scheduler_kwargs=QUIET) as cluster:
        campaign("small.toml", FOLDER, quick=False, workers=None, scheduler=cluster.scheduler_address, resume=False)

    with (FOLDER / "results.csv").open() as file:
        for row in csv.DictReader(file):
            print(row["controller"], row["displacement_mm"], "mm: success", row["success"])
