"""A policy of LeRobot leads: lerobot trains it on an export, the example runs it, in an environment of their own.

The first run installs lerobot with PyTorch, some 6 GB, into `.venv-foreign`.
"""

import os
import re
import subprocess
import time
from pathlib import Path

import numpy as np
import pytest

from rtstack.datasets.export import export
from rtstack.datasets.lerobot import LeRobot
from rtstack.log.reader import Log, read_log
from rtstack.teleoperation.reach import FASTEST_M_S
from tests.support.console.client import wait_for
from tests.support.console.stack import COMMAND, Stack, Viewer
from tests.support.foreign_robot import ROOT, environment
from tests.support.log.samples import TRIAL, write_log
from tests.support.log.seen import write_seen_log

EXAMPLE = ROOT / "examples" / "13_lerobot_policy.py"
INPUTS = """{"observation.state": {"type": "STATE", "shape": [28]},
             "observation.environment_state": {"type": "ENV", "shape": [8]}}"""
SMALL = "--policy.dim_model=128 --policy.dim_feedforward=256 --policy.n_encoder_layers=2 --policy.use_vae=false"
SHORT = "--batch_size=16 --num_workers=0 --eval_freq=0 --policy.chunk_size=50 --policy.n_action_steps=25"
STEPS = 150
LEADS_S = 5.0

pytestmark = [pytest.mark.alone, pytest.mark.long, pytest.mark.timeout(3600)]


def _environment(folder: Path) -> dict[str, str]:
    return {**os.environ, "HF_HUB_OFFLINE": "1", "HF_HOME": str(folder / "cache"), "OMP_NUM_THREADS": "1"}


def _train(folder: Path, data: str, steps: int, *more: str) -> Path:
    """Train an ACT by lerobot-train; return its checkpoint."""
    command = [
        str(environment("lerobot") / "bin" / "python"), "-m", "lerobot.scripts.lerobot_train",
        "--dataset.repo_id=local/grabs", f"--dataset.root={folder / data}", f"--output_dir={folder / 'trained'}",
        "--policy.type=act", "--policy.device=cpu", "--policy.push_to_hub=false", f"--steps={steps}",
        "--policy.optimizer_lr=3e-4", *SMALL.split(), *SHORT.split(), *more,
    ]  # fmt: skip
    done = subprocess.run(command, env=_environment(folder), capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr[-3000:]
    return folder / "trained" / "checkpoints" / "last" / "pretrained_model"


def _lead(folder: Path, checkpoint: Path) -> tuple[Log, str]:
    """Let a policy lead at a stack for LEADS_S; return the log, and what the example said."""
    logs = folder / "logs"
    logs.mkdir()
    create = [str(COMMAND), "token", "create", "--name", "lerobot", "--scope", "operate", "--logs", str(logs)]
    stack, viewer, example = Stack(logs), None, None
    try:
        token = subprocess.run(create, capture_output=True, text=True, check=True).stdout.strip()
        program = [str(environment("lerobot") / "bin" / "python"), str(EXAMPLE), str(checkpoint), stack.base, token]
        example = subprocess.Popen(
            program, env=_environment(folder), stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
        )
        assert example.stdout is not None
        assert any(line == "waits for a lease\n" for line in example.stdout), example.communicate()[1]
        stack.post("take")
        stack.post("arm")
        viewer = Viewer(stack, answers=True)
        stack.post("jobs/teleoperation", object="rice_box", recorded=True, stop_on_release=False)
        wait_for(lambda: stack.client.get("/api/status").json()["job"]["state"] == "running")
        wait_for(lambda: "lerobot" in stack.client.get("/api/teleoperation/hand").json()["policies"])
        stack.post("teleoperation/hand", speed_m_s=FASTEST_M_S)
        order = {"json": {"to": "lerobot"}, "headers": stack.headers}
        wait_for(lambda: stack.client.post("/api/policy/lease", **order).is_success)  # once the console sees it run
        time.sleep(LEADS_S)
        stack.post("policy/lease", to=None)
        said, errors = example.communicate(timeout=60)
        assert example.returncode == 0, errors
        stack.post("teleoperation/finish")
        wait_for(lambda: stack.client.get("/api/status").json()["job"]["state"] not in ("running", "stopping"))
        job = stack.client.get("/api/status").json()["job"]
        assert job["state"] == "done", job
    finally:
        if example is not None:
            example.kill()
            example.communicate()
        if viewer is not None:
            viewer.close()
        stack.end()
    return read_log(logs / job["log"]), said


def test_training_takes_an_exports_pictures(tmp_path: Path) -> None:
    """It writes ImageNet's statistics over those of each camera, and has to find some there."""
    log = write_log(tmp_path / "log.mcap", 1400, seed=0, trial={**TRIAL, "object": "rice_box"})
    write_seen_log(log.path, tmp_path / "seen.mcap")
    export([tmp_path / "seen.mcap"], tmp_path / "seen", LeRobot(ticks=False))
    inputs = """{"observation.images.front": {"type": "VISUAL", "shape": [3, 96, 400]},
                 "observation.state": {"type": "STATE", "shape": [28]}}"""
    untaught = "--policy.pretrained_backbone_weights=null"
    _train(tmp_path, "seen", 2, f"--policy.input_features={inputs}", untaught)


def test_a_trained_policy_leads_through_the_filter_until_its_lease_is_over(demonstration, tmp_path: Path) -> None:
    export([demonstration.path], tmp_path / "grabs", LeRobot(ticks=False))
    checkpoint = _train(tmp_path, "grabs", STEPS, f"--policy.input_features={INPUTS}")
    log, said = _lead(tmp_path, checkpoint)
    assert re.fullmatch(r"answered \d+ observations\n", said)  # and none of them was refused
    texts = [event.text for event in log.events]
    assert texts[1:3] == ["a policy leads, lease 1", "the policy's lease is over: the arms hold"], texts
    result = log.metadata["result"]
    assert (result["success"], result["safety_interventions"]) == ("true", "0"), result
    for side, towards in (("left", -1.0), ("right", 1.0)):
        control, arm = log.topic(f"/{side}/control"), log.topic(f"/{side}/arm")
        asked = control["pose_ref"]
        assert np.ptp(asked[:, 1]) > 0.1  # what it was shown: to the box, by 0.3 m
        assert towards * (asked[-1, 1] - asked[0, 1]) > 0.1
        assert np.abs(np.diff(asked[:, :3], axis=0)).max() < 1e-3 * (FASTEST_M_S + 0.05)
        assert np.ptp(arm["q"][:, 3]) > 0.05  # rad: they went
