# SPDX-License-Identifier: BSD-3-Clause
"""A small model with all that is rendered of a trial: a floating body with a stereo pair, steps, and a room."""

import mujoco
import numpy as np

from coclo_vio.geometry import se3, so3
from coclo_vio.simulation.visuals.cameras import add_cameras, pinhole
from coclo_vio.simulation.visuals.config import SceneConfig
from coclo_vio.simulation.visuals.scene import RoomBounds, Surface, add_visuals
from coclo_vio.values.calibration import StereoCalibration, matrix4

LENS = pinhole(640, 480, 385.0)
BASELINE_M = 0.05
WALKED = RoomBounds(-0.5, 2.5, -1.0, 1.0, 3.0)
_OPTICAL = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])  # R_body_camera looking along x
_RISER = np.array([[0.0, 0.0, -1.0], [-1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])  # normal -x, own x along -y


def stereo_pair() -> StereoCalibration:
    rotation = so3.exp(np.array([0.0, 0.2, 0.0])) @ _OPTICAL
    left, right = (
        se3.transform(rotation, np.array([0.2, side, 0.1])) for side in (0.5 * BASELINE_M, -0.5 * BASELINE_M)
    )
    return StereoCalibration(left=LENS, right=LENS, body_left_camera=matrix4(left), body_right_camera=matrix4(right))


def steps() -> list[Surface]:
    surfaces = []
    for number in range(3):
        x, z = 1.2 + 0.4 * number, 0.15 * (number + 1)
        surfaces.append(Surface(np.array([x, 0.0, z - 0.075]), np.array([0.8, 0.075]), _RISER, "riser"))
        surfaces.append(Surface(np.array([x + 0.2, 0.0, z]), np.array([0.2, 0.8]), np.eye(3), "tread"))
    return surfaces


def floating_body() -> mujoco.MjSpec:
    spec = mujoco.MjSpec()
    body = spec.worldbody.add_body(name="base")
    body.add_freejoint()
    body.add_geom(type=mujoco.mjtGeom.mjGEOM_BOX, size=[0.1, 0.1, 0.03], mass=1.0)
    return spec


def with_visuals(seed: int, config: SceneConfig | None = None) -> mujoco.MjSpec:
    spec = floating_body()
    add_visuals(spec, steps(), config or SceneConfig(), seed, WALKED)
    add_cameras(spec, stereo_pair())
    return spec
