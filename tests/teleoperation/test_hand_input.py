"""What a device says is what the console takes: each field of HandInput in the message that it becomes."""

import pytest
from pydantic import TypeAdapter, ValidationError

from console.routes.teleoperation import PadPoses, TeleopMessage
from rtstack.teleoperation.device import HandInput

POSE, FILTERED = (0.4, 0.1, 0.3, 1.0, 0.0, 0.0, 0.0), (0.4, 0.1, 0.2, 1.0, 0.0, 0.0, 0.0)
KEYS = (0.0, 0.0, 1.0, 0.0, 0.0, 0.0)
MESSAGES = TypeAdapter(TeleopMessage)


def taken(**fields):
    return MESSAGES.validate_python(HandInput(**fields).message())


def test_what_is_sensed_and_a_hand_that_is_not_seen_reach_the_console():
    message = taken(held=True, left=FILTERED, leading=True, sensed=(POSE, None), tracked=False)
    assert message.hands == PadPoses(left=list(FILTERED))
    assert message.sensed == PadPoses(left=list(POSE))
    assert message.tracked is False
    assert taken(held=True, right=KEYS, sensed=(None, POSE)).sensed == PadPoses(right=list(POSE))


def test_a_clutch_that_is_open_says_nothing_of_the_hands():
    assert taken(held=False, left=POSE, sensed=(POSE, POSE), tracked=False) == TeleopMessage(clutch=False)
    plain = taken(held=True, left=POSE, right=KEYS)
    assert (plain.tracked, plain.sensed, plain.pose, plain.hands) == (True, None, PadPoses(left=list(POSE)), None)


def test_a_pose_without_numbers_is_refused_by_the_field_that_lost_the_hand():
    with pytest.raises(ValidationError) as refused:
        taken(held=True, left=FILTERED, leading=True, sensed=((float("nan"),) * 7, None))
    assert refused.value.errors()[0]["loc"][:1] == ("sensed",)
