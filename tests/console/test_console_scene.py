"""The scene: its figure agrees with an independent model, its raw port is shut."""

from socket import create_connection

import numpy as np
import pinocchio
import pytest
import trimesh
import zstandard
from websockets.sync.client import connect

from console.scene.scene import LINKS, CellFigures, capsule_parts, full_parts, light_parts, turned
from console.scene.scenes import Detail
from console.scene.server import SECRET_HEADER
from hal.robots import FR3
from rtstack.log.viewers.frames import joint_placements
from sim_robot.plant_parameters import load_plant_parameters
from tests.support.console.client import socket


def test_the_chain_of_frames_agrees_with_pinocchio():
    model = pinocchio.buildModelFromXML(FR3.urdf)
    data = model.createData()
    generator = np.random.default_rng(3)
    for _ in range(20):
        q = generator.uniform(FR3.limits.q_lower, FR3.limits.q_upper)
        pinocchio.forwardKinematics(model, data, q)
        T = np.eye(4)
        for number, joint in enumerate(joint_placements(FR3.urdf)[:-1]):
            step = trimesh.transformations.quaternion_matrix(turned(joint, q[number]))
            step[:3, 3] = joint.position
            T = T @ step
            np.testing.assert_allclose(T, data.oMi[number + 1].homogeneous, atol=1e-9)


@pytest.mark.parametrize("link", LINKS)
def test_every_link_has_a_shape_of_its_size_in_every_detail(link):
    boxes = []
    for parts in (full_parts(FR3, link), light_parts(FR3, link), capsule_parts(FR3, link)):
        vertices = np.vstack([part.vertices for part in parts])
        assert all(part.faces.max() < len(part.vertices) for part in parts)
        boxes.append((vertices.min(axis=0), vertices.max(axis=0)))
    (full_low, full_high), (light_low, light_high), (capsule_low, capsule_high) = boxes
    # two independent files of the same link agree; our capsules are only roughly as large
    np.testing.assert_allclose(full_low, light_low, atol=6e-3)
    np.testing.assert_allclose(full_high, light_high, atol=6e-3)
    assert np.linalg.norm(capsule_high - capsule_low) == pytest.approx(np.linalg.norm(full_high - full_low), rel=0.6)


def test_the_raw_port_is_on_loopback_only(served):
    server = served.parts.scenes.server(Detail.LIGHT)
    with pytest.raises(OSError, match="refused"):
        create_connection(("127.0.0.2", server.port), timeout=2).close()


def test_no_page_can_open_a_tunnel(served):
    handlers = served.parts.scenes.server(Detail.LIGHT).viser._websock_server._incoming_handlers
    assert handlers
    assert not [message for message in handlers if "share" in message.__name__.lower()]


def test_the_proxy_forwards_the_page_and_the_subprotocol(served):
    with served.signed_in() as (client, _):
        page = client.get("/viser/light/")
        assert page.status_code == 200
        assert "<title>Viser</title>" in page.text
        assert client.get("/viser/no_such_detail/").status_code == 422
        with socket(served, "/viser/light", client) as stream:
            assert stream.subprotocol == "viser-v1.1.1"
            assert len(stream.recv(timeout=60)) > 16


def test_what_moves_is_packed_once_for_all_who_look(served):
    """The bytes that two pages get are the same, the time of packing inside them too."""
    server = served.parts.review_scenes.server(Detail.LIGHT)  # of which nobody moves anything but this test
    options = {
        "subprotocols": ["viser-v1.1.1"],
        "additional_headers": {SECRET_HEADER: server.secret},
        "proxy": None,
        "max_size": None,
        "compression": None,
    }
    address = f"ws://127.0.0.1:{server.port}"

    def until(stream, word):
        """The first window that has this word in it."""
        while True:
            window = stream.recv(timeout=60)
            size = int.from_bytes(window[8:16], "little")
            if word in zstandard.ZstdDecompressor().decompress(window[16 : 16 + size]):
                return window

    with connect(address, **options) as one, connect(address, **options) as other:
        for stream in (one, other):
            until(stream, b"ReplayDoneMessage")  # each was sent what there was before it came
        with server.viser.atomic():
            server.viser.scene.add_frame("/mark")
        assert until(one, b"/mark") == until(other, b"/mark")


def test_an_object_at_rest_is_drawn_once_whatever_its_tracker_s_noise(served, cell):
    """Else the scene would never rest: it would be drawn for ever, and never sharply."""
    scene = served.parts.scenes.server(Detail.LIGHT).viser.scene
    figures = CellFigures(scene, cell, full=False)
    generator, tracker = np.random.default_rng(4), load_plant_parameters().tracker
    noise_m, noise_rad = 1e-3 * tracker.position_noise_mm, np.radians(tracker.orientation_noise_deg)
    shown = []
    for _ in range(1000):
        pose = np.array([0.0, 0.1, 0.2, 1.0, 0.0, 0.0, 0.0])
        pose[:3] += noise_m * generator.standard_normal(3)
        pose[4:] += noise_rad / 2.0 * generator.standard_normal(3)
        figures.show_object("rice_box", pose)
        assert figures._object is not None
        shown.append(tuple(figures._object.position))
    assert len(set(shown)) == 1
    figures.show_object("rice_box", pose + [0.002, 0, 0, 0, 0, 0, 0])
    assert figures._object.position[0] == pytest.approx(pose[0] + 0.002)
