"""06 trial: the proposed controller follows the recording of 05, and leaves a log that anybody can read."""

import numpy as np
import pytest
from mcap.reader import make_reader

from rtstack.log.reader import read_log
from rtstack.samples import SIDES
from rtstack.trials.record import open_log
from rtstack.trials.run_context import RunContext
from rtstack.trials.specification import TrialSpecification
from rtstack.trials.start_motion import start_motion
from rtstack.trials.trial import prepare_trial, run_trial


@pytest.mark.usefixtures("in_motion")
def test_a_trial_grabs_lifts_and_releases(
    cell_source, robot, open_arms, description, hil_recording, demonstrate, tmp_path, record_property
) -> None:
    if not hil_recording.exists():
        if not robot.simulated:
            pytest.fail("05 has left no recording to follow: run it first")
        assert demonstrate().success  # 05 may be another worker's
    path = tmp_path / "trial.mcap"
    specification = TrialSpecification(str(hil_recording))
    prepared = prepare_trial(specification, description)
    with open_arms(specification.object) as arms:
        way = start_motion(arms, description, specification.object, 0.0, prepared.reference.ante[:, 0])
        log = open_log(path, specification, description, robot.kind, cell_source, reference=prepared.reference)
        result = run_trial(prepared, arms, RunContext(log), way=way)
    for name in ("max_lift_mm", "average_force_norm", "peak_torque_ratio", "peak_velocity_ratio", "missed_deadlines"):
        record_property(name, getattr(result, name))
    assert result.success, result.failure_reason
    assert result.safety_interventions == 0
    assert result.impact_verdict == "expected", result.impact_reason
    with path.open("rb") as file:  # a reader that is not ours
        summary = make_reader(file).get_summary()
    assert summary is not None
    topics = {channel.topic for channel in summary.channels.values()}
    assert {"/left/arm", "/right/arm", "/timing", "/events"} <= topics
    read, recorded = read_log(path), read_log(hil_recording)
    if robot.simulated:  # 05 has left the arms elsewhere
        assert way is not None
        assert any("to the start pose" in event.text for event in read.events)
    for side in SIDES:
        away = np.abs(read.topic(f"/{side}/arm")["q"][0] - recorded.topic(f"/{side}/arm")["q"][0])
        assert away.max() < description.start_motion.tolerance_rad
        rates = read.topic(f"/{side}/arm")["control_command_success_rate"][100:]
        record_property(f"{side} success rate", float(rates.mean()))
        if robot.simulated:
            assert rates.min() == 1.0
