"""Object poses over UDP."""

import socket
import time

import numpy as np

from hal.clock_relation import ClockRelation
from hal.tracker import OBJECT_POSE, ObjectPose, TrackerTimes
from hal.tracker_link import DATAGRAM, TrackerLink
from sim_robot.fci.tracker_feed import TrackerFeed


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
