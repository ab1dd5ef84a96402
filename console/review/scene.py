"""Scenes of the review: one server a detail draws the stage for all pages, arms and object for each page alone. A
page names itself by a key in its address (`view`), which our proxy hands on with the secret header.
"""

from collections import OrderedDict
from dataclasses import dataclass

import numpy as np
import viser
from numpy.typing import NDArray

from console.scene.scene import CellFigures, Ghost, add_stage
from console.scene.scenes import Detail, SceneServers
from console.scene.server import VIEW, SceneServer
from rtstack.model.cell_description import CellDescription

_CAMERA = (-2.5, 0.0, 1.75)  # further away than in the live scene: the frame is narrower
GHOST = Ghost("/ghost", (240, 228, 66))  # #F0E442, Okabe-Ito: of neither arm and of no mode
_REMEMBERED = 64  # pages whose last pose is kept for when their scene connects, or connects again


@dataclass(frozen=True, slots=True)
class Pose:
    """q (arms, 7) rad of the arms at `sides`, None: the cell's; the object's name and pose (7,), m, wxyz, if known."""

    q: NDArray[np.float64] | None
    object: str
    object_pose: NDArray[np.float64] | None
    sides: tuple[str, ...] | None = None


@dataclass(frozen=True, slots=True)
class Poses:
    """What a page's cursor points at: the log itself, and at the same moment another log as a ghost."""

    log: Pose
    ghost: Pose | None = None


class _Figures:
    """What moves in one page's scene. The ghost is drawn when it is first asked for."""

    def __init__(self, client: viser.ClientHandle, cell: CellDescription, full: bool) -> None:
        self._client, self._cell = client, cell
        self._log = CellFigures(client.scene, cell, full)
        self._ghost: CellFigures | None = None

    def show(self, poses: Poses) -> None:
        """Show both logs."""
        with self._client.atomic():
            _place(self._log, poses.log)
            if poses.ghost is not None and poses.ghost.q is not None:
                self._ghost = self._ghost or CellFigures(self._client.scene, self._cell, full=False, ghost=GHOST)
                _place(self._ghost, poses.ghost)
            elif self._ghost is not None:
                self._ghost.set_visible(False)


def _place(figures: CellFigures, pose: Pose) -> None:
    if pose.q is not None:
        figures.show_arms(pose.q, pose.sides)
    figures.show_object(pose.object, pose.object_pose)


class _ReviewServer:
    """The stage, and the figures of every page that looks at it."""

    def __init__(self, cell: CellDescription, detail: Detail, poses: OrderedDict[str, Poses]) -> None:
        self.server = SceneServer()
        self.close = self.server.close
        self._figures: dict[int, tuple[str, _Figures]] = {}
        full = detail is Detail.FULL
        add_stage(self.server.viser, cell, full)
        self.server.viser.initial_camera.position = _CAMERA

        @self.server.viser.on_client_connect
        async def _(client: viser.ClientHandle) -> None:
            view = VIEW.get()  # in the connection's own context: a callback in a thread would not have it
            figures = _Figures(client, cell, full)
            self._figures[client.client_id] = view, figures
            if view in poses:
                figures.show(poses[view])

        @self.server.viser.on_client_disconnect
        async def _(client: viser.ClientHandle) -> None:
            self._figures.pop(client.client_id, None)

    def show(self, view: str, poses: Poses) -> int:
        """Show poses to the pages of this key; return how many there are."""
        mine = [figures for key, figures in list(self._figures.values()) if key == view]
        for figures in mine:
            figures.show(poses)
        return len(mine)


class ReviewScenes(SceneServers):
    """The scenes of the review."""

    def __init__(self, cell: CellDescription) -> None:
        self._poses: OrderedDict[str, Poses] = OrderedDict()
        super().__init__(lambda detail: _ReviewServer(cell, detail, self._poses))

    def show(self, view: str, poses: Poses) -> int:
        """Show poses to the page of this key, now and when its scene connects; return how many show them now."""
        with self._lock:
            self._poses[view] = poses
            self._poses.move_to_end(view)
            while len(self._poses) > _REMEMBERED:
                self._poses.popitem(last=False)
            servers = list(self._made.values())
        return sum(server.show(view, poses) for server in servers)
