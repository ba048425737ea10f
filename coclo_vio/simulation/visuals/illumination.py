# SPDX-License-Identifier: BSD-3-Clause
"""Light that is not the same everywhere: stripes of a barred window, the robot's own shadow, a lamp on the robot.

Surfaces are matt, so the light on a point does not depend on the camera: it is computed for the point that each pixel
sees. Stripes stay where they are; shadow and lamp move with the robot, and what they draw is no landmark.
"""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from coclo_vio.simulation.visuals.config import LightingConfig
from coclo_vio.values.arrays import Array

FloatImage = npt.NDArray[np.float32]

_SOFT_M = 0.015  # breadth of the edge of the robot's shadow
_SHADOW_M = (0.42, 0.30)  # half axes of the robot's shadow along and across its heading
_LAMP_M = 0.8  # distance at which the lamp is as bright as the room without it
_LAMP_CONE = 0.5  # tangent of the angle at which the lamp has half of its light
_BRIGHTEST = 2.5


@dataclass(frozen=True, slots=True, eq=False)
class View:
    """What a camera sees where.

    Attributes:
        T_world_camera: pose of the camera, optical axes, (4, 4).
        T_world_body: pose of the robot, (4, 4).
        inverse_depth: 1/m, (rows, columns).
        focal_px: focal length, px.
    """

    T_world_camera: Array
    T_world_body: Array
    inverse_depth: FloatImage
    focal_px: float


class Illumination:
    """The light of a room, share of its normal light; the same for both cameras."""

    def __init__(self, config: LightingConfig, seed: int) -> None:
        self._config = config
        rng = np.random.default_rng([seed, 8])
        azimuth, slope = rng.uniform(-np.pi, np.pi), rng.uniform(0.6, 1.4)
        self._lean = slope * np.array([np.cos(azimuth), np.sin(azimuth)])  # of the window's light, per m of height
        turn = azimuth + rng.uniform(0.2, 1.4)
        self._across = np.array([np.cos(turn), np.sin(turn)])
        self._back_lean = 1.6 * np.array([np.cos(0.3), np.sin(0.3)])  # of the light that casts the robot's shadow

    @property
    def is_even(self) -> bool:
        """Whether all places have the same light."""
        return self._config.bars == 0.0 and self._config.own_shadow == 0.0 and self._config.lamp == 0.0

    def on(self, view: View) -> FloatImage:
        """The light on what each pixel sees, (rows, columns)."""
        config, (rays, points) = self._config, _seen(view)
        light = np.ones(view.inverse_depth.shape, dtype=np.float32)
        if config.bars > 0.0:
            light *= np.float32(1.0) - np.float32(config.bars) * self._stripes(points)
        if config.own_shadow > 0.0:
            light *= np.float32(1.0) - np.float32(config.own_shadow) * self._shadow(points, view.T_world_body)
        if config.lamp > 0.0:
            light = np.float32(1.0 - config.lamp) * light + np.float32(config.lamp) * _lamp(rays, view.inverse_depth)
        return light

    def _stripes(self, points: FloatImage) -> FloatImage:
        """1 in the shade of a bar, 0 between bars."""
        on_floor = points[..., :2] - points[..., 2:] * self._lean.astype(np.float32)
        along = (on_floor @ self._across.astype(np.float32)) / np.float32(self._config.bar_m)
        from_edge = (np.abs(along % 1.0 - 0.5) - 0.25) * np.float32(self._config.bar_m / self._config.bar_edge_m)
        return np.asarray(np.clip(from_edge + 0.5, 0.0, 1.0), dtype=np.float32)

    def _shadow(self, points: FloatImage, T_world_body: Array) -> FloatImage:
        """1 where the trunk is before the light, with a soft edge."""
        below = (T_world_body[2, 3] - points[..., 2:]).astype(np.float32)
        lifted = points[..., :2] - below * self._back_lean.astype(np.float32) - T_world_body[:2, 3].astype(np.float32)
        local = lifted @ T_world_body[:2, :2].astype(np.float32) / np.array(_SHADOW_M, dtype=np.float32)
        distance = (np.linalg.norm(local, axis=-1) - 1.0) * np.float32(_SHADOW_M[1] / (3.0 * _SOFT_M))
        return np.asarray(np.where(below[..., 0] > 0.02, np.clip(0.5 - distance, 0.0, 1.0), 0.0), dtype=np.float32)


def _seen(view: View) -> tuple[FloatImage, FloatImage]:
    """Rays of the pixels (rows, columns, 3) with a depth of one, camera, and what they see, world, m."""
    rows, columns = view.inverse_depth.shape
    x = (np.arange(columns, dtype=np.float32) - 0.5 * (columns - 1)) / np.float32(view.focal_px)
    y = (np.arange(rows, dtype=np.float32) - 0.5 * (rows - 1)) / np.float32(view.focal_px)
    rays = np.empty((rows, columns, 3), dtype=np.float32)
    rays[..., 0], rays[..., 1], rays[..., 2] = x, y[:, None], 1.0
    seen = (rays / np.maximum(view.inverse_depth, 1e-3)[..., None]) @ view.T_world_camera[:3, :3].T.astype(np.float32)
    return rays, np.asarray(seen + view.T_world_camera[:3, 3].astype(np.float32))


def _lamp(rays: FloatImage, inverse_depth: FloatImage) -> FloatImage:
    """Light of a lamp beside the camera, which falls with the square of distance and off its axis."""
    off_axis = np.float32(1.0) + (rays[..., 0] ** 2 + rays[..., 1] ** 2) / np.float32(_LAMP_CONE**2)
    return np.minimum((np.float32(_LAMP_M) * inverse_depth) ** 2 / off_axis, np.float32(_BRIGHTEST))
