# SPDX-License-Identifier: BSD-3-Clause
"""The imager's model: blur, vignetting, exposure, shot and read noise, eight bits.

Motion blur is the mean of the image at several instants of the exposure, each warped by the homography that the
camera's rotation and translation induce in a plane facing it at the harmonic mean depth of the image. So blur by
rotation is exact; blur by translation is exact for points at that depth, too small for nearer and too large for farther
ones; the robot's own legs blur as if they stood still in the world. The shutter is global.

Signal and noise in grey levels, with k = 255 gain / full well: mean y, variance k y + (k read noise)^2, by a normal
approximation of the Poisson distribution (the photon transfer of EMVA Standard 1288). Noise follows from (seed, frame,
camera) alone.
"""

from typing import Any, Final

import cv2
import numpy as np
import numpy.typing as npt

from coclo_vio.geometry import so3
from coclo_vio.simulation.visuals.config import CameraConfig
from coclo_vio.simulation.visuals.exposure import Exposure
from coclo_vio.values.arrays import Array, ByteImage

FloatImage = npt.NDArray[np.float32]

_LEAST_BLUR_PX = 0.15
_BLUR_STEP_PX = 0.75
_MOST_INSTANTS = 12
_ENCODERS: Final[dict[str, str]] = {"png": ".png", "jpeg": ".jpg"}
# Noise has no repeated patterns to compress, and least of it is left over from the mean of two neighbours.
_PNG_OPTIONS: Final = [
    *(cv2.IMWRITE_PNG_STRATEGY, cv2.IMWRITE_PNG_STRATEGY_RLE),
    *((cv2.IMWRITE_PNG_FILTER, cv2.IMWRITE_PNG_FILTER_AVG) if hasattr(cv2, "IMWRITE_PNG_FILTER") else ()),  # 4.12
]


