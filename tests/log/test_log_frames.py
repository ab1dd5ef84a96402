"""The frames of /tf, composed along their tree, against Pinocchio."""

from collections.abc import Iterator

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given
from hypothesis import strategies as st
from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory

from hal.robots import FR3
from rtstack.log.viewers.frames import quaternions_of
from rtstack.samples import SIDES
from tests.support.log.samples import MS, WrittenLog


def messages(written: WrittenLog) -> Iterator[tuple[int, dict[str, tuple[str, np.ndarray]]]]:
    """Yield (t_ns, child frame -> (parent frame, T_parent_child))."""
    with open(written.path, "rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        for _, _, message, decoded in reader.iter_decoded_messages(topics=["/tf"]):
            tree = {}
            for transform in decoded.transforms:
                p, q = transform.translation, transform.rotation
                T = np.eye(4)
                T[:3, :3] = pin.Quaternion(q.w, q.x, q.y, q.z).matrix()
                T[:3, 3] = (p.x, p.y, p.z)
                tree[transform.child_frame_id] = (transform.parent_frame_id, T)
            yield message.log_time, tree


def in_world(tree: dict[str, tuple[str, np.ndarray]], frame: str) -> np.ndarray:
    T = np.eye(4)
    while frame != "world":
        frame, T_parent_child = tree[frame]
        T = T_parent_child @ T
    return T


def test_the_links_are_where_pinocchio_says(written: WrittenLog) -> None:
    model = pin.buildModelFromXML(FR3.urdf)
    data = model.createData()
    checked = 0
    for t_ns, tree in messages(written):
        for side in SIDES:
            sample = written.columns[f"/{side}/arm"][t_ns // MS - 1]
            pin.framesForwardKinematics(model, data, sample["q"].astype(float))
            base = written.cell.T_world_base[side]
            for index in range(1, 9):
                expected = base @ data.oMf[model.getFrameId(f"link{index}")].homogeneous
                np.testing.assert_allclose(in_world(tree, f"{side}_link{index}"), expected, atol=1e-9)
            pad = base @ sample["O_T_EE"]
            np.testing.assert_allclose(in_world(tree, f"{side}_pad"), pad, atol=1e-9)
        pose = written.columns["/object/pose"][t_ns // MS - 1]
        T_world_object = in_world(tree, "object")
        np.testing.assert_allclose(T_world_object[:3, 3], pose["position"], atol=1e-12)
        quaternion = pin.Quaternion(*pose["orientation_wxyz"].tolist())
        np.testing.assert_allclose(T_world_object[:3, :3], quaternion.matrix(), atol=1e-9)
        checked += 1
    assert checked == pytest.approx(75, abs=1)


def test_the_rate_is_50_hz_of_the_robots_time(written: WrittenLog) -> None:
    times = [t_ns for t_ns, _ in messages(written)]
    assert set(np.diff(times[1:]).tolist()) == {20 * MS}


@given(st.lists(st.floats(-1.0, 1.0), min_size=4, max_size=4).filter(lambda q: np.linalg.norm(q) > 1e-2))
def test_a_rotation_becomes_its_quaternion(values: list[float]) -> None:
    w, x, y, z = np.array(values) / np.linalg.norm(values)
    R = pin.Quaternion(w, x, y, z).matrix()
    (q,) = quaternions_of(R[None])
    assert abs(q @ [w, x, y, z]) == pytest.approx(1.0, abs=1e-9)
