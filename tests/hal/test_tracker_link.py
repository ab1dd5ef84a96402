"""Object poses over UDP, and two clocks with messages between them that are late."""

import socket
import time

import numpy as np
import pytest

from hal.clock_relation import ClockRelation
from hal.tracker import OBJECT_POSE, ObjectPose, TrackerFrames, TrackerTimes
from hal.tracker_link import DATAGRAM, TrackerLink
from sim_robot.fci.server import TrackerFeed


class Seen:
    """A tracker that has seen what it is told."""

    def __init__(self) -> None:
        self.pose = ObjectPose.empty()

    def latest(self) -> ObjectPose:
        return self.pose

    def see(self, t_ns: int, x: float) -> None:
        record = self.pose.record
        record["t_ns"], record["seen"] = t_ns, 1
        record["position"][0] = (x, 0.5, 0.25)


def test_the_newest_pose_arrives_with_the_robots_time():
    link, tracker = TrackerLink(), Seen()
    feed = TrackerFeed(tracker, link.address)
    assert link.latest().record["seen"][0] == 0
    for k in range(3):
        tracker.see(4_000_000 * k, 0.1 * k)
        feed.publish(7_000_000_000 + 4_000_000 * k, 4_000_000 * k)
    pose = link.latest()
    assert pose.t_ns == 7_008_000_000
    assert np.array_equal(pose.position, [0.2, 0.5, 0.25])
    feed.publish(8_000_000_000, 1_008_000_000)  # nothing new was seen
    assert link.latest().t_ns == 7_008_000_000
    tracker.see(12_000_000, 0.3)
    feed.publish(9_000_000_000, 15_000_000)  # it was seen 3 ms ago, by the tracker's clock
    assert link.latest().t_ns == 8_997_000_000
    feed.close()
    link.close()


def test_datagrams_of_another_size_are_ignored():
    link = TrackerLink()
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
        for size in (0, 1, DATAGRAM.itemsize - 1, DATAGRAM.itemsize + 1, 9000):
            sender.sendto(b"\x01" * size, link.address)
    assert link.latest().record["seen"][0] == 0
    link.close()


def test_a_feed_without_a_listener_goes_on():
    link, tracker = TrackerLink(), Seen()
    feed = TrackerFeed(tracker, link.address)
    link.close()
    for k in range(3):
        tracker.see(k + 1, 0.0)
        feed.publish(k, k + 1)
    feed.close()


def test_a_datagram_is_one_record():
    assert DATAGRAM.itemsize == OBJECT_POSE.itemsize == 72


def test_a_pose_whose_time_cannot_be_told_is_not_used():
    robot_clock = ClockRelation()
    robot_clock.update(time.monotonic_ns(), time.monotonic_ns())
    link = TrackerLink(times=TrackerTimes("own"), robot_clock=robot_clock)
    record = np.zeros(1, DATAGRAM)
    record["seen"], record["orientation_wxyz"] = 1, (1.0, 0.0, 0.0, 0.0)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:

        def seen(t_ns: int) -> bool:
            record["t_ns"] = t_ns
            sender.sendto(record.tobytes(), link.address)
            return bool(link.latest().record["seen"][0])

        # one alone may have been held up for long
        assert not seen(0)
        assert any(seen(1_000_000 * k) for k in range(1, 40))
    link.close()


@pytest.mark.parametrize("frames", [TrackerFrames(), TrackerFrames(up="y", object_orientation_wxyz=(0.6, 0, 0.8, 0))])
def test_a_tracker_that_changes_the_sign_of_its_quaternions_gives_a_path_without_jumps(frames):
    link, rng = TrackerLink(frames=frames), np.random.default_rng(0)
    record, path = np.zeros(1, DATAGRAM), []
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
        for k, half in enumerate(np.linspace(0.0, 7.0, 200)):
            record["t_ns"], record["seen"] = k, 1
            record["orientation_wxyz"] = rng.choice([-1.0, 1.0]) * np.array([np.cos(half), 0.0, 0.0, np.sin(half)])
            sender.sendto(record.tobytes(), link.address)
            path.append(link.latest().orientation_wxyz.copy())
    link.close()
    steps = np.linalg.norm(np.diff(path, axis=0), axis=1)
    assert steps.max() == pytest.approx(steps.min(), rel=1e-3)
    assert np.linalg.norm(path, axis=1) == pytest.approx(1.0)


LEAST_NS = 1_500_000  # the delay that no estimator can see


