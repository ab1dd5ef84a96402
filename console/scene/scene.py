"""What a scene shows: the arms, the pads, the table and the object, where they are said to be.

Each arm is a chain of frames from our own description, so that seven rotations a step move all of it. World frame. Its
shape is meshes of the package example-robot-data where it is installed, else plain capsules. Of its Collada files are
read: triangles, one transform a node, one diffuse colour a material.
"""

import sysconfig
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Literal
from xml.etree import ElementTree

import numpy as np
import trimesh
import viser
from numpy.typing import NDArray

from console.teleoperation.quaternion import product
from hal.base.arrays import Array
from hal.limits import DOF
from hal.robots import RobotModel
from rtstack.log.viewers.frames import JointPlacement, joint_placements
from rtstack.log.viewers.solids import shapes_in
from rtstack.model.cell_description import CellDescription

LINKS = tuple(f"link{number}" for number in range(8))
_FOLDER = "cmeel.prefix/share/example-robot-data/robots"
COARSE_M = 0.015  # of the light drawing: a link keeps its outline, and a tenth of its triangles
GROWN_M = 0.003  # of what is seen through: what it is drawn over never lies in the same plane
_PLAIN = (226, 230, 232)  # the arm's own off-white
_C = "{http://www.collada.org/2005/11/COLLADASchema}"


@dataclass(frozen=True, slots=True)
class Part:
    """Triangles of one colour in a link's frame: vertices (n, 3) m, faces (m, 3), sRGB 0-255."""

    vertices: NDArray[np.float32]
    faces: NDArray[np.uint32]
    colour: tuple[int, int, int]


def full_parts(model: RobotModel, link: str) -> list[Part]:
    """Return the visual mesh of a link, the light one where it is not installed."""
    path = _installed(model, f"visual/{link}.dae")
    return light_parts(model, link) if path is None else read_collada(path)


@cache
def light_parts(model: RobotModel, link: str) -> list[Part]:
    """Return the visual mesh of a link, coarse, for software rendering; capsules where it is not installed."""
    path = _installed(model, f"visual/{link}.dae")
    if path is None:
        return capsule_parts(model, link)
    by_colour: dict[tuple[int, int, int], list[Part]] = {}
    for part in read_collada(path):
        by_colour.setdefault(part.colour, []).append(part)
    found = []
    for colour, parts in by_colour.items():
        vertices, faces = trimesh.util.append_faces([part.vertices for part in parts], [part.faces for part in parts])
        found.append(coarse(Part(vertices, faces.astype(np.uint32), colour), COARSE_M))
    return [part for part in found if len(part.faces)]


@cache
def hull_parts(model: RobotModel, link: str) -> list[Part]:
    """Return the convex hull of a link, larger by GROWN_M: few faces, and none inside, for what is seen through."""
    hull = trimesh.Trimesh(np.vstack([part.vertices for part in light_parts(model, link)])).convex_hull
    grown = hull.vertices + GROWN_M * hull.vertex_normals
    return [Part(np.asarray(grown, np.float32), np.asarray(hull.faces, np.uint32), _PLAIN)]


def coarse(part: Part, cell_m: float) -> Part:
    """Return a part with one vertex in each cube of cell_m, amid its own (vertex clustering, Rossignac 1993)."""
    cells, cluster = np.unique(np.floor(part.vertices / cell_m).astype(np.int64), axis=0, return_inverse=True)
    cluster = cluster.reshape(-1)
    count = np.bincount(cluster, minlength=len(cells))
    vertices = np.stack([np.bincount(cluster, part.vertices[:, axis]) for axis in range(3)], axis=1) / count[:, None]
    faces = cluster[part.faces]
    faces = faces[(faces != np.roll(faces, 1, axis=1)).all(axis=1)]
    _, first = np.unique(np.sort(faces, axis=1), axis=0, return_index=True)
    return Part(vertices.astype(np.float32), faces[np.sort(first)].astype(np.uint32), part.colour)


