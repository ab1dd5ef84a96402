"""The pictures of a running job's cameras: the newest one with its age, no more on their way than a slow page can take,
and no command that was made on an old one."""

import io
import time
from contextlib import closing

import numpy as np
import pytest
from PIL import Image
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import connect

from console.routes.cameras import HEAD, WINDOW
from console.teleoperation.gate import Drop, Gate
from rtstack.access.tokens import Scope
from rtstack.log.video import Encoder
from rtstack.log.writing.pictures import SLOTS, PictureRing
from rtstack.model.camera_description import CameraDescription
from rtstack.samples import ARM_SAMPLE
from rtstack.teleoperation.stamp import Stamp
from tests.support.console.client import arm, wait_for

MS = 1_000_000
FRONT = CameraDescription("simulated", (1.4, 0.0, 0.5), (0.5, -0.5, -0.5, 0.5))


@pytest.fixture
def ring(served):
    """A console whose robot process carries out a job with a camera: where that writes."""
    served.parts.cell.cameras["front"] = FRONT
    with closing(PictureRing.create()) as ring, served.signed_in() as (client, headers):
        arm(client, headers)
        order = {"object": "rice_box"}
        assert client.post("/api/jobs/teleoperation", json=order, headers=headers).status_code == 202
        served.job_manager.started("x.mcap", {"front": ring.name})
        wait_for(lambda: (status := served.parts.watch.view.status) is not None and status.job and status.job.cameras)
        yield ring


def look(served, camera="front", scope=Scope.VIEW):
    _, word = served.parts.sign_in.tokens.create(f"{camera} {scope}", scope)
    address = f"ws://127.0.0.1:{served.port}/api/cameras/{camera}"
    return connect(address, additional_headers={"authorization": f"Bearer {word}"}, proxy=None, max_size=None)


def robot_at(served, t_ns):
    sample = np.zeros(1, ARM_SAMPLE)
    sample["t_ns"] = t_ns
    served.rings.pusher("/left/arm").push(sample)


def test_who_may_look_sees_the_newest_picture_and_how_old_it_is(served, ring):
    robot_at(served, 5_000 * MS)
    for k in range(SLOTS):
        ring.write((4_000 + k) * MS, b"old")
    ring.drain()
    ring.write(4_930 * MS, b"newest")
    with look(served) as stream:
        before_ns = time.monotonic_ns()
        message = stream.recv(timeout=60)
    assert isinstance(message, bytes)
    us, age_ms = HEAD.unpack_from(message)
    assert message[HEAD.size :] == b"newest"
    assert age_ms == pytest.approx(70.0)
    assert before_ns / 1000 - 1e6 < us + 70_000 < time.monotonic_ns() / 1000


def test_a_page_that_shows_nothing_is_sent_no_more_and_then_what_is_newest(served, ring):
    robot_at(served, 0)
    with look(served) as stream:
        for k in range(WINDOW):
            ring.write(k, b"%d" % k)
            assert stream.recv(timeout=60)[HEAD.size :] == b"%d" % k
        for k in range(10, 20):
            ring.write(k, b"%d" % k)
        with pytest.raises(TimeoutError):
            stream.recv(timeout=0.2)
        stream.send("shown")
        assert stream.recv(timeout=60)[HEAD.size :] == b"19"


def test_the_next_jobs_pictures_come_by_the_same_stream(served, ring):
    robot_at(served, 0)
    ring.write(1, b"one")
    with look(served) as stream:
        assert stream.recv(timeout=60)[HEAD.size :] == b"one"
        with closing(PictureRing.create()) as another:
            another.write(2, b"two")
            served.job_manager.started("y.mcap", {"front": another.name})
            assert stream.recv(timeout=60)[HEAD.size :] == b"two"


def test_a_camera_that_the_cell_has_not_is_refused(served, ring):
    with look(served, "back") as stream, pytest.raises(ConnectionClosed, match="no such camera"):
        stream.recv(timeout=60)


def test_a_command_made_on_an_old_picture_of_a_camera_moves_nothing():
    """The live view is new; what the camera shows is 240 ms old, then 260 ms, and then was never shown."""
    gate = Gate()
    for k, (camera_ms, drop) in enumerate([(240, None), (260, Drop.PICTURE), (1_000, Drop.PICTURE)], start=1):
        now_ms = 1_000 + 20 * k
        stamp = Stamp("a", k, now_ms - 1.0, k, now_ms - 2.0, camera_us=1_000 * (now_ms - camera_ms))
        admission = gate.admit("anna", stamp, round((now_ms - 3.0) * MS), now_ms * MS)
        assert admission.drop is drop
        assert admission.alive
        assert admission.picture_ns == (now_ms - camera_ms) * MS


def test_h264_is_shown_as_jpeg(served, ring):
    robot_at(served, 5_000 * MS)
    ring.drain()
    ring.write(4_930 * MS, Encoder(128, 64, 30.0).encode(4_930 * MS, np.full((64, 128, 3), 90, np.uint8)))
    with look(served) as stream:
        message = stream.recv(timeout=60)
    assert isinstance(message, bytes)
    assert Image.open(io.BytesIO(message[HEAD.size :])).size == (128, 64)
