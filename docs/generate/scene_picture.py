"""A picture of a log as a viewer of Foxglove's schemas sees it: from /scene, /forces and /tf, with none of our code.

Foxglove itself is no package that one can install: this reads the same messages by the mcap and protobuf libraries, and
draws cubes, cylinders, spheres and arrows. By hand: python docs/generate/scene_picture.py LOG.mcap OUT.png SECONDS
"""

import sys
from itertools import pairwise
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory

mpl.use("agg")
import matplotlib.pyplot as plt
from mpl_toolkits.mplot3d.art3d import Poly3DCollection

SIDES = 24  # of a round thing
LIGHT = np.array([0.4, -0.5, 0.75])


def state_at(path: Path, t_ns: int) -> tuple[dict[str, Any], dict[str, Any]]:
    """Return the entities that stand at a time, and the newest transform of each frame, by id and child frame."""
    entities: dict[str, Any] = {}
    frames: dict[str, Any] = {}
    with open(path, "rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        topics = ["/scene", "/forces", "/tf"]
        for _, channel, _, message in reader.iter_decoded_messages(topics=topics, ending_at=t_ns):
            if channel.topic == "/tf":
                frames |= {transform.child_frame_id: transform for transform in message.transforms}
            else:
                entities |= {f"{channel.topic} {entity.id}": entity for entity in message.entities}
    return entities, frames


def matrix(position: Any, rotation: Any) -> np.ndarray:
    """Return the homogeneous matrix of a position and a quaternion."""
    w, x, y, z = rotation.w, rotation.x, rotation.y, rotation.z
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y), position.x],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x), position.y],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y), position.z],
            [0.0, 0.0, 0.0, 1.0],
        ]
    )


def in_world(frames: dict[str, Any], frame: str) -> np.ndarray:
    """Return the pose of a frame, composed along its parents. Raises KeyError where one is missing."""
    T = np.eye(4)
    while frame != "world":
        transform = frames[frame]
        T = matrix(transform.translation, transform.rotation) @ T
        frame = transform.parent_frame_id
    return T


def turned(radii: list[float], heights: list[float]) -> list[np.ndarray]:
    """Return the faces of a body of revolution about z, of these radii at these heights."""
    angle = np.linspace(0.0, 2 * np.pi, SIDES + 1)
    rings = [np.column_stack([r * np.cos(angle), r * np.sin(angle), np.full(SIDES + 1, h)]) for r, h in
             zip(radii, heights, strict=True)]  # fmt: skip
    return [
        np.array([low[k], low[k + 1], high[k + 1], high[k]])
        for low, high in pairwise(rings) for k in range(SIDES)
    ]  # fmt: skip


def box() -> list[np.ndarray]:
    """Return the faces of a unit cube."""
    faces = []
    for axis in range(3):
        for end in (-0.5, 0.5):
            face = np.full((4, 3), end)
            face[:, [k for k in range(3) if k != axis]] = [(-0.5, -0.5), (0.5, -0.5), (0.5, 0.5), (-0.5, 0.5)]
            faces.append(face)
    return faces


def solids(entity: Any) -> list[tuple[list[np.ndarray], np.ndarray, Any]]:
    """Return (faces, their pose, colour) of each primitive of an entity."""
    polar = np.linspace(-np.pi / 2, np.pi / 2, 9)
    ball = turned((0.5 * np.cos(polar)).tolist(), (0.5 * np.sin(polar)).tolist())
    tube = turned([0.0, 0.5, 0.5, 0.0], [-0.5, -0.5, 0.5, 0.5])
    found = []
    for faces, primitives in ((box(), entity.cubes), (tube, entity.cylinders), (ball, entity.spheres)):
        for one in primitives:
            scale = np.array([one.size.x, one.size.y, one.size.z])
            pose = matrix(one.pose.position, one.pose.orientation)
            found.append(([face * scale for face in faces], pose, one.color))
    z_to_x = np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]])
    for one in entity.arrows:
        shaft, head = 0.5 * one.shaft_diameter, 0.5 * one.head_diameter
        end = one.shaft_length + one.head_length
        profile = turned([shaft, shaft, head, 0.0], [0.0, one.shaft_length, one.shaft_length, end])
        pose = matrix(one.pose.position, one.pose.orientation)
        found.append(([face @ z_to_x.T for face in profile], pose, one.color))
    return found


def draw(entities: dict[str, Any], frames: dict[str, Any], out: Path, title: str) -> None:
    """Draw the entities, farthest faces first."""
    faces, colours = [], []
    for entity in entities.values():
        T_frame = in_world(frames, entity.frame_id)
        for polygons, pose, colour in solids(entity):
            T = T_frame @ pose
            for polygon in polygons:
                face = polygon @ T[:3, :3].T + T[:3, 3]
                normal = np.cross(face[2] - face[0], face[3] - face[1])
                length = np.linalg.norm(normal)
                shade = 0.55 + 0.45 * abs(normal @ LIGHT) / length if length > 0.0 else 1.0
                faces.append(face)
                colours.append((colour.r * shade, colour.g * shade, colour.b * shade, colour.a))
    figure = plt.figure(figsize=(9, 6.5), dpi=110)
    axes = figure.add_subplot(projection="3d", proj_type="persp", computed_zorder=False)
    axes.add_collection3d(Poly3DCollection(faces, facecolors=colours, edgecolors="none"))
    axes.set(xlim=(-0.6, 0.5), ylim=(-0.75, 0.75), zlim=(0.0, 1.0), xlabel="x, m", ylabel="y, m", zlabel="z, m")
    axes.set_box_aspect((1.1, 1.5, 1.0))
    axes.view_init(elev=22, azim=-28)
    axes.set_title(title)
    figure.savefig(out, bbox_inches="tight")


def main(log: Path, out: Path, seconds: float) -> None:
    """Draw a log at a time, s."""
    entities, frames = state_at(log, round(seconds * 1e9))
    draw(
        entities, frames, out, f"/scene, /forces and /tf at {seconds:g} s, drawn without Foxglove and without our code"
    )


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2]), float(sys.argv[3]))
