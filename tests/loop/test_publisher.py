"""Which of the object's poses a run that counts from its first state publishes, and with which stamps."""

import numpy as np
import pytest

from hal.tracker import ObjectPose
from rtstack.log.ring import Rings
from rtstack.loop.publisher import Publisher
from rtstack.samples import ARM_SAMPLE, CONTROL_SAMPLE

MS = 1_000_000
ORIGIN_NS = 5_000 * MS


class Tracker:
    """Shows one pose after the other: stamp, and height of the object, m."""

    def __init__(self) -> None:
        self.pose = ObjectPose.empty()

    def latest(self) -> ObjectPose:
        return self.pose

    def see(self, t_ns: int, height_m: float) -> None:
        self.pose.record["t_ns"], self.pose.record["position"][0, 2], self.pose.record["seen"] = t_ns, height_m, 1

    def close(self) -> None:
        pass


@pytest.mark.parametrize("first_ns", [ORIGIN_NS - 7 * MS, ORIGIN_NS, ORIGIN_NS + 3 * MS])
def test_the_newest_pose_before_the_first_answer_is_the_one_at_zero(first_ns: int) -> None:
    """The robot shows its first state, and poses, until it is answered: which of them is read is the host's doing."""
    tracker = Tracker()
    left, right = ((np.zeros(1, ARM_SAMPLE), np.zeros(1, CONTROL_SAMPLE)) for _ in range(2))
    with Rings.create() as rings:
        publisher = Publisher([rings], None)
        reader = rings.reader("/object/pose")
        tracker.see(first_ns, 0.1)
        publisher.look(tracker, ORIGIN_NS, 0)
        publisher.tick(left, right)
        # the second state says when the first one was answered: it was shown for 4 ms
        for now_ms, seen_ms, height_m in ((1, 2, 0.1), (2, 4, 0.1), (3, 7, 0.2), (4, 7, 0.2), (8, 12, 0.3)):
            tracker.see(ORIGIN_NS + seen_ms * MS, height_m)
            publisher.look(tracker, ORIGIN_NS + 4 * MS, now_ms * MS)
            publisher.tick(left, right)
        poses = reader.drain()
    assert poses["t_ns"].tolist() == [0, 3 * MS, 8 * MS]
    assert poses["position"][:, 2].tolist() == [0.1, 0.2, 0.3]


def test_who_sees_the_arms_of_a_tick_sees_the_objects_pose_of_it(monkeypatch: pytest.MonkeyPatch) -> None:
    """A camera drew the object where it had not been seen yet, when the loop was pushed off its CPU between the two."""
    tracker, there = Tracker(), []
    left, right = ((np.zeros(1, ARM_SAMPLE), np.zeros(1, CONTROL_SAMPLE)) for _ in range(2))
    with Rings.create() as rings:
        publisher = Publisher([rings], None)
        reader = rings.reader("/object/pose")
        monkeypatch.setattr("rtstack.loop.publisher.push_all", lambda rows: there.append(len(reader.drain())))
        tracker.see(ORIGIN_NS, 0.1)
        publisher.look(tracker, ORIGIN_NS, 0)
        publisher.tick(left, right)
    assert there == [1]
