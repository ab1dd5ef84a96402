"""The time from one state to the next as a client of a real FR3 measured it, and as ours does on the simulated one."""

import json
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from reality.comparison import Finding

RUNS = "[cr]*_model_rt_r*"  # of the set's folder, JSON each: libfranka (cpp) and franka-rs (rust)
HEADINGS = {"p50": 50.0, "p99": 99.0, "p999": 99.9, "max": 100.0}


def compare(folder: Path) -> Finding:
    """Measure the simulated link on this machine, in real time, during a demonstration: us."""
    measured = [json.loads(path.read_text(encoding="utf-8")) for path in sorted(folder.glob(RUNS))]
    lines: dict[str, Sequence[float | None]] = {
        f"FR3, {run['library']}, run {run['rep']}": [float(run["interval_us"][name]) for name in HEADINGS]
        for run in measured
    }
    period_us = _simulated()
    lines["simulated FR3, two arms, this machine"] = np.percentile(period_us, list(HEADINGS.values())).tolist()
    return Finding(
        sum(int(run["cycles"]) for run in measured), len(period_us), "us between two states", list(HEADINGS), lines,
        fitted="nothing",
    )  # fmt: skip


def _simulated():
    """Return the time between two states of the left arm, us, (n,): simulated robots on the wire, a demonstration."""
    from rtstack.cells import load_description, open_cell
    from rtstack.trials.demonstration import run_demonstration
    from rtstack.trials.record import RunSamples
    from rtstack.trials.run_context import RunContext
    from rtstack.trials.specification import DemonstrationSpecification
    from rtstack.trials.start_motion import start_motion

    description, _ = load_description(None)
    asked = DemonstrationSpecification()
    cell = open_cell("realtime", asked.object, 0.0, asked.seed, description)
    try:
        samples = RunSamples(Path("unwritten.mcap"))
        way = start_motion(cell, description, asked.object)
        run_demonstration(asked, description, cell, RunContext(samples), way=way)
    finally:
        cell.close()
    assert samples.columns is not None
    return samples.columns.timing["period_us"][1:]
