"""The learned grab: its frame, its network, and the campaign that judges it."""

import subprocess
import sys

import numpy as np
import pytest
from learned_grab.network import LearnedGrab, Network, features, into, place_of, train, yaw_of
from learned_grab.scripted import POSES, STEP_S, scripted_way

from hal.displacement import Displacement
from rtstack.cli.policy import open_policy
from rtstack.model.rotation import exp_so3, quaternion_from_rotation, rotation_from_quaternion
from rtstack.teleoperation.policy import Observation
from rtstack.trials.errors import TrialError

PLACED = np.array([0.0, 0.0, 0.3, 1.0, 0.0, 0.0, 0.0])


def seen(way, t_s, thing):
    """What a policy sees on a way, of arms that follow at once."""
    pose = way._poses[min(round(1e3 * t_s), len(way._poses) - 1)]
    return Observation(1, 0, t_s, np.zeros((2, 7)), np.zeros((2, 7)), pose, pose, np.zeros((2, 3)), thing)


def at(displacement):
    """The object's pose at a place."""
    half = 0.5 * displacement.yaw_rad
    return np.array([displacement.x_m, displacement.y_m, 0.3, np.cos(half), 0.0, 0.0, np.sin(half)])


def moved(pose, displacement):
    """A pose that was turned and shifted with the object."""
    turn, out = np.zeros((3, 3)), np.zeros(7)
    exp_so3(np.array([0.0, 0.0, displacement.yaw_rad]), 1.0, turn)
    out[:3] = turn @ pose[:3] + (displacement.x_m, displacement.y_m, 0.0)
    quaternion_from_rotation(np.ascontiguousarray(turn @ rotation_from_quaternion(pose[3:])), out[3:])
    return out


def test_what_moves_with_the_object_looks_the_same_to_the_network():
    displacement = Displacement.given(30.0, -20.0, 9.0)
    pads = scripted_way(0, Displacement())._poses[1000]
    shifted = np.stack([moved(pad, displacement) for pad in pads])
    here = into(place_of(PLACED), pads)
    np.testing.assert_allclose(into(place_of(at(displacement)), shifted), here, atol=1e-9)
    np.testing.assert_allclose(yaw_of(pads), 0.0, atol=1e-3)
    np.testing.assert_allclose(yaw_of(shifted), displacement.yaw_rad, atol=1e-3)


def test_a_network_says_what_was_demonstrated_and_its_file_says_the_same(tmp_path):
    way = scripted_way(0, Displacement())
    shown = [seen(way, STEP_S * k, PLACED) for k in range(100)]
    inputs = np.array([features(each.t_s, place_of(PLACED), each.pose, 0.3) for each in shown])
    asked = np.array([into(place_of(PLACED), way.act(each).poses).ravel() for each in shown])
    count = inputs.shape[1]
    network, left = train(inputs, asked, slice(count - 9, count - 1), 0)
    assert left < 0.01
    network.save(tmp_path / "policy.npz")
    policy = LearnedGrab(Network.load(tmp_path / "policy.npz"))
    policy.act(shown[0])
    for each in shown[::20]:
        said, wanted = policy.act(each).poses, way.act(each).poses
        assert said.shape == (POSES, 2, 7)
        assert np.abs(said[..., :3] - wanted[..., :3]).mean() < 0.015
        assert np.abs((said[..., 3:] * wanted[..., 3:]).sum(axis=-1)).min() > 0.999


def test_a_policy_that_has_not_seen_the_object_has_no_answer():
    way = scripted_way(0, Displacement())
    network = Network([(np.zeros((36, 80)), np.zeros(80))], np.zeros(80), np.ones(80))
    assert LearnedGrab(network).act(seen(way, 0.0, None)) is None


def test_a_file_that_is_no_network_is_refused_in_one_line(learned_grab):
    with pytest.raises(TrialError, match="rtstack campaign learned-grab"):
        open_policy("learned_grab:none.npz", 20.0)


@pytest.mark.long
def test_the_campaign_trains_judges_and_goes_on_where_it_was(tmp_path, learned_grab):
    out = tmp_path / "grab"
    command = [sys.executable, "-m", "rtstack", "campaign", "learned-grab", "--quick", "--workers", "1", "--out", out]
    said = subprocess.run(command, capture_output=True, text=True, check=True).stdout
    assert "15 trials" in said
    assert "learned: " in said
    before = (out / "policy.npz").read_bytes()
    (out / "demonstrations" / "003.npz").unlink()
    subprocess.run([*command, "--resume"], capture_output=True, check=True)
    assert (out / "demonstrations" / "003.npz").exists()
    assert (out / "policy.npz").read_bytes() == before
