# SPDX-License-Identifier: BSD-3-Clause
import mujoco
import numpy as np
import pytest
from floating_world import LENS, floating_body, stereo_pair

from coclo_vio.geometry import se3, so3
from coclo_vio.simulation.visuals.cameras import (
    OPTICAL_FROM_MUJOCO,
    add_cameras,
    camera_twist,
    focal_px,
    image_size,
    pinhole,
    place,
)
from coclo_vio.simulation.visuals.opengl import RenderingError
from coclo_vio.values.errors import ConfigError

POSE = np.array([0.3, -0.2, 0.4, *np.array([0.9, 0.1, -0.2, 0.3]) / np.linalg.norm([0.9, 0.1, -0.2, 0.3])])


def world_from_camera(data: mujoco.MjData, side: int) -> np.ndarray:
    rotation = data.cam_xmat[side].reshape(3, 3) @ OPTICAL_FROM_MUJOCO
    return se3.transform(rotation, data.cam_xpos[side].copy())


def test_cameras_are_placed_by_the_calibration(model: mujoco.MjModel) -> None:
    data = mujoco.MjData(model)
    place(model, data, POSE, np.zeros(6))
    T_world_body = se3.transform(so3.from_quat_wxyz(POSE[3:]), POSE[:3])
    pair = stereo_pair()
    for side, T_body_camera in enumerate((pair.T_body_left_camera, pair.T_body_right_camera)):
        np.testing.assert_allclose(world_from_camera(data, side), T_world_body @ T_body_camera, rtol=0, atol=1e-9)


def test_lens_is_that_of_the_calibration(model: mujoco.MjModel) -> None:
    for side in (0, 1):
        assert focal_px(model, side) == pytest.approx(LENS.focal_px[0], abs=1e-4)
        assert image_size(model, side) == (640, 480)


def test_twist_is_the_motion_of_the_optical_frame(model: mujoco.MjModel) -> None:
    data = mujoco.MjData(model)
    qvel, step_s = np.array([0.2, -0.1, 0.3, 0.5, -0.4, 0.6]), 1e-5
    for side in (0, 1):
        place(model, data, POSE, qvel)
        twist = camera_twist(model, data, side)
        poses = []
        for time_s in (-step_s, step_s):
            moved = POSE.copy()
            mujoco.mj_integratePos(model, moved, qvel, time_s)
            place(model, data, moved, qvel)
            poses.append(world_from_camera(data, side))
        motion = se3.log(se3.inverse(poses[0]) @ poses[1]) / (2.0 * step_s)
        np.testing.assert_allclose(twist, motion, rtol=0, atol=1e-6)


def test_a_lens_that_cannot_be_rendered_is_refused() -> None:
    pair = stereo_pair()
    for lens in (
        LENS.model_copy(update={"principal_point_px": (310.0, 239.5)}),
        LENS.model_copy(update={"focal_px": (385.0, 386.0)}),
        LENS.model_copy(update={"distortion": "radtan", "distortion_coefficients": (0.1, 0.0, 0.0, 0.0)}),
    ):
        with pytest.raises(ConfigError, match="right_camera: the renderer has a pinhole"):
            add_cameras(floating_body(), pair.model_copy(update={"right": lens}))


def test_a_model_without_that_body_or_those_cameras_is_refused() -> None:
    with pytest.raises(ConfigError, match="no body 'trunk' to carry the cameras; its bodies are: base, world"):
        add_cameras(floating_body(), stereo_pair(), body="trunk")
    with pytest.raises(RenderingError, match="no camera 'left_camera'"):
        image_size(floating_body().compile(), 0)


def test_a_pinhole_has_its_axis_in_the_middle_of_the_pixels() -> None:
    assert pinhole(3, 5, 10.0).principal_point_px == (1.0, 2.0)