def capsule_parts(model: RobotModel, link: str) -> list[Part]:
    """Return the plain shapes of our own description of a link."""
    parts = []
    for shape in (one for one in shapes_in(model.urdf) if one.link == link):
        width, _, length = shape.size
        if shape.kind == "sphere":
            mesh = trimesh.creation.icosphere(subdivisions=1, radius=width / 2.0)
        elif shape.kind == "box":
            mesh = trimesh.creation.box(shape.size)
        else:
            mesh = trimesh.creation.cylinder(width / 2.0, length, sections=16)
        transform = trimesh.transformations.euler_matrix(*shape.rpy, "sxyz")
        transform[:3, 3] = shape.position
        mesh.apply_transform(transform)
        parts.append(Part(np.asarray(mesh.vertices, np.float32), np.asarray(mesh.faces, np.uint32), _PLAIN))
    return parts


def read_collada(path: Path) -> list[Part]:
    """Read the triangles of a Collada file, one part a material. Metres and z up, as these files are."""
    document = ElementTree.parse(path).getroot()
    colours = _colours(document)
    geometries = {element.attrib["id"]: element for element in document.iter(f"{_C}geometry")}
    parts = []
    for node in document.iter(f"{_C}node"):
        instance, matrix = node.find(f"{_C}instance_geometry"), node.find(f"{_C}matrix")
        if instance is None:
            continue
        transform = np.eye(4) if matrix is None else np.array((matrix.text or "").split(), np.float64).reshape(4, 4)
        bindings = instance.iter(f"{_C}instance_material")
        bound = {binding.attrib["symbol"]: _id(binding, "target") for binding in bindings}
        geometry = geometries[_id(instance, "url")]
        for triangles in (*geometry.iter(f"{_C}triangles"), *geometry.iter(f"{_C}polylist")):
            positions, faces = _triangles(geometry, triangles)
            world = positions @ transform[:3, :3].T + transform[:3, 3]
            symbol = triangles.attrib.get("material", "")
            colour = colours.get(bound.get(symbol, symbol), _PLAIN)
            parts.append(Part(world.astype(np.float32), faces.astype(np.uint32), colour))
    return parts


def _triangles(
    geometry: ElementTree.Element, triangles: ElementTree.Element
) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    inputs = triangles.findall(f"{_C}input")
    stride = 1 + max(int(entry.attrib["offset"]) for entry in inputs)
    vertex = next(entry for entry in inputs if entry.attrib["semantic"] == "VERTEX")
    indices = np.array((triangles.findtext(f"{_C}p") or "").split(), np.int64).reshape(-1, stride)
    corners = indices[:, int(vertex.attrib["offset"])]
    if corners.size % 3:
        raise ValueError("a polygon with more than three corners")
    vertices = geometry.find(f".//{_C}vertices[@id='{_id(vertex, 'source')}']/{_C}input")
    assert vertices is not None
    positions = geometry.findtext(f".//{_C}source[@id='{_id(vertices, 'source')}']/{_C}float_array") or ""
    return np.array(positions.split(), np.float64).reshape(-1, 3), corners.reshape(-1, 3)


def _colours(document: ElementTree.Element) -> dict[str, tuple[int, int, int]]:
    diffuse = {}
    for effect in document.iter(f"{_C}effect"):
        if colour := effect.findtext(f".//{_C}diffuse/{_C}color"):
            red, green, blue = (round(255 * float(value)) for value in colour.split()[:3])
            diffuse[effect.attrib["id"]] = (red, green, blue)
    colours = {}
    for material in document.iter(f"{_C}material"):
        instance = material.find(f"{_C}instance_effect")
        colours[material.attrib["id"]] = _PLAIN if instance is None else diffuse.get(_id(instance, "url"), _PLAIN)
    return colours


