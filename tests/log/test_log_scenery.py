"""What viewers make of a log by themselves: read by Rerun's own importer, and by nobody's code but protobuf's."""

import json
import os
import subprocess
import sys
from collections import Counter, defaultdict
from datetime import UTC, datetime
from importlib.resources import files
from pathlib import Path

import coal
import numpy as np
import pinocchio as pin
import pytest
from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory

from rtstack.log.reader import read_log
from rtstack.log.viewers.solids import shapes_of
from rtstack.log.viewers.voxels import VOXELS
from rtstack.samples import SIDES
from tests.support.log.samples import MS, WrittenLog

FRAMES = {f"{side}_{name}" for side in SIDES for name in ("base", "pad", *(f"link{k}" for k in range(9)))}
SOLID = {f"{side}_{name}" for side in SIDES for name in ("pad", *(f"link{k}" for k in range(8)))} | {"table", "object"}
RERUN = Path(sys.executable).with_name("rerun")


def decoded(path: Path, topic: str) -> list[tuple[int, object]]:
    with open(path, "rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        return [(message.log_time, what) for _, _, message, what in reader.iter_decoded_messages(topics=[topic])]


def test_every_link_and_thing_is_a_frame_of_every_tf_message(written: WrittenLog) -> None:
    transforms = decoded(written.path, "/tf")
    for _, message in transforms:
        assert {transform.child_frame_id for transform in message.transforms} == FRAMES | {"table", "object"}
    times = np.array([t_ns for t_ns, _ in transforms])
    assert times[0] == 1 * MS
    assert set(np.diff(times[1:])) == {20 * MS}
    assert times[-1] + 20 * MS > written.columns["/left/arm"]["t_ns"][-1]


def test_pinocchio_puts_the_urdfs_links_where_tf_has_them(written: WrittenLog) -> None:
    models = {side: pin.buildModelFromXML(written.cell.urdf[side]) for side in SIDES}
    for t_ns, message in decoded(written.path, "/tf")[:5]:
        tree = {transform.child_frame_id: transform for transform in message.transforms}
        for side, model in models.items():
            data = model.createData()
            pin.framesForwardKinematics(model, data, written.columns[f"/{side}/arm"][t_ns // MS - 1]["q"])
            T, frame = np.eye(4), f"{side}_link8"
            while frame != "world":
                p, r = tree[frame].translation, tree[frame].rotation
                step = np.eye(4)
                step[:3, :3] = pin.Quaternion(r.w, r.x, r.y, r.z).matrix()
                step[:3, 3] = (p.x, p.y, p.z)
                T, frame = step @ T, tree[frame].parent_frame_id
            expected = written.cell.T_world_base[side] @ data.oMf[model.getFrameId("link8")].homogeneous
            np.testing.assert_allclose(T, expected, atol=1e-7)


def test_the_scene_has_solids_in_every_frame_and_says_them_again_each_second(written: WrittenLog) -> None:
    updates = decoded(written.path, "/scene")
    assert [t_ns for t_ns, _ in updates] == [1 * MS, 1000 * MS]
    for _, update in updates:
        entities = {entity.id: entity for entity in update.entities}
        assert entities.keys() == SOLID
        assert all(entity.frame_locked and entity.frame_id == name for name, entity in entities.items())
        size = entities["object"].cubes[0].size
        assert (size.x, size.y, size.z) == written.cell.object_size_m
        assert entities["left_pad"].cubes[0].pose.position.z == -0.5 * written.cell.pad_size_m["left"][2]
        assert len(entities["left_link5"].cylinders) == 2
        assert len(entities["left_link5"].spheres) == 4


def test_an_arrow_is_the_force_of_its_pad(written: WrittenLog) -> None:
    updates = decoded(written.path, "/forces")
    assert len(updates) == len(decoded(written.path, "/tf")) == len(decoded(written.path, "/forces/lines"))
    shown = 0
    for t_ns, update in updates:
        for side, entity in zip(SIDES, update.entities, strict=True):
            sample = written.columns[f"/{side}/arm"][t_ns // MS - 1]
            T = written.cell.T_world_base[side]
            force = T[:3, :3] @ sample["O_F_ext_hat_K"][:3]
            assert entity.id == f"{side}_force"
            assert len(entity.arrows) == (np.linalg.norm(force) >= 1.0)
            for arrow in entity.arrows:
                shown += 1
                p, r = arrow.pose.position, arrow.pose.orientation
                np.testing.assert_allclose((p.x, p.y, p.z), (T @ sample["O_T_EE"])[:3, 3], atol=1e-9)
                along = pin.Quaternion(r.w, r.x, r.y, r.z).matrix()[:, 0]
                np.testing.assert_allclose(along, force / np.linalg.norm(force), atol=1e-9)
    assert shown > 50


@pytest.fixture(scope="module")
def in_rerun(written: WrittenLog) -> dict[str, list]:
    """What Rerun's importer makes of the log: its chunks by entity."""
    from rerun.chunk import McapReader

    chunks = defaultdict(list)
    for chunk in McapReader(written.path).stream():
        chunks[chunk.entity_path].append(chunk.to_record_batch())
    return chunks


def test_rerun_draws_every_body_as_voxels_in_its_frame_for_the_whole_log(
    in_rerun: dict[str, list], written: WrittenLog
) -> None:
    frames, sizes = set(), {}
    for topic in VOXELS:
        (batch,) = [batch for batch in in_rerun[topic] if "VoxelGridMap:voxel_indices" in batch.schema.names]
        row = {name: batch.column(name).to_pylist()[0] for name in batch.schema.names}
        # said once, when the frames begin, and nothing takes its place
        assert batch.num_rows == 1
        assert row["message_log_time"] == datetime.fromtimestamp(1e-3, UTC).replace(tzinfo=None)
        assert len(row["VoxelGridMap:voxel_indices"]) == len(row["VoxelGridMap:colors"])
        # red, green, blue, alpha from the highest byte on
        assert len({colour & 0xFF for colour in row["VoxelGridMap:colors"]} - {0}) == 1
        frames.add((topic, *row["CoordinateFrame:frame"]))
        sizes[topic] = row["VoxelGridMap:voxel_size"][0]
    assert frames == {(f"/shapes/{name}", name) for name in SOLID}
    assert sizes["/shapes/object"] == pytest.approx(written.cell.object_size_m)


def filled(topic: str, path: Path) -> tuple[np.ndarray, float]:
    """Centres of the voxels that are seen, in the body's frame, m, and the volume of all of them, m^3."""
    ((_, grid),) = decoded(path, topic)
    alpha = np.frombuffer(grid.data, np.uint8)[3::4].reshape(-1, grid.row_count, grid.column_count)
    size = np.array([grid.cell_size.x, grid.cell_size.y, grid.cell_size.z])
    r, p = grid.pose.orientation, grid.pose.position
    R = pin.Quaternion(r.w, r.x, r.y, r.z).matrix()
    centres = (np.argwhere(alpha)[:, ::-1] + 0.5) * size @ R.T + (p.x, p.y, p.z)
    return centres, len(centres) * float(np.prod(size))


def test_a_box_is_one_voxel_and_a_link_is_filled_with_them(written: WrittenLog) -> None:
    centres, volume = filled("/shapes/object", written.path)
    np.testing.assert_allclose(centres, np.zeros((1, 3)), atol=1e-12)
    assert volume == pytest.approx(np.prod(written.cell.object_size_m))
    centres, volume = filled("/shapes/right_pad", written.path)
    np.testing.assert_allclose(centres, [(0.0, 0.0, -0.5 * written.cell.pad_size_m["left"][2])], atol=1e-12)
    # link3 is two capsules: every voxel lies in the URDF's solids, and what pinocchio's library finds inside is filled
    shapes = [s for s in shapes_of(written.cell) if s.link == "left_link3"]
    solids = []
    for s in shapes:
        turn = pin.rpy.rpyToMatrix(*s.rpy)
        half = 0.5 * np.array(s.size)
        solid = coal.Sphere(half[0]) if s.kind == "sphere" else coal.Cylinder(half[0], s.size[2])
        solids.append((solid, coal.Transform3s(turn, np.array(s.position))))

    def inside(point: np.ndarray) -> bool:
        probe = coal.Transform3s(np.eye(3), point)
        request = coal.CollisionRequest()
        return any(
            coal.collide(solid, at, coal.Sphere(1e-6), probe, request, coal.CollisionResult()) for solid, at in solids
        )

    centres, _ = filled("/shapes/left_link3", written.path)
    ((_, grid),) = decoded(written.path, "/shapes/left_link3")
    size = np.array([grid.cell_size.x, grid.cell_size.y, grid.cell_size.z])
    low = np.array([grid.pose.position.x, grid.pose.position.y, grid.pose.position.z])
    count = (grid.column_count, grid.row_count, len(grid.data) // grid.slice_stride)
    every = [low + (np.array(index) + 0.5) * size for index in np.ndindex(*count)]
    expected = np.array([point for point in every if inside(point)])
    np.testing.assert_allclose(np.array(sorted(centres.tolist())), np.array(sorted(expected.tolist())), atol=1e-9)


def test_rerun_moves_every_frame_at_every_instant(in_rerun: dict[str, list], written: WrittenLog) -> None:
    children: Counter[str] = Counter()
    for batch in in_rerun["/tf"]:
        if "Transform3D:child_frame" in batch.schema.names:
            for row in batch.column("Transform3D:child_frame").to_pylist():
                children.update(row or [])
    instants = len(read_log(written.path).messages("/tf"))
    assert children == dict.fromkeys(FRAMES | {"table", "object"}, instants)


def test_rerun_has_the_forces_as_points(in_rerun: dict[str, list]) -> None:
    instants = sum(batch.num_rows for batch in in_rerun["/forces/lines"] if "Points3D:positions" in batch.schema.names)
    assert instants == 76


def test_rerun_has_the_joints_as_measured_where_the_blueprint_looks_for_them(
    in_rerun: dict[str, list], written: WrittenLog
) -> None:
    for side in SIDES:
        batches = [b for b in in_rerun[f"/{side}/arm"] if "rtstack.ArmSample:message" in b.schema.names]
        rows = [row for batch in batches for row in batch.column("rtstack.ArmSample:message").to_pylist()]
        np.testing.assert_array_equal([row[0]["q"] for row in rows], written.columns[f"/{side}/arm"]["q"])


def test_review_writes_a_recording_that_rerun_verifies(written: WrittenLog, tmp_path: Path, command_line) -> None:
    out = tmp_path / "trial.rrd"
    assert command_line("review", written.path, "--rrd", out).returncode == 0
    environment = {**os.environ, "HOME": str(tmp_path), "XDG_CONFIG_HOME": str(tmp_path)}
    verified = subprocess.run(
        [RERUN, "rrd", "verify", out], capture_output=True, text=True, env=environment, check=False
    )
    assert verified.returncode == 0, verified.stderr
    printed = subprocess.run(
        [RERUN, "rrd", "print", out], capture_output=True, text=True, env=environment, check=True
    ).stdout
    assert "Blueprint" in printed
    assert all(topic in printed for topic in VOXELS)
    again = command_line("review", written.path, "--rrd", out)
    assert (again.returncode, again.stderr) == (2, f"rtstack: cannot write {out}: File exists\n")


@pytest.mark.parametrize("option", ["--rerun", "--rrd"])
def test_without_rerun_review_says_what_to_install(
    option: str, written: WrittenLog, monkeypatch: pytest.MonkeyPatch, tmp_path: Path, command_line
) -> None:
    monkeypatch.setattr("rtstack.viewers.rerun_view.find_spec", lambda name: None)
    values = [tmp_path / "out.rrd"] if option == "--rrd" else []
    said = command_line("review", written.path, option, *values)
    assert (said.returncode, said.stderr) == (2, "rtstack: Rerun is not installed: pip install rerun-sdk\n")
    assert not any(value.exists() for value in values)


def test_the_foxglove_layout_names_topics_and_fields_of_the_log(written: WrittenLog) -> None:
    layout = json.loads((files("rtstack.viewers") / "foxglove_layout.json").read_text())
    panels = layout["configById"]
    topics = set(read_log(written.path).topics)
    assert panels["3D!cell"]["topics"].keys() <= topics
    assert panels["RosOut!events"]["topicToRender"] in topics
    paths = [path["value"] for name, panel in panels.items() if name.startswith("Plot!") for path in panel["paths"]]
    for path in paths:
        topic, _, field = path.partition(".")
        name, _, index = field.partition("[")
        assert np.ndim(written.columns[topic][name][0]) == bool(index)
    assert len(paths) == 10

    def leaves(node: object) -> set[str]:
        return {node} if isinstance(node, str) else leaves(node["first"]) | leaves(node["second"])

    assert leaves(layout["layout"]) == panels.keys()
