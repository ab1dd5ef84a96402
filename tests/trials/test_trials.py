"""The grab, end to end through the real parts: recording, reference, trial, log, review."""

from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from rtstack.log.reader import read_log
from rtstack.papers.reference_spreading.controllers import NAMES
from rtstack.samples import SIDES, Mode
from rtstack.trials.review import log_columns, review_log
from tests.support.runs import StopAfter


def test_a_demonstration_is_a_recording_with_an_impact(demonstration):
    assert demonstration.result.success, demonstration.result.failure_reason
    assert demonstration.result.max_lift_mm > 200.0
    log = read_log(demonstration.path)
    modes = log.topic("/left/control")["mode"]
    assert set(modes.tolist()) == {Mode.TELEOPERATION, Mode.STOPPING}
    assert log.metadata["trial"]["kind"] == "demonstration"
    assert {a.name for a in log.attachments} >= {"cell.toml", "fr3.urdf"}


@pytest.mark.parametrize("displacement_mm", [-30.0, 30.0])
def test_the_proposed_controller_grabs_a_displaced_box(runner, displacement_mm, tmp_path):
    path = tmp_path / "trial.mcap"
    result = runner.run(displacement_mm=displacement_mm, log=path)
    assert result.success, result.failure_reason
    assert result.max_lift_mm > 200.0
    assert result.safety_interventions == 0
    review = review_log(path)
    first, second = sorted(review.first_contact_s)
    assert second - first > 0.02  # two separate impacts
    assert (review.first_contact_s[0] < review.first_contact_s[1]) == (displacement_mm > 0)
    assert result.detected_impact_time_s == pytest.approx(first, abs=0.005)
    told = [event for event in read_log(path).events if event.name == "impact"]
    contacts = sorted(zip(review.first_contact_s, SIDES, strict=True))
    assert [event.text.split()[-1] for event in told] == [side for _, side in contacts]
    # an arm that meets an object already moving hits it more slowly: the detector has to wait longer
    assert [float(event.text.split()[2]) for event in told] == pytest.approx([s for s, _ in contacts], abs=0.02)
    assert review.score.average_force_norm == result.average_force_norm
    assert review.score.held
    assert review.score.max_lift_mm == result.max_lift_mm


def _wrench_steps(path: Path) -> tuple[np.ndarray, int, int, np.ndarray, tuple[float | None, float | None]]:
    """Tick-to-tick change of each arm's desired wrench (2, n), ticks of both switches, the largest ordinary change of
    each
    arm in the 200 ms before the first contact, and the first contacts."""
    columns = log_columns(read_log(path))
    t_s = (columns.arm[0]["t_ns"] - columns.arm[0]["t_ns"][0]) * 1e-9
    modes = columns.control[0]["mode"]
    contacts = review_log(path).first_contact_s
    steps = np.linalg.norm(np.diff(columns.control["wrench_desired"], axis=1, prepend=0.0), axis=2)
    before = (t_s > min(contacts) - 0.2) & (t_s < min(contacts) - 0.005)
    return (
        steps,
        int(np.flatnonzero(modes == Mode.INTERIM)[0]),
        int(np.flatnonzero(modes == Mode.POST_IMPACT)[0]),
        steps[:, before].max(axis=1),
        contacts,
    )


def test_the_desired_wrench_is_continuous_where_the_interim_mode_ends(runner, tmp_path):
    path = tmp_path / "trial.mcap"
    assert runner.run(log=path).success
    steps, _, to_post, ordinary, _ = _wrench_steps(path)
    assert np.all(steps[:, to_post - 5 : to_post + 6].max(axis=1) <= 2.0 * ordinary)


def test_the_desired_wrench_of_the_arm_that_was_not_hit_is_continuous_where_the_interim_mode_begins(runner, tmp_path):
    """The arm that was hit has the detection delay's peak there; the other one shows the controller alone."""
    path = tmp_path / "trial.mcap"
    assert runner.run(displacement_mm=-30.0, log=path).success
    steps, to_interim, _, ordinary, contacts = _wrench_steps(path)
    assert contacts[1] < contacts[0]
    assert steps[0, to_interim - 5 : to_interim + 6].max() <= 2.0 * ordinary[0]


def test_the_same_seed_gives_the_same_bits_and_another_one_does_not(runner, tmp_path):
    logs = []
    for name, seed in (("a", 3), ("b", 3), ("c", 4)):
        path = tmp_path / f"{name}.mcap"
        runner.run(displacement_mm=15.0, seed=seed, log=path)
        logs.append(read_log(path))
    for side in SIDES:
        a, b, c = (log.topic(f"/{side}/arm") for log in logs)
        for field in ("q", "dq", "tau_J", "tau_desired", "tau_applied"):
            assert a[field].tobytes() == b[field].tobytes()
        n = min(len(a), len(c))
        assert np.any(a["q"][:n] != c["q"][:n])
        assert np.any(a["tau_applied"][:n] != c["tau_applied"][:n])


@pytest.mark.parametrize("controller", [name for name in NAMES if name != "proposed"])
def test_a_baseline_is_worse_than_the_proposed_controller(runner, controller):
    proposed, baseline = runner.run(), runner.run(controller)
    assert proposed.average_force_norm < baseline.average_force_norm


@pytest.mark.parametrize("tick", [0, 500, 1310, 2500])
def test_a_stop_brakes_both_arms_and_keeps_what_they_hold(runner, tmp_path, tick):
    path = tmp_path / "stopped.mcap"
    result = runner.run(log=path, stop=StopAfter(tick))
    assert not result.success
    assert "stop requested" in result.failure_reason
    columns = log_columns(read_log(path))
    stopping = np.flatnonzero(columns.control[0]["mode"] == Mode.STOPPING)
    assert stopping[0] == tick
    assert np.abs(columns.arm["dq"][:, -1]).max() < 0.02
    assert result.safety_interventions == 0
    if tick == 2500:  # the box is up: it stays there
        height = columns.object["position"][:, 2]
        assert height[-1] > height[0] + 0.15


def test_demonstrations_differ_as_their_numbers_do(cell):
    from rtstack.references.demonstration import duration_s, grab

    scripts = [grab(n) for n in range(10)]
    assert len({duration_s(s) for s in scripts}) == 10
    assert grab(4) == scripts[4]
    for a, b in pairwise(scripts[1:]):
        assert abs(a.speed_y - b.speed_y) + abs(a.height - b.height) + abs(a.lift - b.lift) > 1e-3


def test_nothing_is_written_without_a_log(runner, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert runner.run().log is None
    assert list(Path(tmp_path).iterdir()) == []
