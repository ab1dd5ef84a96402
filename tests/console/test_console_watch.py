"""What the page is told: the robot's own words, and their true age."""

import json

import numpy as np

from console.live.arm_watch import ArmWatch
from hal.robot_errors import error_bit
from hal.state import RobotMode
from rtstack.log.ring import Rings
from rtstack.samples import ARM_SAMPLE, CONTROL_SAMPLE, EVENT, TIMING_SAMPLE, Level, Mode
from tests.support.console.client import socket, wait_for

PATIENCE_S = 60.0


def push_arm(served, side, t_ns, robot_mode=RobotMode.MOVE, mode=Mode.INTERIM, errors=0):
    arm, control = np.zeros(1, ARM_SAMPLE), np.zeros(1, CONTROL_SAMPLE)
    arm["t_ns"] = control["t_ns"] = t_ns
    arm["robot_mode"], control["mode"], arm["current_errors"] = robot_mode, mode, errors
    arm["q"] = np.arange(7) * (1.0 if side == "left" else -1.0)
    served.rings.pusher(f"/{side}/arm").push(arm)
    served.rings.pusher(f"/{side}/control").push(control)


def test_the_view_says_what_each_robot_said(served):
    watch = served.parts.watch
    assert watch.view.left.robot_mode == "UNKNOWN"
    assert watch.q() is None
    push_arm(served, "left", 5_000_000)
    push_arm(served, "right", 5_000_000, RobotMode.REFLEX, Mode.STOPPED, error_bit("joint_reflex"))
    wait_for(lambda: "UNKNOWN" not in (watch.view.right.robot_mode, watch.view.right.mode))
    assert (watch.view.left.robot_mode, watch.view.left.mode, watch.view.left.errors) == ("MOVE", "INTERIM", ())
    assert (watch.view.right.robot_mode, watch.view.right.mode) == ("REFLEX", "STOPPED")
    assert watch.view.right.errors == ("joint_reflex",)
    np.testing.assert_array_equal(watch.q(), [np.arange(7), -np.arange(7)])


def test_an_age_grows_until_the_robot_speaks_again(served):
    watch = served.parts.watch
    push_arm(served, "left", 1)
    wait_for(lambda: 0.3 < watch.view.left.age_s < 1e5)
    push_arm(served, "left", 1)  # the same state again is no news
    grown = watch.view.left.age_s
    wait_for(lambda: watch.view.left.age_s > grown + 0.1)
    push_arm(served, "left", 2)
    wait_for(lambda: watch.view.left.age_s < 0.1)
    assert watch.view.right.age_s > 1e5


def test_loop_health_counts_what_was_missed_over_jobs(served):
    watch = served.parts.watch
    pusher, timing = served.rings.pusher("/timing"), np.zeros(1, TIMING_SAMPLE)
    for period_us, missed in [(1000.0, 0)] * 99 + [(3000.0, 2)] + [(1000.0, 0)] * 50 + [(1000.0, 1)] * 50:
        timing["period_us"], timing["missed_deadlines"] = period_us, missed
        pusher.push(timing)
    wait_for(lambda: watch.view.loop.missed == 3)
    assert watch.view.loop.period_us == 1010.0
    assert 1000.0 <= watch.view.loop.period_p99_us <= 3000.0


def test_late_and_missed_ticks_are_told_by_what_they_mean(served):
    watch = served.parts.watch
    pusher, timing = served.rings.pusher("/timing"), np.zeros(1, TIMING_SAMPLE)

    def ticks(count, period_us, missed_each):
        for _ in range(count):
            timing["period_us"] = period_us
            timing["missed_deadlines"] += missed_each
            pusher.push(timing)

    def told():
        return watch.view.loop.lateness, watch.view.loop.losses

    ticks(100, 1000.0, 0)
    wait_for(lambda: watch.view.loop.period_us == 1000.0)
    assert told() == ("good", "good")
    ticks(1, 1000.0, 1)
    wait_for(lambda: told() == ("good", "late"))
    ticks(10, 1400.0, 1)
    wait_for(lambda: told() == ("late", "bad"))


def test_the_live_socket_sends_view_events_and_status(served):
    event = np.zeros(1, EVENT)
    event["t_ns"], event["level"], event["name"], event["text"] = (
        1_250_000_000,
        Level.WARNING,
        b"impact",
        b"<b>early</b>",
    )
    served.rings.pusher("/events").push(event)
    push_arm(served, "left", 1)
    wait_for(lambda: served.parts.watch.view.event is not None and served.parts.watch.view.status is not None)
    with served.signed_in() as (client, _), socket(served, "/live", client) as stream:
        view = json.loads(stream.recv(timeout=60))
        assert view["event"]["t_s"] == 1.25
        assert (view["event"]["level"], view["event"]["text"]) == ("WARNING", "<b>early</b>")
        assert view["left"]["mode"] == "INTERIM"
        assert view["status"]["cell"] == "grab"
        assert view["status"]["phase"] == "disarmed"
        assert view["you"] == "operator 1"
        assert client.get("/api/events").json()[-1] == view["event"]


def test_a_spike_of_one_sample_is_in_one_view_at_least_and_the_pad_has_the_speed_of_its_way(cell):
    samples = np.zeros(60, ARM_SAMPLE)
    samples["t_ns"] = np.arange(1, 61) * 1_000_000
    samples["O_T_EE"][:, 1, 3] = 0.5e-3 * np.arange(60)  # 0.5 m/s
    samples["O_F_ext_hat_K"][:, 2] = 3.0
    samples["O_F_ext_hat_K"][25, :3] = (0.0, 300.0, 400.0)
    one = np.zeros(1, ARM_SAMPLE)
    with Rings.create(capacity=256) as rings:
        watch = ArmWatch(rings, "left", cell.left)
        pusher = rings.pusher("/left/arm")
        views = []
        for first in (0, 20, 40, 60, 60):
            for sample in samples[first : first + 20]:
                one[0] = sample
                pusher.push(one)
            views.append(watch.view(0.0))
    assert [view.peak_force_n for view in views] == [3.0, 500.0, 500.0, 500.0, 3.0]
    assert [view.force_n for view in views] == [3.0] * 5
    assert views[0].pad_speed_m_s is None  # nobody knows where it was before
    np.testing.assert_allclose([view.pad_speed_m_s for view in views[1:3]], 0.5)
    assert [view.pad_speed_m_s for view in views[3:]] == [0.0, 0.0]
