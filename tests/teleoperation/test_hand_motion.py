"""Which motions a hand can make, and which only a tracker makes that lost it: by the samples' own times, exact."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from rtstack.teleoperation.hand_motion import ACCELERATION_M_S2, LOST_S, PAUSE_S, SPEED_M_S, TURN_RAD_S, HandMotion
from rtstack.teleoperation.stamp import Stamp

REST = np.array([0.1, 0.35, 0.5, 1.0, 0.0, 0.0, 0.0])
PERIODS_MS = st.floats(3.0, 60.0)  # a fast tracker; a page that is late
DIRECTIONS = st.tuples(*[st.floats(-1.0, 1.0)] * 3).filter(lambda way: np.linalg.norm(way) > 0.1)


class Hand:
    """A hand whose samples come from one sender, each with its time, ms. Each is in the place of the gate's command."""

    def __init__(self):
        self.motion, self.at_ms, self.sequence = HandMotion(("left",)), 0.0, 0

    def after(self, ms, pose, came_ms=None, kind="hand", **options):
        self.at_ms += ms
        self.sequence += 1
        came_ns = round(1e6 * (self.at_ms if came_ms is None else came_ms))
        self.motion.advance(Stamp("a", self.sequence, self.at_ms, 1, self.at_ms), came_ns)
        return self.motion.problem(kind, [pose], **options)

    def refused(self, *arguments, **options):
        return self.after(*arguments, **options) or ""

    def rest(self, samples=6, ms=20.0):
        assert [self.after(ms, REST) for _ in range(samples)] == [None] * samples


def away(metres, degrees=0.0, way=(0.0, 0.0, 1.0), axis=(1.0, 0.0, 0.0)):
    turn = Rotation.from_rotvec(np.radians(degrees) * np.array(axis) / np.linalg.norm(axis))
    return np.array([*REST[:3] + metres * np.array(way) / np.linalg.norm(way), *turn.as_quat(scalar_first=True)])


@settings(max_examples=60)
@given(
    pushes=st.lists(st.tuples(DIRECTIONS, st.floats(0.0, 1.0), PERIODS_MS), min_size=3, max_size=40),
    spin=st.floats(-1.0, 1.0),
    sign=st.sampled_from((1.0, -1.0)),
)
def test_what_a_hand_can_do_is_followed_at_any_rate(pushes, spin, sign):
    """Each push is as hard as it may be; what is sampled is where it leads. sign: of every other quaternion."""
    hand, place, speed, turned = Hand(), np.zeros(3), np.zeros(3), 0.0
    for way, share, period_ms in pushes:
        step_s = 1e-3 * period_ms
        wanted = speed + share * ACCELERATION_M_S2 * step_s * np.array(way) / np.linalg.norm(way)
        wanted *= min(1.0, SPEED_M_S / max(1e-9, np.linalg.norm(wanted)))
        place = place + step_s * (speed + wanted) / 2.0
        speed = wanted
        turned += spin * TURN_RAD_S * step_s
        pose = away(0.0, np.degrees(turned))
        pose[:3] += place
        pose[3:] *= sign if hand.sequence % 2 else 1.0
        assert hand.after(period_ms, pose) is None


@settings(max_examples=60)
@given(
    metres=st.floats(0.06, 3.0), way=DIRECTIONS, period_ms=st.floats(5.0, 22.0),
    moving=st.floats(-0.7, 0.7), antipodal=st.booleans(),
)  # fmt: skip
def test_a_jump_is_found_in_its_first_sample_and_so_is_the_way_back(metres, way, period_ms, moving, antipodal):
    hand = Hand()
    for k in range(8):
        assert hand.after(period_ms, away(1e-3 * k * period_ms * moving)) is None
    jumped = away(1e-3 * 7 * period_ms * moving)
    jumped[:3] += metres * np.array(way) / np.linalg.norm(way)
    jumped[3:] *= -1.0 if antipodal else 1.0
    assert "left hand" in hand.refused(period_ms, jumped)
    assert "left hand" in hand.refused(period_ms, away(1e-3 * 8 * period_ms * moving))


@pytest.mark.parametrize("degrees", [40.0, 90.0, 180.0])
@pytest.mark.parametrize("period_ms", [11.0, 20.0, 50.0])
def test_a_turn_of_a_tracker_is_a_jump_and_the_other_sign_of_a_quaternion_none(degrees, period_ms):
    hand = Hand()
    hand.rest(ms=period_ms)
    assert hand.after(period_ms, REST * np.repeat((1, -1), (3, 4))) is None
    assert "turned by" in hand.refused(period_ms, away(0.0, degrees))


def test_five_small_steps_are_a_jump_too():
    hand = Hand()
    hand.rest()
    assert "set off" in hand.refused(20.0, away(0.03))
    fast = Hand()
    fast.rest()
    answers = [fast.after(8.0, away(0.004 * k**1.7)) for k in range(1, 10)]
    assert answers[0] is None
    assert any(answers)


@pytest.mark.parametrize("bad", [np.full(7, np.nan), np.full(7, np.inf), REST * 0.9, np.zeros(7), away(np.nan)])
def test_what_is_no_pose_is_not_followed(bad):
    hand = Hand()
    hand.rest()
    assert "has no pose" in hand.refused(20.0, bad)


def test_a_time_that_stands_still_is_the_time_of_arrival_and_no_time_makes_a_jump_a_motion():
    hand = Hand()
    hand.rest()
    assert hand.after(0.0, away(0.01), came_ms=hand.at_ms + 20.0) is None
    assert "moved by" in hand.refused(0.0, away(0.08), came_ms=hand.at_ms + 40.0)
    boasting = Hand()
    boasting.rest()
    assert "moved by" in boasting.refused(110.0, away(0.3), came_ms=boasting.at_ms + 5.0)  # it came 5 ms later


def test_a_burst_after_a_pause_is_measured_by_its_senders_times_and_a_long_pause_loses_the_hand():
    hand = Hand()
    hand.rest()
    came_ms = hand.at_ms + 200.0
    assert [hand.after(20.0, away(0.01 * k), came_ms=came_ms) for k in range(1, 9)] == [None] * 8
    assert not hand.motion.paused
    assert hand.after(1e3 * PAUSE_S + 1.0, away(0.3)) is None
    assert hand.motion.paused  # it leads from there
    assert hand.after(20.0, away(0.301)) is None
    assert not hand.motion.paused
    assert "not seen" in hand.refused(1e3 * LOST_S + 1.0, away(0.3))
    assert hand.after(500.0, away(0.3), kind="pose") is None
    assert hand.after(500.0, away(0.4), kind="pose", lost_s=np.inf) is None  # a program's goals
    assert "moved by" in hand.refused(20.0, away(0.5), kind="pose", lost_s=np.inf)


def test_a_hand_that_leads_nothing_may_be_anywhere_later():
    hand = Hand()
    hand.rest()
    assert hand.after(20.0, None) is None
    assert hand.after(20.0, away(0.5)) is None