def _id(element: ElementTree.Element, key: str) -> str:
    return element.attrib[key].removeprefix("#")


def _installed(model: RobotModel, name: str) -> Path | None:
    path = Path(sysconfig.get_path("platlib")) / _FOLDER / model.meshes / name
    return path if model.meshes and path.is_file() else None


COLOURS = {"left": (86, 180, 233), "right": (230, 159, 0)}  # #56B4E9, #E69F00, Okabe-Ito: an arm's everywhere
_TABLE_COLOUR = (92, 98, 106)
_OBJECT_COLOUR = (188, 164, 128)
_FLOOR_COLOUR = (112, 121, 131)  # seen on the dark ground and on the light one
_FLOOR_M = 4.0
_EDGES = np.array([[a, a | bit] for a in range(8) for bit in (1, 2, 4) if not a & bit])  # of a box, by its corners
# m, and of a quaternion: less than a pixel, and more than a tracker's noise, which would draw the scene for ever
_SMALLEST_OBJECT_MOVE = np.array([1e-3] * 3 + [3e-3] * 4)
_SMALLEST_FORCE = np.array([1e-3] * 3 + [0.2] * 3)  # m, N
_SMALLEST_MOVE = 3e-4  # rad and m: less is not seen, and a resting arm's sensors would draw the scene for ever


def turned(joint: JointPlacement, angle: float) -> Array:
    """Return the orientation of a joint's child in its parent, quaternion wxyz, at `angle` rad about the joint's z."""
    return product(joint.orientation_wxyz, (np.cos(angle / 2.0), 0.0, 0.0, np.sin(angle / 2.0)))


@dataclass(frozen=True, slots=True)
class Ghost:
    """How something is drawn that is not here: in a path and colour of its own, seen through, a little larger."""

    path: str
    colour: tuple[int, int, int] | None
    opacity: float | None = 0.4

    def size(self, size: tuple[float, float, float]) -> tuple[float, float, float]:
        """Return the size, m, at which a box is drawn."""
        return size if self is SOLID else grown(size)


SOLID = Ghost("", None, None)  # what is here


class ArmFigure:
    """One arm and its pad in a scene."""

    def __init__(self, scene: viser.SceneApi, side: str, cell: CellDescription, full: bool, ghost: Ghost) -> None:
        mounting, solid = cell.mountings[side], ghost is SOLID
        *self._joints, flange = joint_placements(mounting.robot.urdf)
        self._frames: list[viser.FrameHandle] = []
        self._shown = np.full(DOF, np.inf)
        colour = ghost.colour or COLOURS[side]
        path = root = f"{ghost.path}/{side}"
        self._base = scene.add_frame(
            path, show_axes=False, position=mounting.base_position, wxyz=mounting.base_orientation_wxyz
        )
        parts = hull_parts if not solid else full_parts if full else light_parts
        full = full and solid
        _add_parts(scene, path, parts(mounting.robot, LINKS[0]), full, ghost)
        for link, joint in zip(LINKS[1:], self._joints, strict=True):
            path = f"{path}/{link}"
            frame = scene.add_frame(path, show_axes=False, position=joint.position, wxyz=joint.orientation_wxyz)
            self._frames.append(frame)
            _add_parts(scene, path, parts(mounting.robot, link), full, ghost)
        pad = mounting.pad or cell.pad
        box, size = pad.F_T_box, ghost.size(pad.size)
        centre = box[:3, 3] + (0.0, 0.0, flange.position[2])
        scene.add_box(
            f"{path}/pad", colour, size, position=centre, wxyz=np.array(pad.orientation_wxyz), opacity=ghost.opacity,
            cast_shadow=full,
        )  # fmt: skip
        if solid:
            outwards = 0.24 if side == "left" else -0.24
            scene.add_label(f"{root}/label", side, position=(0.0, outwards, 0.02), anchor="center-center")
        else:
            add_edges(scene, f"{path}/pad_edges", box_edges(size, np.zeros(3)) @ box[:3, :3].T + centre, colour)
        self.show(np.array(mounting.home))

    def show(self, q: Sequence[float] | Array | None) -> None:
        """Show the arm at `q`, (7,) rad, or nothing of it."""
        self._base.visible = q is not None
        for index, (frame, joint) in enumerate(zip(self._frames, self._joints, strict=True)):
            if q is not None and abs(q[index] - self._shown[index]) > _SMALLEST_MOVE:
                self._shown[index] = q[index]
                frame.wxyz = turned(joint, float(q[index]))


