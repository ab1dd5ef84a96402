"""A trial is previewed without an arm, its hit is shown again slowly, and both end at once when anything moves."""

import shutil
import time

import numpy as np
import pytest

from console.scene.ghost import AROUND_S, SLOWLY, GhostPlayer, Shown, motion_of
from rtstack.live.protocol import JobState, RunRequest
from rtstack.log.reader import read_log
from rtstack.trials.specification import TrialSpecification
from tests.support.console.client import arm, wait_for


@pytest.fixture
def reference(served, demonstration):
    """The id of a recording that the console has."""
    shutil.copy(demonstration.path, served.logs / "demonstration.mcap")
    (entry,) = served.parts.catalogue.entries()
    return entry


@pytest.mark.long
def test_a_trial_is_simulated_in_a_process_of_its_own_and_shown(served, reference):
    with served.signed_in() as (client, headers):
        order = {"reference": reference.id, "object": "rice_box", "displacement_mm": -20.0, "law_inertia": "M"}
        answer = client.post("/api/jobs/preview", json=order, headers=headers)
        assert (answer.status_code, answer.json()["running"]) == (202, True)
        wait_for(lambda: not client.get("/api/jobs/preview").json()["running"])
        view = client.get("/api/jobs/preview").json()
        assert (view["success"], view["line"].split(",")[0]) == (True, "would succeed")
        shown = served.parts.scenes.ghost.view
        assert (shown.shown, shown.speed) == (Shown.PREVIEW, 1.0)
        assert 1.0 < shown.impact_s < shown.end_s
        assert served.job_manager.status().job is None  # nothing was ordered
        assert [path.name for path in served.logs.glob("*.mcap")] == ["demonstration.mcap"]
        arm(client, headers)
        assert client.post("/api/jobs/demonstration", json={"object": "rice_box"}, headers=headers).status_code == 202
        served.parts.scenes.ghost.watch(served.job_manager.status())
        assert served.parts.scenes.ghost.view is None
        refused = client.post("/api/jobs/preview", json=order, headers=headers)
        assert (refused.status_code, "something moves" in refused.json()["error"]) == (409, True)


def test_a_grab_is_planned_in_a_process_of_its_own_shown_and_becomes_what_a_trial_may_follow(served):
    order = {"object": "rice_box", "speed": 0.3, "height": 0.02, "squeeze": 40.0}
    with served.signed_in() as (client, headers):
        assert client.post("/api/planned", json=order | {"object": "no_box"}, headers=headers).status_code == 409
        assert client.post("/api/planned/reference", json={}, headers=headers).status_code == 409  # there is none yet
        for asked, success, line in ((order | {"squeeze": 1.0}, False, "squeeze"), (order, True, "is possible")):
            answer = client.post("/api/planned", json=asked, headers=headers)
            assert (answer.status_code, answer.json()["running"]) == (202, True)
            wait_for(lambda: not client.get("/api/planned").json()["running"])
            view = client.get("/api/planned").json()
            assert (view["success"], line in view["line"]) == (success, True), view
        shown = served.parts.scenes.ghost.view
        assert 0.5 < shown.impact_s < shown.end_s
        assert list(served.logs.glob("*.mcap")) == []  # until it is to be used
        made = client.post("/api/planned/reference", json={}, headers=headers)
        assert made.status_code == 201
        (row,) = client.get("/api/logs").json()
        assert (row["id"], row["kind"], row["object"], row["recording"]) == (
            made.json()["id"],
            "plan",
            "rice_box",
            True,
        )
        assert client.post("/api/planned", json=order, headers=headers).status_code == 202
        cancelled = client.request("DELETE", "/api/planned", json={}, headers=headers).json()
        assert (cancelled["running"], cancelled["line"]) == (False, "was cancelled")
        assert client.post("/api/planned/reference", json={}, headers=headers).status_code == 409


def test_the_200_ms_around_the_hit_of_a_trial_are_shown_at_a_twentieth(served, reference):
    ghost = served.parts.scenes.ghost
    request = RunRequest(TrialSpecification(str(reference.path)), "anna")
    served.job_manager.authority.take("anna")
    served.job_manager.authority.arm("anna")
    ghost.watch(served.job_manager.status())
    served.job_manager.order(request)
    ghost.watch(served.job_manager.status())
    served.job_manager.started(reference.path.name)  # any log with an impact in it
    served.job_manager.finished(JobState.DONE, None, True, reference.path.name)
    status = served.job_manager.status()
    ghost.watch(status)
    wait_for(lambda: ghost.view is not None)
    view = ghost.view
    impact_s = float(read_log(reference.path).metadata["result"]["detected_impact_time_s"])
    assert (view.shown, view.speed, view.impact_s) == (Shown.REPLAY, SLOWLY, impact_s)
    assert view.end_s == pytest.approx(impact_s + AROUND_S, abs=0.003)
    with served.signed_in() as (client, headers):
        assert client.post("/api/scene/ghost/end", json={}, headers=headers).status_code == 200
    assert ghost.view is None


def test_a_ghost_is_where_the_log_was_at_that_time(served, reference):
    log = read_log(reference.path)
    motion = motion_of(log, 1.0, 1.2)
    arm_samples = log.topic("/left/arm")
    times = (arm_samples["t_ns"] - arm_samples["t_ns"][0]) * 1e-9
    row = np.abs(times - motion.t_s[50]).argmin()
    np.testing.assert_allclose(motion.q[50, 0], arm_samples["q"][row], atol=1e-3)
    assert motion.object == "rice_box"
    assert motion.object_poses is not None
    player = GhostPlayer(served.logs)
    player.play(motion, Shown.PREVIEW, speed=1e6)
    time.sleep(0.001)
    pose = player.pose()
    assert pose is not None
    np.testing.assert_array_equal(pose[0], motion.q[-1])


def test_a_trial_that_had_ended_before_the_console_began_is_not_shown(served, reference):
    served.job_manager.authority.take("anna")
    served.job_manager.authority.arm("anna")
    served.job_manager.order(RunRequest(TrialSpecification(str(reference.path)), "anna"))
    served.job_manager.finished(JobState.DONE, None, True, reference.path.name)
    late = GhostPlayer(served.logs)
    late.watch(served.job_manager.status())
    late.watch(served.job_manager.status())
    time.sleep(1.0)
    assert late.view is None
