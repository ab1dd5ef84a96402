"""What is asked for, what the arms were told, and what the pads feel, in the scene: three things that are never one.

The gizmo and the wire pad are the request; the pad of the mode's colour is the filtered command, as the loop says it;
the arm itself is the measured robot. World frame.
"""

import numpy as np
import viser

from console.teleoperation.quaternion import conjugate, product
from console.teleoperation.teleop_input import TeleopInput
from console.teleoperation.teleop_view import Handles
from hal.arrays import Array
from rtstack.model.cell_description import CellDescription

_SIDES = ("left", "right")
_REQUEST_COLOUR = (236, 240, 244)
_REFUSED_COLOUR = (213, 94, 0)  # #D55E00, Okabe-Ito: stopping
_COMMAND_COLOUR = (204, 121, 167)  # #CC79A7, Okabe-Ito: teleoperation
_FORCE_COLOURS = ((86, 180, 233), (230, 159, 0))  # the arms'
_M_PER_N = 0.004  # of an arrow: 50 N are 0.2 m
_LEAST_N = 1.0
_SMALLEST_MOVE = 1e-4


class Gizmos:
    """Gizmo, wire pad, commanded pad and force arrow, with its newtons, of both arms."""

    def __init__(self, server: viser.ViserServer, cell: CellDescription, teleop: TeleopInput) -> None:
        scene = server.scene
        self._teleop = teleop
        self._upright: list[Array | None] = [None, None]  # the pad's orientation where its gizmo is along the world
        self._shown = np.full((2, 7), np.inf)
        self._told = np.full((2, 7), np.inf)
        self._forces = np.full((2, 3), np.inf)
        self._grips: list[viser.TransformControlsHandle] = []
        self._wires: list[viser.BoxHandle] = []
        self._requests: list[viser.FrameHandle] = []
        self._commands: list[viser.FrameHandle] = []
        self._arrows: list[viser.ArrowsHandle] = []
        self._newtons: list[viser.LabelHandle] = []
        for side, name in enumerate(_SIDES):
            size = cell.pads[side].size
            behind_face = (0.0, 0.0, -size[2] / 2.0)
            # arrows or rings, never both: where they cross, the ring would take the arrow's drag
            grip = scene.add_transform_controls(
                f"/grip/{name}", scale=0.22, line_width=4.0, depth_test=False, visible=False,
                disable_rotations=True, disable_sliders=True,
            )  # fmt: skip
            grip.on_update(self._follow(side))
            self._grips.append(grip)
            self._requests.append(scene.add_frame(f"/request/{name}", show_axes=False, visible=False))
            self._wires.append(
                scene.add_box(
                    f"/request/{name}/pad",
                    _REQUEST_COLOUR,
                    size,
                    wireframe=True,
                    position=behind_face,
                    cast_shadow=False,
                    receive_shadow=False,
                )
            )
            self._commands.append(scene.add_frame(f"/command/{name}", show_axes=False, visible=False))
            scene.add_box(
                f"/command/{name}/pad", _COMMAND_COLOUR, 1.04 * np.array(size), opacity=0.45,
                position=behind_face, cast_shadow=False, receive_shadow=False,
            )  # fmt: skip
            self._arrows.append(
                scene.add_arrows(
                    f"/force/{name}",
                    np.zeros((1, 2, 3), np.float32),
                    _FORCE_COLOURS[side],
                    shaft_radius=0.006,
                    head_radius=0.016,
                    head_length=0.035,
                    visible=False,
                )
            )

            self._newtons.append(scene.add_label(f"/force/{name}/newtons", "", anchor="top-center", visible=False))

    def _follow(self, side: int):
        async def moved(event: viser.TransformControlsEvent) -> None:
            upright = self._upright[side]
            if upright is not None:
                grip = np.concatenate([event.target.position, product(event.target.wxyz, upright)])
                self._teleop.drag(side, grip, event.phase)

        return moved

    def show(self, measured: Array | None, command: Array | None, forces: Array | None) -> None:
        """Show poses (2, 7) in the world, None where they are not known, and forces (2, 3), N, that the pads feel."""
        running = self._teleop.running and measured is not None
        turn = self._teleop.view.handles is Handles.TURN
        asked = self._teleop.asked() if running else None
        refused = self._teleop.view.refusal is not None
        for side in (0, 1):
            shown = asked is not None and command is not None
            for node in (self._grips[side], self._requests[side], self._commands[side]):
                if node.visible != shown:
                    node.visible = shown
            if self._grips[side].disable_axes != turn and not self._teleop.dragging(side):
                self._grips[side].disable_axes, self._grips[side].disable_rotations = turn, not turn
            if measured is not None and self._upright[side] is None:
                self._upright[side] = measured[side, 3:].copy()
            if asked is not None and command is not None:
                self._show_request(side, asked[side], refused)
                if np.abs(command[side] - self._told[side]).max() > _SMALLEST_MOVE:
                    self._told[side] = command[side]
                    self._commands[side].position, self._commands[side].wxyz = command[side, :3], command[side, 3:]
            if measured is not None and forces is not None:
                self._show_force(side, measured[side, :3], forces[side])

    def _show_request(self, side: int, pose: Array, refused: bool) -> None:
        upright = self._upright[side]
        colour = _REFUSED_COLOUR if refused else _REQUEST_COLOUR
        if tuple(self._wires[side].color) != colour:
            self._wires[side].color = colour
        if not self._teleop.dragging(side) and upright is not None:  # a pose that is set during a drag does not stick
            grip = self._grips[side]
            wxyz = product(pose[3:], conjugate(upright))
            if np.abs(grip.position - pose[:3]).max() > _SMALLEST_MOVE or np.abs(grip.wxyz - wxyz).max() > 1e-3:
                grip.position, grip.wxyz = pose[:3], wxyz
        if np.abs(pose - self._shown[side]).max() > _SMALLEST_MOVE:
            self._shown[side] = pose
            self._requests[side].position, self._requests[side].wxyz = pose[:3], pose[3:]

    def _show_force(self, side: int, position: Array, force: Array) -> None:
        arrow = self._arrows[side]
        size = float(np.linalg.norm(force))
        strong = size > _LEAST_N
        if arrow.visible != strong:
            arrow.visible = self._newtons[side].visible = strong
        if strong and np.abs(force - self._forces[side]).max() > 0.2:
            self._forces[side] = force
            tip = position + _M_PER_N * force
            arrow.points = np.array([[position, tip]], np.float32)
            self._newtons[side].position = tip
            if self._newtons[side].text != f"{size:.0f} N":
                self._newtons[side].text = f"{size:.0f} N"
