"""A camera of the simulated cell: it draws arms and object as the loop has seen them, beside the plant's process.

A picture is of one tick, and its time is that tick's. Where drawing is slower than the robot, pictures are left out.
"""

import os
from collections import deque

import numpy as np
from numpy.typing import NDArray

from rtstack.cameras.source import CameraRequest

_BEHIND = 300  # pictures that may wait to be drawn
_LIGHT = 0.4  # from everywhere: what faces away from the camera is seen too
_COLOURS = {"table": (0.45, 0.36, 0.28), "object": (0.9, 0.62, 0.0)}  # the scene's own are all one grey
State = tuple[int, NDArray[np.float64], NDArray[np.float64] | None]  # t_ns, q (arms, 7), object's pose (7,)


class SimulatedCamera:
    """A Camera. Raises OSError where nothing can be drawn here."""

    def __init__(self, request: CameraRequest) -> None:
        os.environ.setdefault("MUJOCO_GL", "egl")
        import mujoco

        from sim_robot.lab_objects import with_lab_objects
        from sim_robot.plant import Plant
        from sim_robot.plant_parameters import load_plant_parameters
        from sim_robot.scene import NO_OBJECT, load_scene

        camera = self._camera = request.camera
        scene = with_lab_objects(load_scene(), request.cell_file)
        plant = Plant.nominal(scene, load_plant_parameters(), request.object_name or NO_OBJECT)
        self._mujoco, self._model, self._data = mujoco, plant.model, plant.data
        self._model.vis.global_.fovy = camera.fov_y_deg
        self._model.vis.quality.offsamples = 0  # smooth edges take three quarters of the time without a graphics card
        self._model.vis.headlight.ambient[:] = _LIGHT
        for name, colour in _COLOURS.items():
            of_name = mujoco.mj_name2id(plant.model, mujoco.mjtObj.mjOBJ_GEOM, name)
            if of_name >= 0:
                plant.model.geom_rgba[of_name, :3] = colour
        self._model.vis.global_.offwidth, self._model.vis.global_.offheight = camera.width, camera.height
        try:
            self._renderer = mujoco.Renderer(plant.model, camera.height, camera.width)
        except Exception as error:  # mujoco raises what its GL backend raises
            raise OSError(f"no pictures can be drawn here (MUJOCO_GL={os.environ['MUJOCO_GL']}): {error}") from None
        self._period_ns = round(1e9 / camera.rate_hz)
        self._readers = [request.rings.reader(f"/{side}/arm") for side in scene.sides]
        self._object = request.rings.reader("/object/pose")
        self._held = [reader.drain() for reader in (*self._readers, self._object)]
        if (pose := self._object.latest()) is not None:  # of a run that has begun
            self._held[-1] = pose
        self._due_ns: int | None = None
        self._waiting: deque[State] = deque(maxlen=_BEHIND)

    def read(self) -> tuple[int, NDArray[np.uint8]] | None:
        self._take()
        if not self._waiting:
            return None
        t_ns, q, pose = self._waiting.popleft()
        data, n = self._data, q.size
        data.qpos[:n] = q.ravel()
        if pose is not None:
            data.qpos[n : n + 7] = pose
        self._mujoco.mj_kinematics(self._model, data)
        self._mujoco.mj_comPos(self._model, data)
        self._mujoco.mj_camlight(self._model, data)
        self._renderer.update_scene(data)
        self._look(self._renderer.scene)
        return t_ns, self._renderer.render().copy()

    def _look(self, scene: object) -> None:
        """Put both eyes of the scene where the camera is."""
        x, y, z, qw, qx, qy, qz = self._camera.pose
        rotation = np.zeros(9)
        self._mujoco.mju_quat2Mat(rotation, np.array([qw, qx, qy, qz]))
        R = rotation.reshape(3, 3)
        half = np.tan(np.radians(self._camera.fov_y_deg) / 2.0)
        for eye in scene.camera:  # type: ignore[attr-defined]
            eye.pos[:], eye.forward[:], eye.up[:] = (x, y, z), R[:, 2], -R[:, 1]
            near = eye.frustum_near
            eye.frustum_bottom, eye.frustum_top = -near * half, near * half
            eye.frustum_center, eye.frustum_width = 0.0, 0.0

    def _take(self) -> None:
        """Take the ticks that are due from what the loop has said since."""
        readers = (*self._readers, self._object)
        self._held = [np.concatenate([old, reader.drain()]) for old, reader in zip(self._held, readers, strict=True)]
        *arms, seen = self._held
        if not all(map(len, arms)):
            return
        first = arms[0]["t_ns"]
        self._due_ns = int(first[0]) if self._due_ns is None else self._due_ns
        until_ns = min(int(arm["t_ns"][-1]) for arm in arms)
        while self._due_ns <= until_ns:
            t_ns = int(first[np.searchsorted(first, self._due_ns)])
            known = int(np.searchsorted(seen["t_ns"], t_ns, side="right")) - 1
            pose = None
            if known >= 0 and seen["seen"][known]:
                pose = np.concatenate([seen["position"][known], seen["orientation_wxyz"][known]])
            self._waiting.append((t_ns, np.stack([_at(arm, t_ns)["q"] for arm in arms]), pose))
            self._due_ns += self._period_ns
        keep_ns = self._due_ns - self._period_ns
        self._held = [each[max(0, int(np.searchsorted(each["t_ns"], keep_ns)) - 1) :] for each in self._held]

    def close(self) -> None:
        self._renderer.close()


def _at(records: NDArray[np.void], t_ns: int) -> np.void:
    """Return the first record from this time on, or the last one."""
    return records[min(int(np.searchsorted(records["t_ns"], t_ns)), len(records) - 1)]
