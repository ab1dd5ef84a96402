"""A recording with ticks missed, as real time has them, still gives its reference; one with a hole does not."""

from dataclasses import replace

import numpy as np
import pytest

from rtstack.log.reader import read_log
from rtstack.log.ring import Rings
from rtstack.log.writer import LogProcess
from rtstack.references.recording import Recording, ReferenceError, load_recording
from rtstack.samples import SIDES
from rtstack.topics import TOPICS
from rtstack.trials.assembly import arm_controllers, default_parameters


def _without(source, target, dropped: np.ndarray) -> None:
    """Copy a recording without the ticks `dropped`."""
    log = read_log(source)
    with Rings.create() as rings:
        process = LogProcess.start(target, rings, log.metadata)
        keep = np.setdiff1d(np.arange(len(log.topic("/timing"))), dropped)
        for topic in TOPICS:
            records = log.topic(topic)
            if topic.split("/")[1] in (*SIDES, "timing") and len(records):  # arms without a clock have no turns
                records = records[keep]
            push = rings.pusher(topic).push
            for k in range(len(records)):
                if k % 1000 == 0:
                    process.wait_room(1000)
                push(records[k : k + 1])
        process.close()


def _load(path, cell) -> Recording:
    parameters = default_parameters()
    arms = arm_controllers(cell, parameters)
    return load_recording(path, arms, parameters.detector, parameters.control.period_s)


def test_missed_ticks_are_bridged(demonstration, cell, tmp_path):
    rng = np.random.default_rng(0)
    _without(demonstration.path, tmp_path / "gaps.mcap", rng.choice(np.arange(100, 5000), 200, replace=False))
    whole, bridged = _load(demonstration.path, cell), _load(tmp_path / "gaps.mcap", cell)
    assert abs(whole.impact - bridged.impact) <= 2
    assert whole.points.shape == bridged.points.shape
    np.testing.assert_allclose(bridged.points["position"], whole.points["position"], atol=2e-4)
    assert whole.impact * 1e-3 == pytest.approx(demonstration.result.detected_impact_time_s)


def test_a_hole_is_refused(demonstration, cell, tmp_path):
    _without(demonstration.path, tmp_path / "hole.mcap", np.arange(700, 730))
    with pytest.raises(ReferenceError, match="31 ms of the demonstration are missing"):
        _load(tmp_path / "hole.mcap", cell)


@pytest.mark.parametrize(
    ("moved_m", "pad_m", "refused"),
    [(0.0, 0.0, ""), (0.002, 0.0, ""), (0.01, 0.0, "10 mm off"), (0.0, 0.02, "20 mm off")],
)
def test_a_recording_from_before_the_geometry_changed_is_refused(demonstration, cell, moved_m, pad_m, refused):
    x, y, z = cell.left.base_position
    left = replace(cell.left, base_position=(x + moved_m, y, z))
    pad = replace(cell.pad, flange_to_face=cell.pad.flange_to_face + pad_m)
    now = replace(cell, left=left, right=replace(cell.right, pad=pad))
    if not refused:
        assert _load(demonstration.path, now).impact == _load(demonstration.path, cell).impact
        return
    with pytest.raises(ReferenceError, match=f"bases and pads elsewhere .* up to {refused}; record it again"):
        _load(demonstration.path, now)


@pytest.mark.parametrize(
    ("apart_m", "refused"), [(0.005, ""), (0.03, "28 mm further apart"), (-0.03, "32 mm nearer together")]
)
def test_a_recording_whose_pads_were_not_as_far_apart_as_the_object_is_wide_is_refused(
    demonstration, cell, monkeypatch, apart_m, refused
):
    x, y, z = cell.left.base_position
    believed = replace(cell, left=replace(cell.left, base_position=(x, y + apart_m, z)))
    monkeypatch.setattr("rtstack.references.recording.described_in", lambda log: believed)  # as its file had said
    if not refused:
        assert _load(demonstration.path, believed).problem is None
        return
    with pytest.raises(ReferenceError, match=f"held the rice_box, they were {refused} by"):
        _load(demonstration.path, believed)
