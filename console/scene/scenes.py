"""The scenes behind the page: the same cell with full and with light meshes, made when they are first looked at."""

import threading
from collections.abc import Callable
from enum import StrEnum
from typing import Any

import numpy as np
import viser

from console.live.watch import Watch
from console.questions.questions import Questions
from console.scene.experiment import ExperimentFigures, TrialPlans
from console.scene.ghost import GhostPlayer
from console.scene.scene import COLOURS, CellFigures, Force, Ghost, add_stage
from console.scene.server import SceneServer
from console.teleoperation.quaternion import conjugate, product
from console.teleoperation.teleop_input import TeleopInput
from console.teleoperation.teleop_view import Handles
from hal.base.arrays import Array
from rtstack.model.cell_description import CellDescription

_REQUEST_COLOUR = (236, 240, 244)
_REFUSED_COLOUR = (213, 94, 0)  # #D55E00, Okabe-Ito: stopping
_COMMAND_COLOUR = (204, 121, 167)  # #CC79A7, Okabe-Ito: teleoperation
_M_PER_N = 0.004  # of an arrow: 50 N are 0.2 m
_LEAST_N = 1.0
_SMALLEST_MOVE = 1e-4


class _Hand:
    """Gizmo, wire pad, commanded pad and force arrow, with its newtons, of one arm."""

    def __init__(self, scene: viser.SceneApi, cell: CellDescription, side: int, teleop: TeleopInput) -> None:
        """side: place of its arm in the arrays."""
        self._teleop, self._side, name = teleop, side, cell.sides[side]
        self._upright: Array | None = None  # the pad's orientation where its gizmo is along the world
        self._shown, self._told = np.full(7, np.inf), np.full(7, np.inf)
        size = cell.pads[side].size
        behind_face = (0.0, 0.0, -size[2] / 2.0)
        # arrows or rings, never both: where they cross, the ring would take the arrow's drag
        self._grip = scene.add_transform_controls(
            f"/grip/{name}", scale=0.22, line_width=4.0, depth_test=False, visible=False,
            disable_rotations=True, disable_sliders=True,
        )  # fmt: skip
        self._grip.on_update(self._moved)
        self._request = scene.add_frame(f"/request/{name}", show_axes=False, visible=False)
        self._wire = scene.add_box(
            f"/request/{name}/pad", _REQUEST_COLOUR, size, wireframe=True,
            position=behind_face, cast_shadow=False, receive_shadow=False,
        )  # fmt: skip
        self._command = scene.add_frame(f"/command/{name}", show_axes=False, visible=False)
        scene.add_box(
            f"/command/{name}/pad", _COMMAND_COLOUR, 1.04 * np.array(size), opacity=0.45,
            position=behind_face, cast_shadow=False, receive_shadow=False,
        )  # fmt: skip
        self._force = Force(scene, f"/force/{name}", COLOURS[name], 0.012, _M_PER_N, _LEAST_N, "top-center")

    async def _moved(self, event: viser.TransformControlsEvent) -> None:
        if self._upright is not None:
            grip = np.concatenate([event.target.position, product(event.target.wxyz, self._upright)])
            self._teleop.drag(self._side, grip, event.phase)

    def show_handles(self, shown: bool, turn: bool) -> None:
        """Show gizmo, request and command, or hide them. turn: with rings, not arrows."""
        for node in (self._grip, self._request, self._command):
            node.visible = shown
        if self._grip.disable_axes != turn and not self._teleop.dragging(self._side):
            self._grip.disable_axes, self._grip.disable_rotations = turn, not turn

    def show_measured(self, pose: Array, force: Array | None) -> None:
        """Take where the pad is, (7,), and show what it feels, (3,) N."""
        if self._upright is None:
            self._upright = pose[3:].copy()
        if force is not None:
            self._force.show(pose[:3], force)

    def show(self, pose: Array, refused: bool, command: Array) -> None:
        """Show what is asked of the arm, and where it is told to be, (7,) each."""
        if np.abs(command - self._told).max() > _SMALLEST_MOVE:
            self._told = command
            self._command.position, self._command.wxyz = command[:3], command[3:]
        self._wire.color = _REFUSED_COLOUR if refused else _REQUEST_COLOUR
        # a pose that is set during a drag does not stick
        if not self._teleop.dragging(self._side) and self._upright is not None:
            grip, wxyz = self._grip, product(pose[3:], conjugate(self._upright))
            if np.abs(grip.position - pose[:3]).max() > _SMALLEST_MOVE or np.abs(grip.wxyz - wxyz).max() > 1e-3:
                grip.position, grip.wxyz = pose[:3], wxyz
        if np.abs(pose - self._shown).max() > _SMALLEST_MOVE:
            self._shown = pose
            self._request.position, self._request.wxyz = pose[:3], pose[3:]


