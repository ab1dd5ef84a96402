"""Two simulated cameras beside a real run: their pictures are in its log, in its clock, and never in its way."""

import io
import os
import re
import signal
import time
from contextlib import closing
from dataclasses import replace
from pathlib import Path

import av
import numpy as np
import pytest
from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory
from PIL import Image

from rtstack.cameras.film import Device, Film
from rtstack.cameras.newest import NewestPictures
from rtstack.cameras.source import CameraRequest, draw_time
from rtstack.cells import default_cell_file, open_cell
from rtstack.log.errors import LogError
from rtstack.log.reader import read_log
from rtstack.log.ring import Rings
from rtstack.log.video import Encoder
from rtstack.log.writing import pictures
from rtstack.log.writing.mcap_writer import McapWriter
from rtstack.loop.end import End
from rtstack.model.camera_description import CameraDescription
from rtstack.samples import ARM_SAMPLE
from rtstack.teleoperation.policy import Chunk
from rtstack.trials.record import open_log
from rtstack.trials.run_context import RunContext
from rtstack.trials.specification import TeleoperationSpecification, TrialSpecification
from rtstack.trials.teleoperation import run_policy
from rtstack.trials.trial import prepare_trial, run_trial
from tests.support.drawn_time import read_time

# above the table, looking down; and from the front
DOWN = CameraDescription("simulated", (0.1, 0.0, 1.6), (0.0, 0.7071, 0.7071, 0.0), width=384, height=288, stamped=True)
FRONT = replace(DOWN, position=(1.4, 0.0, 0.5), orientation_wxyz=(0.5, -0.5, -0.5, 0.5))

MS = 1_000_000


def run(cell, demonstration, path, cameras, disturb=None):
    """Run a trial of the demonstration; return its result and its log."""
    described = replace(cell, cameras=cameras)
    asked = TrialSpecification(str(demonstration.path))
    opened = open_cell("direct", "rice_box", 0.0, 0)
    log = open_log(path, asked, described, "direct", default_cell_file(), overwrite=True, cell=opened)
    progress = None if disturb is None else disturb(log)
    try:
        result = run_trial(prepare_trial(asked, described), opened, RunContext(log, progress=progress))
    finally:
        opened.close()
    return result, read_log(path)


@pytest.fixture
def film(tmp_path):
    """A film of 1.2 s at 25 pictures a second, MP4, whose times are drawn into its pictures."""
    path = tmp_path / "film.mp4"
    with av.open(str(path), "w") as file:
        stream = file.add_stream("libx264", rate=25)
        stream.width, stream.height, stream.pix_fmt = 384, 64, "yuv420p"
        for k in range(30):
            picture = np.full((64, 384, 3), 90, np.uint8)
            draw_time(picture, 40_000_000 * k)
            file.mux(stream.encode(av.VideoFrame.from_ndarray(picture)))
        file.mux(stream.encode())
    return path


