"""Scenes of the review: apart from the live one, so that a review never touches it, and each page sees its own cursor.

One server a detail draws the cell's stage for everybody; arms and object are drawn for each page alone. A page names
itself by a key in its address (`view`), which our proxy hands on with the secret header.
"""

import threading
from collections import OrderedDict
from dataclasses import dataclass

import numpy as np
import viser
from numpy.typing import NDArray

from console.scene import CellFigures, add_stage
from console.scene_server import VIEW, SceneServer
from console.scenes import Detail
from rtstack.model.cell_description import CellDescription

_CAMERA = (-2.5, 0.0, 1.75)  # further away than in the live scene: the frame is narrower
_REMEMBERED = 64  # pages whose last pose is kept for when their scene connects, or connects again


@dataclass(frozen=True, slots=True)
class Pose:
    """Where everything is: q (2, 7) rad, the object's name, its pose (7,) m and wxyz; None: not known."""

    q: NDArray[np.float64] | None
    object: str
    object_pose: NDArray[np.float64] | None


class _ReviewServer:
    """The stage, and the figures of every page that looks at it."""

    def __init__(self, cell: CellDescription, detail: Detail, poses: OrderedDict[str, Pose]) -> None:
        self.server = SceneServer()
        self._cell = cell
        self._full = detail is Detail.FULL
        self._poses = poses
        self._figures: dict[int, tuple[str, viser.ClientHandle, CellFigures]] = {}
        add_stage(self.server.viser, cell, self._full)
        self.server.viser.initial_camera.position = _CAMERA

        @self.server.viser.on_client_connect
        async def _(client: viser.ClientHandle) -> None:
            view = VIEW.get()  # in the connection's own context: a callback in a thread would not have it
            figures = CellFigures(client.scene, self._cell, self._full)
            self._figures[client.client_id] = view, client, figures
            if view in self._poses:
                _show(client, figures, self._poses[view])

        @self.server.viser.on_client_disconnect
        async def _(client: viser.ClientHandle) -> None:
            self._figures.pop(client.client_id, None)

    def show(self, view: str, pose: Pose) -> int:
        """Show a pose to the pages of this key; return how many there are."""
        shown = 0
        for key, client, figures in list(self._figures.values()):
            if key == view:
                _show(client, figures, pose)
                shown += 1
        return shown


def _show(client: viser.ClientHandle, figures: CellFigures, pose: Pose) -> None:
    with client.atomic():
        if pose.q is not None:
            figures.show_arms(pose.q)
        figures.show_object(pose.object, pose.object_pose)


class ReviewScenes:
    """The scenes by their detail, made when they are first looked at. May be used from any thread."""

    def __init__(self, cell: CellDescription) -> None:
        self._cell = cell
        self._lock = threading.Lock()
        self._servers: dict[Detail, _ReviewServer] = {}
        self._poses: OrderedDict[str, Pose] = OrderedDict()

    def server(self, detail: Detail) -> SceneServer:
        """Return the server of a scene; the first call makes it."""
        with self._lock:
            if detail not in self._servers:
                self._servers[detail] = _ReviewServer(self._cell, detail, self._poses)
            return self._servers[detail].server

    def show(self, view: str, pose: Pose) -> int:
        """Show a pose to the page of this key, now and when its scene connects; return how many show it now."""
        with self._lock:
            self._poses[view] = pose
            self._poses.move_to_end(view)
            while len(self._poses) > _REMEMBERED:
                self._poses.popitem(last=False)
            servers = list(self._servers.values())
        return sum(server.show(view, pose) for server in servers)

    def close(self) -> None:
        """End all scenes."""
        with self._lock:
            for server in self._servers.values():
                server.server.close()
            self._servers.clear()
