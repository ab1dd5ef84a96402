"""Tags in pictures that were drawn from known poses, by us and by MuJoCo; and the process that passes them on."""

import contextlib
import time
from dataclasses import replace

import cv2
import numpy as np
import pytest

from hal.base.configuration import ConfigurationError
from hal.clock_relation import ClockRelation
from hal.tracker import TrackerFrames, TrackerRequest, TrackerTimes
from hal.trackers.apriltag import AprilTagTracker, detector
from rtstack.cells import default_cell_file
from rtstack.model.cell_description import load_cell_description
from rtstack.model.rotation import rotation_from_quaternion
from sim_robot.scene import load_scene
from tests.support.trackers.rendered import RenderedCell
from tests.support.trackers.tags import CAMERA, Sender, looking_at, picture

EYE = looking_at((-0.35, 0.05, 1.15), (0.0, 0.0, 0.45))


def turned(rng: np.random.Generator, most_rad: float) -> np.ndarray:
    axis = rng.standard_normal(3)
    return cv2.Rodrigues(axis / np.linalg.norm(axis) * rng.uniform(0.0, most_rad))[0]


def in_camera(position, rotation) -> np.ndarray:
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = rotation, position
    return np.linalg.inv(EYE) @ T


def test_two_objects_are_found_within_two_millimetres():
    rng, find, off_mm, off_deg = np.random.default_rng(0), detector(CAMERA), [], []
    for _ in range(15):
        places = ((rng.uniform(-0.05, 0.05), 0.12, 0.4), (0.0, -0.12, rng.uniform(0.4, 0.6)))
        tags = {n: in_camera(p, turned(rng, 0.3)) for n, p in zip((7, 42), places, strict=True)}
        found = find(picture(CAMERA, tags, rng))
        assert sorted(found) == [7, 42]
        for number, T in tags.items():
            off_mm.append(1e3 * np.linalg.norm(found[number][:3, 3] - T[:3, 3]))
            turn = cv2.Rodrigues(found[number][:3, :3].T @ T[:3, :3])[0]
            off_deg.append(np.degrees(np.linalg.norm(turn)))
    assert np.median(off_mm) < 0.2
    assert np.max(off_mm) < 2.0
    assert np.max(off_deg) < 0.5


def test_a_number_that_is_seen_twice_is_not_found():
    find, T = detector(CAMERA), np.eye(4)
    T[:3, :3], T[:3, 3] = np.diag([1.0, -1.0, -1.0]), (-0.2, 0.0, 0.8)
    other = T.copy()
    other[0, 3] = 0.2
    left, right = picture(CAMERA, {42: T, 7: other}), picture(CAMERA, {42: other})
    assert sorted(find(left)) == [7, 42]
    half = CAMERA.size[0] // 2
    assert find(np.hstack([left[:, :half], right[:, half:]])) == {}


def test_nothing_is_found_where_no_tag_is():
    rng, find = np.random.default_rng(1), detector(CAMERA)
    assert find(rng.integers(0, 255, CAMERA.size[::-1], np.uint8)) == {}
    assert find(np.zeros(CAMERA.size[::-1], np.uint8)) == {}


@pytest.mark.long  # needs a graphics library: Debian's libegl1 draws without a card
def test_a_tag_on_the_object_of_the_scene_is_found_where_mujoco_has_it():
    rng, find, off_mm, scene = np.random.default_rng(2), detector(CAMERA), [], load_scene()
    with contextlib.closing(RenderedCell(CAMERA, EYE, 7)) as cell:
        for _ in range(10):
            placement = scene.place("rice_box", 0.0, (0.35, -0.35), rng)
            T = EYE @ find(cell.picture(np.array(placement.position), np.array(placement.wxyz)))[7]
            tag, turn = cell.data.body("object").xpos, cell.data.body("object").xmat.reshape(3, 3)
            off_mm.append(1e3 * np.linalg.norm(T[:3, 3] - tag - cell.top_m * turn[:, 2]))
            np.testing.assert_allclose(T[:3, 2], turn[:, 2], atol=0.02)
            np.testing.assert_allclose(T[:3, 0], turn[:, 0], atol=0.02)
    assert np.percentile(off_mm, 95) < 2.0


def request(source: str, **other) -> TrackerRequest:
    frames = TrackerFrames("z", (1.0, 2.0, 0.5), (1.0, 0.0, 0.0, 0.0), (0.0, 0.0, -0.1))
    values = {"camera": replace(CAMERA, source=source), "body": 7} | other
    return TrackerRequest("", 0, frames, TrackerTimes("host", 4.0, 1e6), ClockRelation(), **values)


def test_a_tag_is_followed_in_the_world_and_in_the_robots_time():
    sender = Sender()
    asked = request(sender.source)
    tracker, offset_ns = AprilTagTracker(asked), 77_000_000_000
    try:
        T = np.eye(4)
        T[:3, :3], T[:3, 3] = np.diag([1.0, -1.0, -1.0]), (0.1, 0.05, 0.8)
        other = T.copy()
        other[:3, 3] = (-0.15, -0.1, 0.9)
        grey, end_s = picture(CAMERA, {7: T, 9: other}), time.monotonic() + 60.0
        assert tracker.latest().record["seen"][0] == 0
        asked.robot_clock.update(time.monotonic_ns() - offset_ns, time.monotonic_ns())
        while not tracker.latest().record["seen"][0]:
            assert time.monotonic() < end_s
            taken_ns = time.monotonic_ns()
            sender.send(taken_ns, grey)
            time.sleep(0.02)
        # the camera stands in (1, 2, 0.5) with the world's axes; the object is 0.1 m behind the tag, which looks back
        assert np.allclose(tracker.latest().position, (1.1, 2.05, 0.5 + 0.8 + 0.1), atol=2e-3)
        R = rotation_from_quaternion(tracker.latest().orientation_wxyz)
        assert np.allclose(R, np.diag([1.0, -1.0, -1.0]), atol=0.02)
        later_ns = time.monotonic_ns()
        sender.send(later_ns, grey)
        while tracker.latest().t_ns < later_ns - offset_ns - 5_000_000:
            assert time.monotonic() < end_s
            time.sleep(0.01)
        assert abs(tracker.latest().t_ns - (later_ns - offset_ns - 4_000_000)) < 1_000_000
    finally:
        tracker.close()
        sender.close()


def test_without_camera_or_tag_it_is_refused():
    with pytest.raises(ValueError, match=r"\[tracker\.camera\]"):
        AprilTagTracker(request("0", camera=None))
    with pytest.raises(ValueError, match=r"\[tracker\.bodies\.OBJECT\] id"):
        AprilTagTracker(request("0", body=None))


@pytest.mark.parametrize(
    ("line", "complaint"),
    [
        ("focal = [700.0, -1.0]", r"key tracker\.camera\.focal\.1"),
        ('family = "36h12"', r"key tracker\.camera\.family"),
        ("exposure = 3", r"key tracker\.camera\.exposure"),
    ],
)
def test_a_camera_that_cannot_be_is_one_line_with_its_key(tmp_path, line, complaint):
    good = {
        "source": '"0"',
        "size": "[640, 480]",
        "focal": "[700.0, 700.0]",
        "centre": "[319.5, 239.5]",
        "tag_size": "0.1",
    }
    key, _, value = line.partition(" = ")
    table = "\n".join(f"{k} = {v}" for k, v in (good | {key: value}).items())
    path = tmp_path / "cell.toml"
    path.write_text(default_cell_file().read_text() + f"\n[tracker.camera]\n{table}\n")
    with pytest.raises(ConfigurationError, match=complaint):
        load_cell_description(path)
