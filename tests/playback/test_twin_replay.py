"""The commands of a log in a twin's plant: its contact force where the twin is the robot, another where it is not."""

import json

import numpy as np
import pytest

from hal.configuration import read_toml, toml_text
from rtstack.cli.replay import forces
from rtstack.playback.twin_replay import replay_in_twin
from rtstack.trials.errors import TrialError
from tests.programs.hidden_robots import IDEAL


def test_a_twin_that_is_the_robot_gives_the_logs_contact_force(demonstration):
    made = replay_in_twin(demonstration.path, "ideal")
    assert abs(made.replayed_ticks - made.ticks) < 50  # a script waits for its impact
    for arm in made.arms:
        assert arm.ticks > 1000
        assert abs(arm.off) < 0.05
        assert arm.path_mm < 5.0
    told = "\n".join(forces(made))
    assert f"{made.arms[0].mean_n[0]:.1f} N" in told


def test_another_robot_is_seen_in_force_or_path(demonstration, tmp_path, command_line):
    profile = tmp_path / "other.toml"
    document, _ = read_toml(IDEAL)
    profile.write_text(toml_text(document | {"left": {"friction_p1": [3.0] * 7, "payload_kg": 1.5}}))
    said = command_line("replay", demonstration.path, "--twin", profile, "--json")
    assert said.returncode in (0, 1), said.stderr
    left, right = json.loads(said.stdout)["arms"]
    assert left["path_mm"] > 2.0 * right["path_mm"]
    assert np.linalg.norm(left["torque_nm"]) > 2.0 * np.linalg.norm(right["torque_nm"])


def test_an_unknown_profile_is_one_line(demonstration):
    with pytest.raises(TrialError, match="unknown profile 'mine'"):
        replay_in_twin(demonstration.path, "mine")
