"""What a camera over the cell sees of a tag on its object, drawn by MuJoCo without a window (Debian's libegl1)."""

import cv2
import mujoco
import numpy as np

from hal.tracker import TagCamera
from sim_robot.arm_description import JOINTS, arm_description
from sim_robot.model import cell_spec
from sim_robot.scene import load_scene
from tests.support.trackers.tags import texture

_THICK_M = 1e-3  # of the paper that the tag is printed on
OBJECT = "rice_box"


class RenderedCell:
    """The simulated cell with a tag on top of its object, and a camera at `eye`, T_world_camera (4, 4), optical."""

    def __init__(self, camera: TagCamera, eye: np.ndarray, number: int) -> None:
        from mujoco.egl import GLContext

        scene = load_scene()
        arms = tuple(arm_description(place.robot) for place in scene.arms)
        spec = cell_spec(scene, OBJECT, scene.place(OBJECT, 0.0, (0.35, -0.35), None), arms)
        (width, height), half = camera.size, 0.75 * camera.tag_size  # with its white margin
        self.top_m = scene.objects[OBJECT].size[2] / 2.0 + _THICK_M  # of the tag over the object's middle
        spec.body("object").add_geom(
            name="tag", type=mujoco.mjtGeom.mjGEOM_BOX, pos=(0.0, 0.0, self.top_m - _THICK_M / 2),
            size=(half, half, _THICK_M / 2), material="tag", mass=0.0, contype=0, conaffinity=0,
        )  # fmt: skip
        spec.worldbody.add_light(
            pos=(0.0, 0.0, 3.0), dir=(0.0, 0.0, -1.0), type=mujoco.mjtLightType.mjLIGHT_DIRECTIONAL,
            ambient=(0.5, 0.5, 0.5), diffuse=(0.3, 0.3, 0.3),
        )  # fmt: skip
        fovy = float(np.degrees(2.0 * np.arctan(height / 2.0 / camera.focal[1])))
        turned = np.zeros(4)
        mujoco.mju_mat2Quat(turned, (eye[:3, :3] * (1.0, -1.0, -1.0)).ravel())  # MuJoCo's looks along -z, y up
        spec.worldbody.add_camera(name="eye", pos=eye[:3, 3], quat=turned, fovy=fovy)
        _, drawing = cv2.imencode(".png", texture(camera, number))
        spec.assets = {"tag.png": drawing.tobytes()}
        spec.add_texture(name="tag", type=mujoco.mjtTexture.mjTEXTURE_2D, file="tag.png")
        material = spec.add_material(name="tag", texuniform=False, specular=0.0, reflectance=0.0)
        material.textures[mujoco.mjtTextureRole.mjTEXROLE_RGB] = "tag"
        for name in ("ambient", "diffuse", "specular"):
            setattr(spec.visual.headlight, name, (0.0, 0.0, 0.0))
        spec.visual.global_.offwidth, spec.visual.global_.offheight = width, height
        self.model = spec.compile()
        self.data = mujoco.MjData(self.model)
        self._context = GLContext(width, height)
        self._context.make_current()
        self._scene = mujoco.MjvScene(self.model, 1000)
        self._drawn = mujoco.MjrContext(self.model, mujoco.mjtFontScale.mjFONTSCALE_100)
        self._eye, self._pixels = mujoco.MjvCamera(), np.zeros((height, width, 3), np.uint8)
        self._eye.type, self._eye.fixedcamid = mujoco.mjtCamera.mjCAMERA_FIXED, self.model.camera("eye").id

    def picture(self, position: np.ndarray, wxyz: np.ndarray, q: np.ndarray | None = None) -> np.ndarray:
        """Return the picture, grey, (height, width), with the object at a pose in the world, m, and the arms at q
        (2, 7), rad: where they hide the tag, it is hidden."""
        qpos = self.data.qpos
        if q is not None:
            qpos[: 2 * JOINTS] = q.ravel()
        qpos[2 * JOINTS : 2 * JOINTS + 3], qpos[2 * JOINTS + 3 :] = position, wxyz
        mujoco.mj_forward(self.model, self.data)
        height, width, _ = self._pixels.shape
        mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN, self._drawn)
        mujoco.mjv_updateScene(
            self.model, self.data, mujoco.MjvOption(), None, self._eye, mujoco.mjtCatBit.mjCAT_ALL, self._scene
        )
        view = mujoco.MjrRect(0, 0, width, height)
        mujoco.mjr_render(view, self._scene, self._drawn)
        mujoco.mjr_readPixels(self._pixels, None, view, self._drawn)
        return cv2.cvtColor(np.ascontiguousarray(self._pixels[::-1]), cv2.COLOR_RGB2GRAY)

    def close(self) -> None:
        """Free what draws."""
        self._drawn.free()
        self._context.free()