class Gizmos:
    """What is drawn of each arm's hand, in the world: what is asked for (gizmo and wire pad), what the arm was told
    (the pad of the mode's colour: the filtered command), and what the pad feels.
    """

    def __init__(self, server: viser.ViserServer, cell: CellDescription, teleop: TeleopInput) -> None:
        self._teleop = teleop
        self._hands = [_Hand(server.scene, cell, side, teleop) for side in range(len(cell.arms))]

    def show(self, measured: Array | None, command: Array | None, forces: Array | None) -> None:
        """Show poses (arms, 7) in the world, None where they are not known, and forces (arms, 3), N, on the pads."""
        view = self._teleop.view
        asked = self._teleop.asked() if self._teleop.running and measured is not None else None
        for side, hand in enumerate(self._hands):
            hand.show_handles(asked is not None and command is not None, view.handles is Handles.TURN)
            if measured is not None:
                hand.show_measured(measured[side], None if forces is None else forces[side])
            if asked is not None and command is not None:
                hand.show(asked[side], view.refusal is not None, command[side])


_GHOST = Ghost("/ghost", (204, 214, 224))  # neither an arm's colour nor the other log's of the review


class Detail(StrEnum):
    """How much is drawn: everything, or what software rendering can bear."""

    FULL = "full"
    LIGHT = "light"


class _LiveScene:
    """One scene, its server, and the thread that keeps it up to date while it is shown."""

    def __init__(
        self, cell: CellDescription, watch: Watch, teleop: TeleopInput, plans: TrialPlans, ghost: GhostPlayer,
        detail: Detail,
    ) -> None:  # fmt: skip
        self.server, full = SceneServer(), detail is Detail.FULL
        scene = self.server.viser.scene
        add_stage(self.server.viser, cell, full)
        self._scene, self._gizmos = CellFigures(scene, cell, full), Gizmos(self.server.viser, cell, teleop)
        self._experiment = ExperimentFigures(scene, cell)
        self._watch, self._plans, self._player = watch, plans, ghost
        self._ghost = CellFigures(scene, cell, full=False, ghost=_GHOST)  # before it is needed
        self._ghost.set_visible(False)
        self._frame_s = 1.0 / 30.0 if full else 1.0 / 20.0  # how often it is brought up to date
        self._ending = threading.Event()
        self._thread = threading.Thread(target=self._follow, daemon=True, name=f"scene {detail}")
        self._thread.start()

    def close(self) -> None:
        self._ending.set()
        self._thread.join()
        self.server.close()

    def _follow(self) -> None:
        while not self._ending.wait(self._frame_s):
            if not self.server.viser.get_clients():
                continue  # no page shows it
            status = self._watch.view.status
            with self.server.viser.atomic():
                if (q := self._watch.q()) is not None:
                    self._scene.show_arms(q)
                if status is not None:
                    self._scene.show_object(status.object, self._watch.object_pose())
                self._experiment.show(*self._plans.current(status))
                self._experiment.show_hits(self._watch.hits())
                if (shown := self._player.pose()) is None:
                    self._ghost.set_visible(False)
                else:
                    self._ghost.show_arms(shown[0])
                    self._ghost.show_object(*shown[1:])
                self._gizmos.show(self._watch.measured(), self._watch.command(), self._watch.forces())


class SceneServers:
    """One scene of each detail, made when it is first looked at. May be used from any thread."""

    def __init__(self, make: Callable[[Detail], Any]) -> None:
        """make: returns a scene, which has `server` and `close`."""
        self._make, self._lock = make, threading.Lock()
        self._made: dict[Detail, Any] = {}

    def server(self, detail: Detail) -> SceneServer:
        """Return the server of a scene; the first call makes it, which takes a second or two for the full one."""
        with self._lock:
            if detail not in self._made:
                self._made[detail] = self._make(detail)
            return self._made[detail].server

    def close(self) -> None:
        """End all scenes."""
        with self._lock:
            for scene in self._made.values():
                scene.close()
            self._made.clear()


class Scenes(SceneServers):
    """The live scenes. plans: the trial that they show; ghost: what does not take place."""

    def __init__(
        self, cell: CellDescription, watch: Watch, teleop: TeleopInput, questions: Questions, ghost: GhostPlayer
    ) -> None:  # fmt: skip
        self.plans, self.ghost = TrialPlans(questions), ghost
        super().__init__(lambda detail: _LiveScene(cell, watch, teleop, self.plans, ghost, detail))
