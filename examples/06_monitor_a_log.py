"""Judge an impact afterwards: the aim-aware monitor over a recorded log, with the tuning that comes with rtstack.

The monitor knows no robot. It takes residual, joints and a reference, and says whether the impact was the one that was
meant. Here the reference comes from the demonstration that is attached to the log.
"""

from pathlib import Path

from rtstack.cells import load_description
from rtstack.log.reader import read_log
from rtstack.monitor.monitor import Monitor
from rtstack.references.source import load_reference
from rtstack.samples import SIDES
from rtstack.trials.assembly import arm_controllers, cell_parameters
from rtstack.trials.monitoring import tuning_of

description, _ = load_description(None)
parameters = cell_parameters(description)
reference = load_reference(Path("ref.mcap"), arm_controllers(description, parameters), parameters.detector)
expected = reference.impact
assert expected is not None, "a planned reference knows no joints"

tuning = tuning_of("rice_box")
assert tuning is not None, "no monitor was tuned for this object"

log = read_log(Path("trial.mcap"))
for arm, side in enumerate(SIDES):
    state, control = log.topic(f"/{side}/arm"), log.topic(f"/{side}/control")
    n = round(expected.set_down_s / reference.period_s)  # what is put down hits the table: another impact
    monitor = Monitor(tuning.monitor.arm)
    monitor.expect(round(expected.t_d_s * 1e9), expected.q_d[arm])
    found = monitor.assess(
        state["t_ns"][:n] - log.start_ns, control["momentum_residual"][:n], state["q"][:n], state["dq"][:n],
        expected.dq_post[arm, :n],
    )  # fmt: skip
    print(
        f"{side}: {found.verdict.name.lower()}, margin {found.margin:.2f}, first impact at "
        f"{found.t_first_ns * 1e-9:.3f} s, expected at {expected.t_d_s:.3f} s"
    )