def add_stage(server: viser.ViserServer, cell: CellDescription, full: bool) -> None:
    """Draw what never moves, for everybody: light, camera, floor and table. `full`: with shadows."""
    scene = server.scene
    server.gui.configure_theme(dark_mode=True, show_logo=False, show_share_button=False)
    # from behind the arms, so that the left arm is on the left
    server.initial_camera.position = (-1.75, 0.0, 1.35)
    server.initial_camera.look_at = (-0.02, 0.0, 0.3)
    server.initial_camera.fov = 0.72  # rad
    if full:
        scene.add_grid(
            "/floor", _FLOOR_M, _FLOOR_M, cell_size=0.1, section_size=0.5, cell_color=(126, 134, 143),
            section_color=_FLOOR_COLOUR,
        )  # fmt: skip
    else:  # plain lights and a floor of lines: viser's surroundings and floor shader hold software rendering up
        scene.configure_environment_map(None)
        scene.configure_default_lights(enabled=False)
        scene.add_light_ambient("/light/all", intensity=1.3)
        scene.add_light_directional("/light/above", intensity=2.2, position=(-1.0, 0.6, 1.6))
        half, places = _FLOOR_M / 2.0, np.arange(-_FLOOR_M / 2.0, _FLOOR_M / 2.0 + 0.25, 0.5)
        lines = [((at, -half, 0.0), (at, half, 0.0)) for at in places]
        lines += [((-half, at, 0.0), (half, at, 0.0)) for at in places]
        scene.add_line_segments("/floor", np.array(lines), _FLOOR_COLOUR, thickness=1.0, thickness_units="screen")
    x, y = cell.table.centre_xy
    length, width = cell.table.size_xy
    scene.add_box(
        "/table", color=_TABLE_COLOUR, dimensions=(length, width, cell.table.top_z),
        position=(x, y, cell.table.top_z / 2.0), cast_shadow=False,
    )  # fmt: skip


class CellFigures:
    """The arms and the object in a scene. full: with visual meshes and shadows; ghost: drawn as one, light."""

    def __init__(self, scene: viser.SceneApi, cell: CellDescription, full: bool, ghost: Ghost = SOLID) -> None:
        self._root = None if ghost is SOLID else scene.add_frame(ghost.path, show_axes=False)
        self._scene, self._cell, self._full, self._ghost = scene, cell, full, ghost
        self._arms = {side: ArmFigure(scene, side, cell, full, ghost) for side in cell.mountings}
        self._object: viser.BoxHandle | None = None
        self._object_name, self._object_pose = "", np.full(7, np.inf)

    def set_visible(self, visible: bool) -> None:
        """Show a ghost, or nothing of it until arms are shown again."""
        if self._root is not None:
            self._root.visible = visible

    def show_arms(self, q: Array, sides: Sequence[str] | None = None) -> None:
        """Show the arms at `q`, (arms, 7) rad. sides: of these arms, None for the cell's: no others are shown."""
        self.set_visible(True)
        known = dict(zip(self._arms if sides is None else sides, q, strict=True))
        for side, arm in self._arms.items():
            arm.show(known.get(side))

    def show_object(self, name: str, pose: Array | None) -> None:
        """Show the object `name` at `pose`, (7,) position m and quaternion wxyz; None where it was not seen."""
        description = self._cell.objects.get(name)
        if pose is None or description is None:
            if self._object is not None:
                self._object.visible = False
                self._object_name = ""
            return
        if self._object is None or name != self._object_name:
            path, size, colour = f"{self._ghost.path}/object", self._ghost.size(description.size), self._ghost.colour
            self._object = self._scene.add_box(
                path, colour or _OBJECT_COLOUR, size, opacity=self._ghost.opacity or 0.92, cast_shadow=self._full
            )
            if colour is not None:
                add_edges(self._scene, f"{path}/edges", box_edges(size, np.zeros(3)), colour)
            self._object_name = name
            self._object_pose[:] = np.inf
        if (np.abs(pose - self._object_pose) > _SMALLEST_OBJECT_MOVE).any():
            self._object_pose[:] = pose
            self._object.position = pose[:3]
            self._object.wxyz = pose[3:]


