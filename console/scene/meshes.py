"""The arm's shape for drawing: meshes of the package example-robot-data where it is installed, else plain capsules.

Of its Collada files are read: triangles, one transform a node, one diffuse colour a material.
"""

import sysconfig
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import trimesh
from numpy.typing import NDArray

from hal.robots import RobotModel
from rtstack.log.viewers.solids import shapes_in

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