class CameraModel:
    """One imager of the pair: turns rendered images into recorded ones."""

    def __init__(
        self, config: CameraConfig, side: int, width_px: int, height_px: int, focal_px: float, seed: int
    ) -> None:
        self._config = config
        self._side = side
        self._seed = seed
        self._matrix = np.array(
            [[focal_px, 0.0, 0.5 * (width_px - 1)], [0.0, focal_px, 0.5 * (height_px - 1)], [0.0, 0.0, 1.0]]
        )
        self._sensitivity = self._pattern(width_px, height_px)

    def record(
        self, image: ByteImage | FloatImage, inverse_depth: FloatImage, twist: Array, exposure: Exposure, frame: int
    ) -> ByteImage:
        """The recorded image (rows, columns).

        Args:
            image: the rendered image, reflected light times 255, (rows, columns).
            inverse_depth: one over depth, 1/m, (rows, columns).
            twist: angular and linear velocity of the camera, its own optical frame, rad/s and m/s, (6,).
            exposure: exposure time, gain and brightness of the frame.
            frame: number of the frame, which decides its noise.
        """
        light = self._blurred(image, inverse_depth, twist, exposure.duration_s)
        mean = light * self._sensitivity * np.float32(exposure.brightness)
        return self._digitised(mean, exposure.gain, frame)

    def encode(self, image: ByteImage) -> bytes:
        """The image as a file of the configured encoding."""
        config = self._config
        options = (
            _PNG_OPTIONS
            if config.encoding == "png"
            else [cv2.IMWRITE_JPEG_QUALITY, config.jpeg_quality, cv2.IMWRITE_JPEG_OPTIMIZE, 1]  # same pixels, smaller
        )
        _, data = cv2.imencode(_ENCODERS[config.encoding], image, options)
        return data.tobytes()

    def _pattern(self, width_px: int, height_px: int) -> FloatImage:
        """Sensitivity of each pixel: vignetting, fixed pattern, and mismatch of the two cameras."""
        imager = self._config.imager
        rng = np.random.default_rng([self._seed, 4, self._side])
        x = np.linspace(-1.0, 1.0, width_px) * width_px
        y = np.linspace(-1.0, 1.0, height_px) * height_px
        corner_share = (x**2 + y[:, None] ** 2) / (width_px**2 + height_px**2)
        level = 1.0 + imager.gain_mismatch * rng.standard_normal()
        spread = 1.0 + imager.pattern_noise * rng.standard_normal((height_px, width_px))
        return (level * (1.0 - imager.vignetting * corner_share) * spread).astype(np.float32)

    def _blurred(
        self, image: ByteImage | FloatImage, inverse_depth: FloatImage, twist: Array, duration_s: float
    ) -> FloatImage:
        """The image (rows, columns) with motion and lens blur, 0..255."""
        instants = self._instants(image.shape, inverse_depth, twist, duration_s)
        total: Any = np.zeros(image.shape, dtype=np.float32)
        for homography in instants:
            total += _warped(image, homography)
        light = total / np.float32(len(instants)) if instants else image.astype(np.float32)
        if self._config.imager.readout_s > 0.0:
            light = self._rolled(light, float(inverse_depth[::8, ::8].mean()), twist)
        sigma = self._config.imager.lens_blur_px
        return np.asarray(cv2.GaussianBlur(light, (0, 0), sigma) if sigma > 0.0 else light, dtype=np.float32)

    def _instants(
        self, shape: tuple[int, ...], inverse_depth: FloatImage, twist: Array, duration_s: float
    ) -> list[Array]:
        """Homographies (3, 3) from the rendered image to evenly spread instants of the exposure.

        A point p of the plane n.p = d, n = (0, 0, 1), is at ``exp(-w t) p - v t`` in the camera's frame t later, so
        ``H = K (exp(-w t) - v t n^T / d) K^-1`` (Hartley and Zisserman, "Multiple View Geometry", eq. 13.2).
        Empty where the blur is negligible.
        """
        mean_inverse_depth = float(inverse_depth[::8, ::8].mean())

        def homography(time_s: float) -> Array:
            return self._homography(time_s, mean_inverse_depth, twist)

        length_px = _greatest_shift_px(homography(duration_s), shape)
        if length_px < _LEAST_BLUR_PX:
            return []
        count = int(np.clip(np.ceil(length_px / _BLUR_STEP_PX), 2, _MOST_INSTANTS))
        return [homography(duration_s * ((number + 0.5) / count - 0.5)) for number in range(count)]

    def _homography(self, time_s: float, mean_inverse_depth: float, twist: Array) -> Array:
        """From the rendered image to that of the camera ``time_s`` later, (3, 3)."""
        motion = so3.exp(-twist[:3] * time_s)
        motion[:, 2] -= twist[3:] * time_s * mean_inverse_depth
        return np.asarray(self._matrix @ motion @ np.linalg.inv(self._matrix))

    def _rolled(self, light: FloatImage, mean_inverse_depth: float, twist: Array) -> FloatImage:
        """The image of a shutter that reads row after row, the middle row at the frame's time."""
        rows, columns = light.shape
        times_s = (np.arange(rows) / max(rows - 1, 1) - 0.5) * self._config.imager.readout_s
        back = np.array([self._homography(-time_s, mean_inverse_depth, twist) for time_s in times_s])
        pixels = np.stack((np.arange(columns), np.zeros(columns), np.ones(columns)))
        source = back @ pixels + np.arange(rows)[:, None, None] * back[:, :, 1:2]
        source = (source[:, :2] / source[:, 2:]).astype(np.float32)
        moved = cv2.remap(light, source[:, 0], source[:, 1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
        return np.asarray(moved, dtype=np.float32)

    def _digitised(self, mean: FloatImage, gain: float, frame: int) -> ByteImage:
        imager = self._config.imager
        scale = 255.0 * gain / imager.full_well_e
        rng = np.random.default_rng([self._seed, 5, frame, self._side])
        deviation = np.sqrt(np.float32(scale) * mean + np.float32((scale * imager.read_noise_e) ** 2))
        noisy = mean + deviation * rng.standard_normal(mean.shape, dtype=np.float32)
        image: ByteImage = np.clip(np.rint(noisy), 0.0, 255.0).astype(np.uint8)
        return image


def _warped(image: ByteImage | FloatImage, homography: Array) -> npt.NDArray[Any]:
    size = (image.shape[1], image.shape[0])
    return np.asarray(cv2.warpPerspective(image, homography, size, borderMode=cv2.BORDER_REPLICATE))


def _greatest_shift_px(homography: Array, shape: tuple[int, ...]) -> float:
    """Largest displacement of the image's corners by the homography, px."""
    right, bottom = shape[1] - 1.0, shape[0] - 1.0
    corners = np.array([[0.0, right, 0.0, right], [0.0, 0.0, bottom, bottom], [1.0, 1.0, 1.0, 1.0]])
    moved = homography @ corners
    shift = moved[:2] / moved[2] - corners[:2]
    return float(np.hypot(shift[0], shift[1]).max())