def grown(size: tuple[float, float, float]) -> tuple[float, float, float]:
    """Return the size of a box whose faces are GROWN_M further out, m."""
    x, y, z = size
    return x + 2.0 * GROWN_M, y + 2.0 * GROWN_M, z + 2.0 * GROWN_M


def box_edges(size: tuple[float, float, float], centre: Array, yaw_rad: float = 0.0) -> NDArray:
    """Return the 12 edges (12, 2, 3), m, of a box, turned about z."""
    corners = np.array([[(k >> axis & 1) - 0.5 for axis in range(3)] for k in range(8)]) * size
    c, s = np.cos(yaw_rad), np.sin(yaw_rad)
    return (corners @ np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]]) + centre)[_EDGES]


def add_edges(
    scene: viser.SceneApi, path: str, pieces: Array, colour: tuple[int, int, int], width_px: float = 2.0
) -> viser.SceneNodeHandle:
    """Draw straight pieces (n, 2, 3), m, as lines of the same width at any distance."""
    points = pieces.astype(np.float32)
    return scene.add_line_segments(path, points, colour, thickness=width_px, thickness_units="screen")


def _add_parts(scene: viser.SceneApi, path: str, parts: list[Part], full: bool, ghost: Ghost) -> None:
    for number, part in enumerate(parts):
        scene.add_mesh_simple(
            f"{path}/part{number}", part.vertices, part.faces, color=ghost.colour or part.colour, opacity=ghost.opacity,
            flat_shading=False, cast_shadow=full, receive_shadow=full,
        )  # fmt: skip


class Force:
    """A force in the scene: an arrow from where it acts, with its newtons. width_m: of its shaft."""

    def __init__(
        self, scene: viser.SceneApi, path: str, colour: tuple[int, int, int], width_m: float, m_per_n: float,
        least_n: float, anchor: Literal["top-center", "bottom-center"], words: str = "{:.0f} N",
    ) -> None:  # fmt: skip
        self._m_per_n, self._least_n, self._words = m_per_n, least_n, words
        self._shown = np.full(6, np.inf)
        self._arrow = scene.add_arrows(
            path, np.zeros((1, 2, 3), np.float32), colour, shaft_radius=width_m / 2.0, head_radius=1.3 * width_m,
            head_length=0.035, visible=False,
        )  # fmt: skip
        self._label = scene.add_label(f"{path}/newtons", "", anchor=anchor, visible=False)

    def show(self, place: Array, force: Array) -> None:
        """Show a force (3,), N, on what is at (3,), m; nothing of one that is too small."""
        size, now = float(np.linalg.norm(force)), np.concatenate([place, force])
        self._arrow.visible = self._label.visible = size > self._least_n
        if size > self._least_n and (np.abs(now - self._shown) > _SMALLEST_FORCE).any():
            self._shown = now
            self._label.position = tip = place + self._m_per_n * force
            self._arrow.points = np.array([[place, tip]], np.float32)
            self._label.text = self._words.format(size)
