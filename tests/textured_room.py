# SPDX-License-Identifier: BSD-3-Clause
"""A floor and a wall with a random texture, projected exactly: each pixel is a ray intersected with a plane.

The world is z up with the floor at z = 0 and the wall at x = WALL_M; the camera looks along x and 15 deg down.
"""

from dataclasses import dataclass
from functools import cache

import cv2
import numpy as np

from coclo_vio.geometry import se3, so3
from coclo_vio.values.calibration import CameraCalibration, StereoCalibration, matrix4
from coclo_vio.values.measurements import StereoFrame

WALL_M = 3.0
HEIGHT_M = 0.4
FOCAL_PX = 300.0
BASELINE_M = 0.06
WIDTH, HEIGHT = 480, 360
LENS = CameraCalibration(
    width_px=WIDTH, height_px=HEIGHT, focal_px=(FOCAL_PX, FOCAL_PX), principal_point_px=(239.5, 179.5)
)
OPTICAL = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])  # R_body_camera looking along x
LOOKING = so3.exp(np.array([0.0, 0.26, 0.0])) @ OPTICAL
PERIOD_NS = 66_666_667
_TEXEL_M = 0.004
_TEXTURE_PX = 2048


def rig(baseline_m: float = BASELINE_M) -> StereoCalibration:
    left, right = (se3.transform(LOOKING, np.array([0.2, y, 0.0])) for y in (0.0, -baseline_m))
    return StereoCalibration(left=LENS, right=LENS, body_left_camera=matrix4(left), body_right_camera=matrix4(right))


@cache
def textures(seed: int = 1) -> list[np.ndarray]:
    """Smooth random brightness of floor and wall, 0..255, about 2 texels fine."""
    rng = np.random.default_rng(seed)
    made = []
    for _ in range(2):
        fine = cv2.GaussianBlur(rng.standard_normal((_TEXTURE_PX, _TEXTURE_PX)).astype(np.float32), (0, 0), 2.0)
        coarse = cv2.GaussianBlur(rng.standard_normal((_TEXTURE_PX, _TEXTURE_PX)).astype(np.float32), (0, 0), 6.0)
        made.append(np.clip(120.0 + 25.0 * fine / fine.std() + 25.0 * coarse / coarse.std(), 5.0, 250.0))
    return made


@dataclass
class Room:
    """Images from a body at a pose; ``noise`` is in grey levels."""

    calibration: StereoCalibration
    noise: float = 1.5
    seed: int = 1

    def __post_init__(self) -> None:
        self._textures = textures(self.seed)

    def frame(self, stamp_ns: int, T_world_body: np.ndarray) -> StereoFrame:
        mountings = (self.calibration.T_body_left_camera, self.calibration.T_body_right_camera)
        rng = np.random.default_rng([self.seed, stamp_ns])
        left, right = (self._image(T_world_body @ T, rng) for T in mountings)
        return StereoFrame(stamp_ns, left, right)

    def depth(self, T_world_camera: np.ndarray, pixels: np.ndarray) -> np.ndarray:
        """True depth along the axis, m, of pixels (N, 2)."""
        return _intersect(T_world_camera, _rays(pixels))[0]

    def is_near_edge(self, T_world_camera: np.ndarray, pixels: np.ndarray, within_px: float = 14.0) -> np.ndarray:
        """Whether pixels (N, 2) lie near to where floor and wall meet."""
        wall = [_intersect(T_world_camera, _rays(pixels + np.array([0.0, dy])))[1] for dy in (-within_px, within_px)]
        return np.asarray(wall[0] != wall[1])

    def _image(self, T_world_camera: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        columns, rows = np.meshgrid(np.arange(WIDTH, dtype=float), np.arange(HEIGHT, dtype=float))
        rays = _rays(np.column_stack((columns.ravel(), rows.ravel())))
        depth, on_wall = _intersect(T_world_camera, rays)
        points = T_world_camera[:3, 3] + depth[:, None] * (rays @ T_world_camera[:3, :3].T)
        across = np.where(on_wall[:, None], points[:, [1, 2]], points[:, [0, 1]]) / _TEXEL_M + _TEXTURE_PX / 2
        maps = [across[:, axis].reshape(HEIGHT, WIDTH).astype(np.float32) for axis in (0, 1)]
        layers = [
            cv2.remap(texture, *maps, cv2.INTER_LINEAR, borderMode=cv2.BORDER_WRAP).astype(float)
            for texture in self._textures
        ]
        image = np.where(on_wall.reshape(HEIGHT, WIDTH), layers[1], layers[0])
        return np.clip(np.rint(image + self.noise * rng.standard_normal(image.shape)), 0, 255).astype(np.uint8)


def _rays(pixels: np.ndarray) -> np.ndarray:
    centre = np.array(LENS.principal_point_px)
    return np.column_stack(((pixels - centre) / FOCAL_PX, np.ones(len(pixels))))


def _intersect(T_world_camera: np.ndarray, rays: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Depth (N,) of rays (N, 3) of the camera, and whether the wall is nearer than the floor."""
    directions, origin = rays @ T_world_camera[:3, :3].T, T_world_camera[:3, 3]
    with np.errstate(divide="ignore"):
        to_wall = (WALL_M - origin[0]) / directions[:, 0]
        to_floor = np.where(directions[:, 2] < 0.0, -origin[2] / directions[:, 2], np.inf)
    return np.minimum(to_wall, to_floor), to_wall < to_floor


def body_at(time_s: float, speed_mps: float = 0.15) -> np.ndarray:
    """A body that walks along x and sways, T_world_body."""
    sway = so3.exp(np.array([0.01 * np.sin(7.0 * time_s), 0.015 * np.sin(5.0 * time_s), 0.03 * np.sin(3.0 * time_s)]))
    place = np.array([speed_mps * time_s, 0.01 * np.sin(4.0 * time_s), HEIGHT_M + 0.005 * np.sin(6.0 * time_s)])
    return se3.transform(sway, place)


def walk(room: Room, frames: int, speed_mps: float = 0.15) -> tuple[list[StereoFrame], np.ndarray]:
    """Frames of that walk, and T_world_camera of the left camera in each, (frames, 4, 4)."""
    poses = [body_at(number * PERIOD_NS * 1e-9, speed_mps) for number in range(frames)]
    cameras = np.array([pose @ room.calibration.T_body_left_camera for pose in poses])
    return [room.frame(number * PERIOD_NS, pose) for number, pose in enumerate(poses)], cameras