def told(relation, rng, *, start_s, end_s, hz, offset_ns, ppm=0.0, jitter_ms=0.0, loss=0.0, origin_ns=0):
    """Send messages: clock b is offset + (1 + ppm) a; they arrive after the least delay and a random one."""
    for a_ns in range(origin_ns + round(start_s * 1e9), origin_ns + round(end_s * 1e9), round(1e9 / hz)):
        if rng.random() >= loss:
            b_ns = offset_ns + round((1.0 + 1e-6 * ppm) * a_ns) + LEAST_NS + round(1e6 * jitter_ms * rng.random())
            relation.update(a_ns, b_ns)


@pytest.mark.parametrize("ppm", [-50.0, 0.0, 50.0])
@pytest.mark.parametrize(("hz", "jitter_ms"), [(1000, 1.0), (240, 20.0), (100, 20.0)])
def test_offset_and_drift_are_found_under_jitter_and_loss(ppm, hz, jitter_ms):
    relation, rng = ClockRelation(), np.random.default_rng(hz)
    offset_ns = 1_700_000_000_000_000_000
    told(relation, rng, start_s=0, end_s=30, hz=hz, offset_ns=offset_ns, ppm=ppm, jitter_ms=jitter_ms, loss=0.05)
    # the least of n uniform delays is 1/(n+1) of the jitter on average; a block has hz/2
    share = jitter_ms * 1e6 / (0.95 * hz / 2)
    for a_s in (15.0, 30.0):
        truth_ns = offset_ns + round((1.0 + 1e-6 * ppm) * a_s * 1e9) + LEAST_NS
        assert abs(relation.b_of(round(a_s * 1e9)) - truth_ns) < 4.0 * share + 5e4
        assert abs(relation.a_of(truth_ns) - a_s * 1e9) < 4.0 * share + 5e4
    assert relation.resets == 0
    assert relation.drift_ppm == pytest.approx(ppm, abs=4e-3 * share / 20.0 + 5.0)
    assert relation.rms_ns < 3.0 * share + 1e4


def test_the_first_message_is_a_relation_already():
    relation = ClockRelation()
    assert not relation.known
    relation.update(5_000_000, 8_000_000)
    assert relation.known
    assert (relation.b_of(6_000_000), relation.a_of(9_000_000)) == (9_000_000, 6_000_000)


@pytest.mark.parametrize("step_ms", [-3600e3, -40.0, -10.0, 10.0, 40.0, 3600e3])
def test_a_step_of_a_clock_is_followed(step_ms):
    relation, rng = ClockRelation(), np.random.default_rng(3)
    told(relation, rng, start_s=0, end_s=20, hz=240, offset_ns=0, jitter_ms=5.0)
    told(relation, rng, start_s=20, end_s=24, hz=240, offset_ns=round(step_ms * 1e6), jitter_ms=5.0)
    truth_ns = 24_000_000_000 + round(step_ms * 1e6) + LEAST_NS
    assert relation.resets == 1
    assert abs(relation.b_of(24_000_000_000) - truth_ns) < 2e6


def test_messages_that_were_held_up_change_nothing():
    relation, rng = ClockRelation(), np.random.default_rng(4)
    told(relation, rng, start_s=0, end_s=10, hz=240, offset_ns=0, jitter_ms=2.0)
    before = relation.b_of(10_000_000_000)
    for k in range(200):  # of 0.8 s, all at once
        relation.update(10_000_000_000 + 4_000_000 * k, 10_800_000_000 + LEAST_NS)
    told(relation, rng, start_s=10.8, end_s=12, hz=240, offset_ns=0, jitter_ms=2.0)
    assert relation.resets == 0
    assert abs(relation.b_of(10_000_000_000) - before) < 1e5


@pytest.mark.parametrize("step_ms", [-3600e3, -40.0, -10.0, 0.0, 10.0, 40.0, 1000.0, 3600e3])
def test_a_time_that_is_off_is_hardly_ever_sure(step_ms):
    relation, rng = ClockRelation(), np.random.default_rng(3)
    sure = off = 0
    for k in range(10 * 240):
        a_ns = round(k * 1e9 / 240)
        delay_ns = LEAST_NS + round(20e6 * rng.random())
        carried_ns = a_ns + (round(1e6 * step_ms) if k >= 5 * 240 else 0)
        relation.update(carried_ns, a_ns + delay_ns)
        if relation.sure:
            sure += 1
            off += abs(relation.b_of(carried_ns) - a_ns - LEAST_NS) > 5e6
    # a step back looks like a delay until all of the last messages came late
    assert off <= (20 if step_ms < 0.0 else 8)
    assert sure > 8.5 * 240
