# SPDX-License-Identifier: BSD-3-Clause
"""Renders a MuJoCo model from its two cameras in one process; the only module that renders.

``MUJOCO_GL`` must be set before MuJoCo is first imported; ``stereo_renderer`` sets it.
"""

from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Final, Self

import cv2
import mujoco
import numpy as np
import numpy.typing as npt

from coclo_vio.simulation.visuals.bareness import BARE_GROUP, TEXTURED_GROUP
from coclo_vio.simulation.visuals.cameras import camera_id, camera_pose, camera_twist, image_size, place
from coclo_vio.simulation.visuals.moving import place_walkers
from coclo_vio.simulation.visuals.opengl import RenderingError
from coclo_vio.values.arrays import Array, ByteImage

FloatImage = npt.NDArray[np.float32]

_MOST_GEOMS: Final = 5000


@dataclass(frozen=True, slots=True, eq=False)
class CameraView:
    """The rendered view of one camera, before the imager's model.

    Attributes:
        image: light reflected by the scene times 255, (rows, columns).
        inverse_depth: one over the depth along the optical axis, 1/m, (rows, columns), float32.
        twist: angular (rad/s) and linear (m/s) velocity of the camera in its own optical frame, (6,).
        T_world_camera: pose of the camera, optical axes, (4, 4).
        T_world_body: pose of the robot, (4, 4).
    """

    image: ByteImage
    inverse_depth: FloatImage
    twist: Array
    T_world_camera: Array
    T_world_body: Array


class SceneRenderer:
    """Renders a model; holds one OpenGL context: close it, or use it in a ``with``."""

    def __init__(self, model: mujoco.MjModel) -> None:
        self.model = model
        self._data = mujoco.MjData(model)
        self._option = mujoco.MjvOption()
        self._scene = mujoco.MjvScene(model, maxgeom=_MOST_GEOMS)
        self._scene.flags[mujoco.mjtRndFlag.mjRND_SHADOW] = 0
        self._scene.flags[mujoco.mjtRndFlag.mjRND_REFLECTION] = int((model.mat_reflectance > 0.0).any())
        self._scene.flags[mujoco.mjtRndFlag.mjRND_SKYBOX] = 0
        self._gl = mujoco.GLContext(int(model.vis.global_.offwidth), int(model.vis.global_.offheight))
        self._gl.make_current()
        self._context = mujoco.MjrContext(model, mujoco.mjtFontScale.mjFONTSCALE_100)
        mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN, self._context)
        self._context.readDepthMap = mujoco.mjtDepthMap.mjDEPTH_ZEROFAR

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """Free the context, in the order that OpenGL requires; nothing can be rendered afterwards."""
        if self._gl is not None:
            self._gl.make_current()
            self._context.free()
            self._gl.free()
            self._gl = None

    def place(self, qpos: Array, qvel: Array, time_s: float = 0.0) -> None:
        """Set the model's state to ``qpos`` (nq,) and ``qvel`` (nv,), and what moves by itself to ``time_s``."""
        place_walkers(self.model, self._data, time_s)
        place(self.model, self._data, qpos, qvel)

    def draw(self, side: int, bareness: float = 0.0) -> CameraView:
        """The view of the left (0) or right (1) camera.

        Args:
            side: of the camera.
            bareness: share of the bare surfaces in the image, in a model that has them.
        """
        image, depth = self._rendered(side)
        if bareness > 0.0:
            bare, _ = self._rendered(side, is_bare=True)
            image = np.asarray(cv2.addWeighted(image, 1.0 - bareness, bare, bareness, 0.0), dtype=np.uint8)
        body = np.eye(4)
        body[:3, :3], body[:3, 3] = self._data.xmat[1].reshape(3, 3), self._data.xpos[1]
        twist = camera_twist(self.model, self._data, side)
        return CameraView(image, self._inverse_depth(depth), twist, camera_pose(self.model, self._data, side), body)

    def _rendered(self, side: int, *, is_bare: bool = False) -> tuple[ByteImage, FloatImage]:
        """Grey image and depth buffer, (rows, columns)."""
        camera = mujoco.MjvCamera()
        camera.type = mujoco.mjtCamera.mjCAMERA_FIXED
        camera.fixedcamid = camera_id(self.model, side)
        self._option.geomgroup[TEXTURED_GROUP], self._option.geomgroup[BARE_GROUP] = not is_bare, is_bare
        everything = mujoco.mjtCatBit.mjCAT_ALL
        mujoco.mjv_updateScene(self.model, self._data, self._option, None, camera, everything, self._scene)
        width, height = image_size(self.model, side)
        area = mujoco.MjrRect(0, 0, width, height)
        colour = np.empty((height, width, 3), dtype=np.uint8)
        depth = np.empty((height, width), dtype=np.float32)
        self._gl.make_current()
        mujoco.mjr_render(area, self._scene, self._context)
        mujoco.mjr_readPixels(colour, depth, area, self._context)
        return np.asarray(cv2.flip(cv2.cvtColor(colour, cv2.COLOR_RGB2GRAY), 0)), np.flipud(depth)

    def _inverse_depth(self, buffer: FloatImage) -> FloatImage:
        """1/z of MuJoCo's depth buffer, which is 1 at the near and 0 at the far plane and linear in 1/z."""
        near = self.model.vis.map.znear * self.model.stat.extent
        far = self.model.vis.map.zfar * self.model.stat.extent
        return buffer * np.float32(1.0 / near - 1.0 / far) + np.float32(1.0 / far)


def load_model(path: Path) -> mujoco.MjModel:
    """A model from MuJoCo's binary (.mjb) or XML file.

    Raises:
        RenderingError: there is no such file, or MuJoCo cannot read it.
    """
    if not path.is_file():  # MuJoCo would write a log file into the working directory
        raise RenderingError(f"there is no model file {path}")
    try:
        if path.suffix == ".mjb":
            return mujoco.MjModel.from_binary_path(str(path))
        return mujoco.MjModel.from_xml_path(str(path))
    except ValueError as error:
        raise RenderingError(f"MuJoCo cannot read the model {path}: {error}") from error
