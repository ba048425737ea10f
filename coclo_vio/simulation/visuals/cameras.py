# SPDX-License-Identifier: BSD-3-Clause
"""The stereo pair as cameras of the MuJoCo model: frames and lens are converted in this module only.

A calibration's camera is x right, y down, z forward; MuJoCo's is x right, y up and looks along -z. Its image of W x H
pixels has the principal point ((W - 1) / 2, (H - 1) / 2), measured with rendered points.
"""

from typing import Final

import mujoco
import numpy as np

from coclo_vio.simulation.visuals.opengl import RenderingError
from coclo_vio.values.arrays import Array
from coclo_vio.values.calibration import CameraCalibration, StereoCalibration
from coclo_vio.values.errors import ConfigError

CAMERA_NAMES: Final = ("left_camera", "right_camera")
OPTICAL_FROM_MUJOCO: Final = np.diag([1.0, -1.0, -1.0])  # turns MuJoCo's camera axes into optical ones, and back
_SAME_PX = 1e-6


def add_cameras(spec: mujoco.MjSpec, stereo: StereoCalibration, body: str = "base") -> None:
    """Add the cameras ``left_camera`` and ``right_camera`` to a body, and make the off-screen image large enough.

    Raises:
        ConfigError: there is no such body, or a lens is not the one that MuJoCo renders: a pinhole of square
            pixels without distortion whose axis meets the middle of the image.
    """
    carrier = spec.body(body)
    if carrier is None:
        names = ", ".join(sorted(each.name for each in spec.bodies))
        raise ConfigError(f"the model has no body {body!r} to carry the cameras; its bodies are: {names}")
    lenses = (stereo.left, stereo.right)
    mountings = (stereo.T_body_left_camera, stereo.T_body_right_camera)
    for name, lens, T_body_camera in zip(CAMERA_NAMES, lenses, mountings, strict=True):
        _check_lens(name, lens)
        carrier.add_camera(
            name=name,
            pos=T_body_camera[:3, 3],
            quat=_quat_wxyz(T_body_camera[:3, :3] @ OPTICAL_FROM_MUJOCO),
            fovy=np.rad2deg(2.0 * np.arctan(0.5 * lens.height_px / lens.focal_px[1])),
            resolution=[lens.width_px, lens.height_px],
        )
    offscreen = spec.visual.global_
    offscreen.offwidth = max(lens.width_px for lens in lenses)
    offscreen.offheight = max(lens.height_px for lens in lenses)


def pinhole(width_px: int, height_px: int, focal_px: float) -> CameraCalibration:
    """The calibration of MuJoCo's lens."""
    centre = (0.5 * (width_px - 1), 0.5 * (height_px - 1))
    return CameraCalibration(
        width_px=width_px, height_px=height_px, focal_px=(focal_px, focal_px), principal_point_px=centre
    )


def camera_id(model: mujoco.MjModel, side: int) -> int:
    """MuJoCo's number of the left (0) or right (1) camera.

    Raises:
        RenderingError: the model has no such camera.
    """
    found = int(mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_CAMERA, CAMERA_NAMES[side]))
    if found < 0:
        raise RenderingError(f"the model has no camera {CAMERA_NAMES[side]!r}; add the pair with add_cameras first")
    return found


def image_size(model: mujoco.MjModel, side: int) -> tuple[int, int]:
    """Width and height of the left (0) or right (1) camera's image, px."""
    width, height = model.cam_resolution[camera_id(model, side)]
    return int(width), int(height)


def focal_px(model: mujoco.MjModel, side: int) -> float:
    """Focal length of the left (0) or right (1) camera, px."""
    fovy_deg = model.cam_fovy[camera_id(model, side)]
    return 0.5 * image_size(model, side)[1] / float(np.tan(0.5 * np.deg2rad(fovy_deg)))


def place(model: mujoco.MjModel, data: mujoco.MjData, qpos: Array, qvel: Array) -> None:
    """Set the model's state to ``qpos`` (nq,) and ``qvel`` (nv,), as far as the cameras need it."""
    data.qpos[:] = qpos
    data.qvel[:] = qvel
    mujoco.mj_kinematics(model, data)
    mujoco.mj_comPos(model, data)
    mujoco.mj_comVel(model, data)
    mujoco.mj_camlight(model, data)


def camera_twist(model: mujoco.MjModel, data: mujoco.MjData, side: int) -> Array:
    """Angular (rad/s) and linear (m/s) velocity of a camera in its own optical frame, after ``place``, (6,)."""
    twist = np.empty(6)
    mujoco.mj_objectVelocity(model, data, mujoco.mjtObj.mjOBJ_CAMERA, camera_id(model, side), twist, 1)
    return np.concatenate((OPTICAL_FROM_MUJOCO @ twist[:3], OPTICAL_FROM_MUJOCO @ twist[3:]))


def camera_pose(model: mujoco.MjModel, data: mujoco.MjData, side: int) -> Array:
    """Pose of a camera, optical axes, in the world, after ``place``, (4, 4)."""
    pose, index = np.eye(4), camera_id(model, side)
    pose[:3, :3] = data.cam_xmat[index].reshape(3, 3) @ OPTICAL_FROM_MUJOCO
    pose[:3, 3] = data.cam_xpos[index]
    return pose


def _check_lens(name: str, lens: CameraCalibration) -> None:
    ideal = pinhole(lens.width_px, lens.height_px, lens.focal_px[1])
    same = np.allclose(lens.focal_px + lens.principal_point_px, ideal.focal_px + ideal.principal_point_px, 0, _SAME_PX)
    if lens.distortion != "none" or not same:
        raise ConfigError(
            f"{name}: the renderer has a pinhole with fx = fy and the principal point {ideal.principal_point_px} px, "
            f"got focal_px {lens.focal_px}, principal_point_px {lens.principal_point_px}, distortion {lens.distortion}"
        )


def _quat_wxyz(rotation: Array) -> Array:
    quat_wxyz = np.empty(4)
    mujoco.mju_mat2Quat(quat_wxyz, rotation.ravel())
    return quat_wxyz
