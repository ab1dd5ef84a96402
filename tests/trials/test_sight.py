"""A tracker that cannot be read, stands still, or means another frame is refused before anything moves."""

import socket
import time
from contextlib import closing
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

import rtstack.trials.sight as sight
from hal.cell import Cell
from hal.clock_relation import ClockRelation
from hal.tracker import ObjectPose, TrackerFrames, TrackerTimes
from hal.tracker_link import DATAGRAM, TrackerLink
from rtstack.cells import load_description
from rtstack.model.tracker_description import TrackerDescription
from rtstack.trials.errors import TrialError
from rtstack.trials.sight import check_place, check_sight

DESCRIPTION = load_description(None)[0]
EXTERNAL = replace(DESCRIPTION, tracker=replace(DESCRIPTION.tracker, clock="arrival"))
NAME = "rice_box"
PLACE = np.array([0.0, 0.0, DESCRIPTION.table.top_z + DESCRIPTION.objects[NAME].size[2] / 2.0])


class Link:
    """The link of arms whose states come at once, and a sender of a datagram with each of them."""

    def __init__(self, send=lambda k: None) -> None:
        self._send, self._k = send, 0

    def wait(self) -> int:
        self._k += 1
        self._send(self._k)
        time.sleep(1e-3)
        return 3


def cell_with(tracker, send=lambda k: None) -> Cell:
    arm = SimpleNamespace(read=lambda: None)
    return Cell("fci:a,b", arm, arm, tracker, Link(send), own_clocks=True)


def datagram(k: int, **more) -> bytes:
    record = np.zeros(1, DATAGRAM)
    record["t_ns"], record["seen"] = k * 1_000_000, 1
    record["position"], record["orientation_wxyz"] = PLACE + 1e-6 * k, (1.0, 0.0, 0.0, 0.0)
    for name, value in more.items():
        record[name] = value
    return record.tobytes()


SENT = {
    "none": (lambda k: b"", "shows no fresh pose of rice_box: start it"),
    "another size": (lambda k: b"x" * 56, "sends datagrams of 56 bytes, expected 72"),
    "a longer one": (lambda k: b"x" * 200, "sends datagrams of more bytes, expected 72"),
    "mm": (lambda k: datagram(k, position=1e3 * PLACE), r"sends a place at 0, 0, \d+ m, further than 100 m.*not mm"),
    "nan": (lambda k: datagram(k, position=np.nan), "sends a place at nan"),
    "no unit quaternion": (lambda k: datagram(k, orientation_wxyz=0.3), "sends a quaternion wxyz of length 0.6"),
    "zeros": (lambda k: datagram(k, orientation_wxyz=0.0), "sends a quaternion wxyz of length 0, expected 1"),
    "frozen poses": (lambda k: datagram(k, position=PLACE), r"shows the same pose to the last bit in \d+ frames"),
    "frozen times": (lambda k: datagram(5, position=PLACE + 1e-6 * k), "has shown no new pose of rice_box for 1 s"),
    "frozen frames": (lambda k: datagram(5), "has shown no new pose of rice_box for 1 s"),
    "one frame": (lambda k: datagram(5) if k == 1 else b"", "has shown no new pose of rice_box for 1 s"),
}


@pytest.mark.parametrize("what", SENT)
def test_a_stream_that_shows_nothing_new_is_refused_with_what_was_found(what: str) -> None:
    made, complaint = SENT[what]
    with closing(TrackerLink()) as link, socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as out:
        send = lambda k: (data := made(k)) and out.sendto(data, link.address)  # noqa: E731
        with pytest.raises(TrialError, match=rf"^the tracker udp at 127\.0\.0\.1:1341 {complaint}") as caught:
            check_sight(cell_with(link, send), EXTERNAL, NAME)
        assert "\n" not in str(caught.value)
        if what == "none":
            check_sight(cell_with(link, send), DESCRIPTION, "")  # about no object
        check_sight(replace(cell_with(link, send), own_clocks=False), DESCRIPTION, NAME)
        if what == "frozen poses":
            check_sight(cell_with(link, send), DESCRIPTION, NAME)  # the simulated robot's, which stands still
        none = replace(DESCRIPTION, tracker=TrackerDescription(kind="none"))
        check_sight(cell_with(link, send), none, NAME)