def shown(path: Path):
    """Return the pictures of each camera, (t_ns, picture), as a reader of other authors finds them, and K."""
    found, matrices = {}, {}
    with open(path, "rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        for _, channel, message, said in reader.iter_decoded_messages():
            if channel.topic.endswith("/image"):
                picture = np.array(Image.open(io.BytesIO(said.data)))
                found.setdefault(channel.topic, []).append((message.log_time, picture))
            elif channel.topic.endswith("/calibration"):
                matrices[channel.topic] = list(said.K)
    return found, matrices


@pytest.mark.parametrize("t_ns", [0, 1_300_000, 599_999_900_000, (2**47 - 1) * 100_000])
def test_a_time_that_is_drawn_is_read_through_jpeg(t_ns):
    picture = np.random.default_rng(0).integers(0, 255, (64, 400, 3), np.uint8)
    draw_time(picture, t_ns)
    file = io.BytesIO()
    Image.fromarray(picture).save(file, "JPEG", quality=85)
    assert read_time(np.array(Image.open(file))) == t_ns


@pytest.mark.long
def test_two_cameras_are_in_the_log_in_its_clock_and_the_trial_is_the_same(cell, demonstration, tmp_path):
    plain, without = run(cell, demonstration, tmp_path / "plain.mcap", {})
    result, log = run(cell, demonstration, tmp_path / "seen.mcap", {"down": DOWN, "front": FRONT})
    assert (result.success, result.ticks, result.average_force_norm) == (
        plain.success, plain.ticks, plain.average_force_norm
    )  # fmt: skip
    for topic in ("/left/arm", "/right/control", "/object/pose"):
        np.testing.assert_array_equal(log.topic(topic), without.topic(topic))
    found, matrices = shown(tmp_path / "seen.mcap")
    assert set(found) == {"/camera/down/image", "/camera/front/image"}
    ticks = log.topic("/left/arm")["t_ns"]
    for topic, seen in found.items():
        assert len(seen) >= 0.9 * 30.0 * log.duration_s, topic
        for t_ns, picture in seen:
            assert picture.shape == (288, 384, 3)
            assert abs(read_time(picture) - t_ns) < 1_000_000
            assert t_ns in ticks
        assert np.ptp(seen[0][1].astype(float)) > 100.0  # something is to be seen
        moved = np.abs(seen[0][1][16:].astype(float) - seen[len(seen) // 2][1][16:]).mean()
        assert moved > 1.0, topic
    K = matrices["/camera/down/calibration"]
    assert pytest.approx(list(DOWN.K)) == K
    place = log.messages("/camera/front/tf")
    assert len(place) == 1


@pytest.mark.long
def test_a_camera_that_dies_ends_its_pictures_and_not_the_trial_and_is_said(cell, demonstration, tmp_path):
    def kill(log):
        def progress(share):
            if share > 0.4:
                os.kill(log.cameras._processes[0].pid, signal.SIGKILL)

        return progress

    result, log = run(cell, demonstration, tmp_path / "log.mcap", {"down": DOWN, "front": FRONT}, kill)
    assert result.success
    assert len(log.messages("/camera/front/image")) > len(log.messages("/camera/down/image"))
    said = [event.text for event in log.events if event.name == "camera"]
    assert len(said) == 1
    assert said[0].startswith("camera down: no picture: ")


@pytest.mark.long
def test_a_camera_that_cannot_be_opened_is_said_and_the_trial_goes_on(cell, demonstration, tmp_path):
    missing = replace(DOWN, kind="moon")
    result, log = run(cell, demonstration, tmp_path / "log.mcap", {"down": missing})
    assert result.success
    said = [event.text for event in log.events if event.name == "camera"]
    assert any("unknown camera 'moon'" in text for text in said), said


RAISING = """
class Blind:
    def __init__(self, request):
        if request.camera.address == "at once":
            raise KeyError("lens")
        self._arm = request.rings.reader("/left/arm")

    def read(self):
        if len(self._arm.drain()):
            raise ValueError("no\\nlight")

    def close(self):
        pass
"""


def test_a_camera_whose_program_raises_ends_the_run_with_its_place(cell, demonstration, tmp_path, install, monkeypatch):
    install("blind_camera", RAISING, "rtstack.cameras", blind="Blind")
    monkeypatch.setenv("PYTHONPATH", str(tmp_path / "installed" / "blind_camera"))

    def wait(log):
        def progress(share):
            end_s = time.monotonic() + 60.0
            while share > 0.2 and not log.cameras.raised and time.monotonic() < end_s:
                time.sleep(0.01)

        return progress

    blind = replace(DOWN, kind="blind")
    mend = "mend it there, or uninstall the package"
    refused = re.escape(f"camera down: KeyError: 'lens' (blind_camera 1.2, blind_camera.py:5); {mend}")
    with pytest.raises(LogError, match=f"^{refused}$"):
        run(cell, demonstration, tmp_path / "once.mcap", {"down": replace(blind, address="at once")})
    result, log = run(cell, demonstration, tmp_path / "log.mcap", {"down": blind}, wait)
    no_light = f"camera down: ValueError: no light (blind_camera 1.2, blind_camera.py:10); {mend}"
    said = f"{End.CONTROLLER_EXCEPTION}: {no_light}"
    assert result.failure_reason == said
    assert log.metadata["fault"]["end"] == str(End.CONTROLLER_EXCEPTION)


def test_a_full_disk_ends_the_pictures_and_is_said(tmp_path, monkeypatch):
    monkeypatch.setattr(pictures, "RESERVE_BYTES", 1 << 60)
    ring = pictures.PictureRing.create()
    camera = pictures.LoggedCamera("down", ring.name, 64, 64, DOWN.K, (), DOWN.pose)
    with open(tmp_path / "log", "wb") as file:
        drain = pictures.PictureDrain([camera], file)
        ring.write(5, b"picture")
        assert drain.step(5) == {}
        assert [bytes(event["text"]) for event in drain.events(7)] == [
            b"no more pictures: the disk has less than 1099511627776 MB"
        ]
        drain.close()
    ring.close()


def test_a_camera_that_is_quiet_while_samples_go_on_is_said_once_and_so_is_its_return(tmp_path, monkeypatch):
    monkeypatch.setattr(pictures, "STALL_S", 0.0)
    ring = pictures.PictureRing.create()
    camera = pictures.LoggedCamera("down", ring.name, 64, 64, DOWN.K, (), DOWN.pose)
    said = []
    with open(tmp_path / "log", "wb") as file:
        drain = pictures.PictureDrain([camera], file)
        for t_ms, newest_ms in ((10, 10), (None, 10), (None, 20), (None, 30), (30, 30), (None, 40)):
            if t_ms is not None:
                ring.write(t_ms * 1_000_000, b"picture")
            drain.step(newest_ms * 1_000_000)
            said.append([event["text"].decode() for event in drain.events(0)])
        drain.close()
    ring.close()
    quiet = ["camera down: no picture: it gives none any more"]
    assert said == [[], [], quiet, [], ["camera down: pictures again"], quiet]


def test_a_ring_keeps_the_newest_pictures_and_counts_those_that_are_lost(monkeypatch):
    monkeypatch.setattr(pictures, "PATIENCE_S", 0.0)
    ring = pictures.PictureRing.create()
    reader = pictures.PictureRing.attach(ring.name)
    for k in range(pictures.SLOTS + 3):
        ring.write(k, bytes([k]))
    assert [t_ns for t_ns, _ in reader.drain()] == list(range(3, pictures.SLOTS + 3))
    assert (reader.lost, reader.drain()) == (3, [])
    ring.write(99, b"x" * (pictures.LARGEST_BYTES + 1))
    assert reader.drain() == []
    reader.close()
    ring.close()


@pytest.mark.long
def test_a_policy_is_shown_the_newest_picture_at_each_observation(cell, film, tmp_path):
    """Of a camera that is simulated, as JPEG, and of a film, as H.264."""
    seen = []
    of_film = replace(DOWN, kind="film", address=str(film), height=64, rate_hz=10.0, stamped=False, format="h264")

    class Looks:
        def act(self, observation):
            picture = observation.pictures["down"]
            assert picture.rgb.shape == (288, 384, 3)
            times = [(each.t_ns, read_time(each.rgb)) for each in (picture, observation.pictures["film"])]
            seen.append((observation.t_ns // MS, *(t_ns // MS for pair in times for t_ns in pair)))
            return Chunk(0.05, np.repeat(observation.pose_ref[None], 3, axis=0))

        def close(self):
            pass

    described, asked = replace(cell, cameras={"down": DOWN, "film": of_film}), TeleoperationSpecification("looks")
    opened = open_cell("direct", "rice_box", 0.0, 0)
    log = open_log(tmp_path / "log.mcap", asked, described, "direct", default_cell_file(), cell=opened)
    try:
        result = run_policy(Looks(), asked, described, opened, RunContext(log), longest_s=0.16)
    finally:
        opened.close()
    assert result.success, result.failure_reason
    assert seen == [(0, 0, 0, 0, 0), (50, 34, 34, 0, 0), (100, 100, 100, 100, 80), (150, 134, 134, 100, 80)]
    logged = read_log(tmp_path / "log.mcap").pictures("/camera/film/image")
    assert [(t_ns // MS, read_time(np.array(Image.open(io.BytesIO(jpeg)))) // MS) for t_ns, jpeg in logged[:2]] == [
        (0, 0), (100, 80)
    ]  # fmt: skip


def test_who_looks_on_takes_no_picture_from_the_log_and_waits_for_no_camera_that_is_gone(monkeypatch):
    ring = pictures.PictureRing.create()
    with closing(NewestPictures({"down": ring.name}, {"down": 10})) as shown:
        for t_ns in (100, 110, 120):
            ring.write(t_ns, b"%d" % t_ns)
        assert shown.at(119)["down"].jpeg == b"110"
        assert shown.at(90) == {}
        monkeypatch.setattr("rtstack.cameras.newest._PATIENCE_S", 0.0)
        assert shown.at(500)["down"].t_ns == 120
        monkeypatch.setattr("rtstack.cameras.newest._PATIENCE_S", 1e9)
        assert shown.at(510)["down"].t_ns == 120
        ring.write(510, b"510")
        assert shown.at(515)["down"].t_ns == 510
    assert [t_ns for t_ns, _ in ring.drain()] == [100, 110, 120, 510]
    ring.close()


def requested(rings, path, **changes):
    camera = replace(DOWN, kind="film", address=str(path), height=64, rate_hz=10.0, **changes)
    return CameraRequest("front", camera, rings, default_cell_file(), "rice_box")


@pytest.fixture
def rings():
    made = Rings.create()
    yield made
    made.close()


def test_a_film_is_shown_in_the_time_of_the_run_and_ends(film, rings):
    camera, sample, pusher = Film(requested(rings, film)), np.zeros(1, ARM_SAMPLE), rings.pusher("/left/arm")
    seen = []
    for t_ms in range(7000, 8201, 50):
        sample["t_ns"] = 1_000_000 * t_ms
        pusher.push(sample)
        while (found := camera.read()) is not None:
            seen.append((found[0] // 1_000_000, read_time(found[1]) // 1_000_000))
    sample["t_ns"] = 8_300_000_000
    pusher.push(sample)
    with pytest.raises(OSError, match=r"film.mp4 is over"):
        camera.read()
    camera.close()
    # ten times a second the newest one of 25 a second
    assert seen == [(7000 + 100 * k, min(1160, 40 * (100 * k // 40))) for k in range(13)]


@pytest.mark.parametrize(
    ("path", "changes", "said"),
    [
        ("", {}, "address is missing"), ("none.mp4", {}, "none.mp4 cannot be opened: "),
        ("film.mp4", {"width": 640}, r"has pictures of 384 x 64, not of \(640, 64\)"),
    ],
)  # fmt: skip
def test_a_film_that_cannot_be_shown_is_refused_in_one_line(film, rings, path, changes, said):
    with pytest.raises(OSError, match=said):
        Film(requested(rings, film.parent / path if path else "", **changes))


def test_a_device_that_is_not_there_is_refused_in_one_line(rings):
    with pytest.raises(OSError, match="/dev/none cannot be opened: "):
        Device(requested(rings, "/dev/none"))


def test_h264_is_a_log_of_one_picture_a_message_and_each_of_them_can_be_looked_at(tmp_path):
    camera = pictures.LoggedCamera("down", "", 384, 96, DOWN.K, (), DOWN.pose, video=True)
    ground = np.random.default_rng(0).integers(0, 255, (12, 48, 3), np.uint8).repeat(8, 0).repeat(8, 1)
    encoder, made = Encoder(384, 96, 30.0), []
    times = [5_000_000 + 33_000_000 * k for k in range(80)]
    for k, t_ns in enumerate(times):
        picture = np.roll(ground, 3 * k, axis=1)
        draw_time(picture, t_ns)
        made.append((t_ns, pictures.picture_message(camera.name, t_ns, encoder.encode(t_ns, picture), camera.video)))
    path = tmp_path / "log.mcap"
    with open(path, "wb") as file:
        writer = McapWriter(file, pictures.camera_schemas(camera.name, camera.video))
        writer.begin([("trial", {"kind": "trial"})], ())
        writer.write({"/left/arm": np.zeros(1, ARM_SAMPLE)}, {camera.topics[0]: made} | camera.about(0))
        writer.close()
    with open(path, "rb") as file:  # as a reader of other authors sees it
        said = [each[3] for each in make_reader(file, decoder_factories=[DecoderFactory()]).iter_decoded_messages()]
    parts = [each.data for each in said if hasattr(each, "format")]
    assert {each.format for each in said if hasattr(each, "format")} == {"h264"}
    keys = [k for k, part in enumerate(parts) if b"\0\0\1\x67" in part]  # with a sequence's parameter set
    assert keys == [0, 31, 62]
    log = read_log(path)
    whole = log.pictures(camera.topics[0])
    assert [t_ns for t_ns, _ in whole] == times
    assert all(read_time(np.array(Image.open(io.BytesIO(jpeg)))) == t_ns for t_ns, jpeg in whole)
    for k in (0, 30, 31, 61, 79):
        ((t_ns, jpeg),) = log.pictures(camera.topics[0], (times[k], times[k]))
        assert t_ns == times[k] == read_time(np.array(Image.open(io.BytesIO(jpeg))))


def test_a_camera_in_h264_shows_a_policy_the_same_pictures():
    encoder, ring = Encoder(384, 96, 30.0), pictures.PictureRing.create()
    with closing(NewestPictures({"down": ring.name})) as shown:
        for t_ns in range(0, 2_000_000_000, 33_000_000):
            picture = np.full((96, 384, 3), 90, np.uint8)
            draw_time(picture, t_ns)
            ring.drain()
            ring.write(t_ns, encoder.encode(t_ns, picture))
            assert read_time(shown.at(t_ns)["down"].rgb) == t_ns
    ring.close()
