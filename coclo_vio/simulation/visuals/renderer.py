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

from coclo_vio.simulation.visuals.cameras import camera_id, camera_twist, image_size, place
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
    """

    image: ByteImage
    inverse_depth: FloatImage
    twist: Array


class SceneRenderer:
    """Renders a model; holds one OpenGL context: close it, or use it in a ``with``."""

    def __init__(self, model: mujoco.MjModel) -> None:
        self.model = model
        self._data = mujoco.MjData(model)
        self._option = mujoco.MjvOption()
        self._scene = mujoco.MjvScene(model, maxgeom=_MOST_GEOMS)
        self._scene.flags[mujoco.mjtRndFlag.mjRND_SHADOW] = 0
        self._scene.flags[mujoco.mjtRndFlag.mjRND_REFLECTION] = 0
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

    def place(self, qpos: Array, qvel: Array) -> None:
        """Set the model's state to ``qpos`` (nq,) and ``qvel`` (nv,)."""
        place(self.model, self._data, qpos, qvel)

    def draw(self, side: int) -> CameraView:
        """The view of the left (0) or right (1) camera."""
        camera = mujoco.MjvCamera()
        camera.type = mujoco.mjtCamera.mjCAMERA_FIXED
        camera.fixedcamid = camera_id(self.model, side)
        everything = mujoco.mjtCatBit.mjCAT_ALL
        mujoco.mjv_updateScene(self.model, self._data, self._option, None, camera, everything, self._scene)
        width, height = image_size(self.model, side)
        area = mujoco.MjrRect(0, 0, width, height)
        colour = np.empty((height, width, 3), dtype=np.uint8)
        depth = np.empty((height, width), dtype=np.float32)
        self._gl.make_current()
        mujoco.mjr_render(area, self._scene, self._context)
        mujoco.mjr_readPixels(colour, depth, area, self._context)
        image = cv2.flip(cv2.cvtColor(colour, cv2.COLOR_RGB2GRAY), 0)
        return CameraView(
            np.asarray(image), self._inverse_depth(np.flipud(depth)), camera_twist(self.model, self._data, side)
        )

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