@pytest.mark.parametrize("clock", ["own", "host"])
def test_times_that_stand_still_are_named(clock) -> None:
    known = ClockRelation()
    known.update(0, time.monotonic_ns())
    link = TrackerLink(times=TrackerTimes(clock), robot_clock=known)
    with closing(link), socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as out:
        send = lambda k: out.sendto(datagram(5, position=PLACE + 1e-6 * k), link.address)  # noqa: E731
        with pytest.raises(TrialError, match=r"whose time does not go on|which is not now by its clock"):
            check_sight(cell_with(link, send), DESCRIPTION, NAME)


def test_a_stream_with_noise_is_seen_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sight, "LONGEST_LOOK_S", 60.0)
    with closing(TrackerLink()) as link, socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as out:
        began = time.monotonic()
        check_sight(cell_with(link, lambda k: out.sendto(datagram(k), link.address)), DESCRIPTION, NAME)
        assert time.monotonic() - began < 60.0


def test_what_a_tracker_of_another_package_finds_is_passed_on() -> None:
    class Blind:
        def latest(self):
            return ObjectPose.empty()

        def trouble(self, about):
            return "has no power" if about else ""

    description = replace(DESCRIPTION, tracker=TrackerDescription(kind="vicon"))
    with pytest.raises(TrialError, match=r"^the tracker vicon at 127\.0\.0\.1:1341 has no power; without a tracker"):
        check_sight(cell_with(Blind()), description, NAME)


HALF = np.sqrt(0.5)
MISTAKES = [
    (PLACE + (0.0, 0.03, 0.0), (1.0, 0.0, 0.0, 0.0), {}, None),
    (PLACE + (0.0, 0.1, 0.0), (1.0, 0.0, 0.0, 0.0), {}, r"y \+100, z \+0 mm from it: put it back"),
    (PLACE, (HALF, HALF, 0.0, 0.0), {}, "turned by 90 degrees from upright"),
    (PLACE, (0.0, 1.0, 0.0, 0.0), {}, "turned by 180 degrees from upright"),
    ((0.0, PLACE[2], 0.0), (HALF, -HALF, 0.0, 0.0), {}, 'as if it streams y up: write up = "y"'),
    ((0.0, -PLACE[2], 0.0), (HALF, HALF, 0.0, 0.0), {"up": "y"}, 'as if it streams z up: write up = "z"'),
    (1e3 * PLACE, (1.0, 0.0, 0.0, 0.0), {}, "as if it sends mm"),
    (PLACE * (1, 1, -1), (1.0, 0.0, 0.0, 0.0), {}, "as if its z is mirrored: its frame is left-handed"),
    (PLACE + (1.2, 0.0, 0.0), (1.0, 0.0, 0.0, 0.0), {"position": (0.6, 0.0, 0.0)}, "as if its x is mirrored"),
    (PLACE + (0.0, -0.8, 0.0), (1.0, 0.0, 0.0, 0.0), {"position": (0.0, -0.4, 0.0)}, "as if its y is mirrored"),
    (PLACE + (0.6, 0.6, 0.0), (1.0, 0.0, 0.0, 0.0), {"position": (0.6, 0.0, 0.0)}, r"x \+600, y \+600"),
]


@pytest.mark.parametrize(("position", "wxyz", "frames", "complaint"), MISTAKES)
def test_an_object_in_another_place_is_refused_with_the_setting_that_would_explain_it(
    position, wxyz, frames, complaint
) -> None:
    pose = ObjectPose.empty()
    pose.position[:], pose.orientation_wxyz[:] = position, wxyz
    description = replace(DESCRIPTION, tracker=TrackerDescription(**frames))
    if complaint is None:
        check_place(description, pose, PLACE)
        return
    with pytest.raises(TrialError, match=complaint):
        check_place(description, pose, PLACE)


def test_the_frames_of_a_stream_are_those_that_the_mistakes_take_back() -> None:
    made = TrackerFrames(up="y")
    with closing(TrackerLink(frames=made)) as link, socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as out:
        out.sendto(datagram(1, position=PLACE), link.address)
        time.sleep(0.05)
        turned = link.latest().position.copy()
    np.testing.assert_allclose(turned, sight._Y_UP @ PLACE, atol=1e-12)
