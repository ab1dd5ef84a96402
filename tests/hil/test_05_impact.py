"""05 impact: both arms hit the box on purpose, and both know it. What is recorded here is the reference of 06."""

import numpy as np
import pytest

from hal.limits import COLLISION_TORQUES
from rtstack.log.reader import read_log
from rtstack.samples import SIDES

LEAST_PEAK_N = 20.0  # of each pad: less than any wanted impact of the rice box, and more than the noise at rest


@pytest.mark.usefixtures("in_motion")
def test_both_pads_hit_the_box_and_both_arms_see_it(demonstrate, hil_recording, record_property) -> None:
    result = demonstrate()
    assert result.success, result.failure_reason
    assert result.safety_interventions == 0
    assert result.detected_impact_time_s is not None
    record_property("impact s", result.detected_impact_time_s)
    record_property("lift mm", result.max_lift_mm)
    recorded = read_log(hil_recording)
    for side in SIDES:
        arm = recorded.topic(f"/{side}/arm")
        assert not arm["current_errors"].any()
        peak = np.abs(arm["O_F_ext_hat_K"][:, :3]).max()
        share = (np.abs(arm["tau_ext_hat_filtered"]) / COLLISION_TORQUES).max()
        record_property(f"{side} peak N", float(peak))
        record_property(f"{side} of a collision", float(share))
        assert peak > LEAST_PEAK_N
        assert share < 1.0
