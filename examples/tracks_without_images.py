# SPDX-License-Identifier: BSD-3-Clause
"""Visual odometry from the tracks of any tracker, without an image: ``python examples/tracks_without_images.py``."""

from collections.abc import Iterator

import numpy as np

import coclo_vio as cv
from coclo_vio.geometry import se3
from coclo_vio.values.calibration import CameraCalibration, RectifiedStereo, matrix4

LENS = CameraCalibration(width_px=640, height_px=480, focal_px=(380.0, 380.0), principal_point_px=(320.0, 240.0))
FORWARD = np.array([[0.0, 0, 1], [-1, 0, 0], [0, -1, 0]])  # cameras that look along the body's x axis
LEFT, RIGHT = (se3.transform(FORWARD, np.array([0.2, y, 0.0])) for y in (0.05, -0.05))
CAMERAS = cv.StereoCalibration(left=LENS, right=LENS, body_left_camera=matrix4(LEFT), body_right_camera=matrix4(RIGHT))
POINTS = np.random.default_rng(1).uniform([1.5, -2.0, -1.5], [6.0, 2.0, 1.5], (400, 3))  # m, world


def travelled_m(time_s: float) -> float:
    return 0.3 * time_s + 0.05 * float(np.sin(3.0 * time_s))


def tracks() -> Iterator[cv.StereoTracks]:
    rig, random = RectifiedStereo.of(CAMERAS), np.random.default_rng(2)
    for stamp_ns in range(0, 4_000_000_000, 100_000_000):
        in_camera = se3.apply(se3.inverse(LEFT), POINTS - [travelled_m(stamp_ns / 1e9), 0.0, 0.0])
        left, disparity = (pixels + random.normal(0.0, 0.2, pixels.shape) for pixels in rig.pixels(in_camera))
        ids = np.flatnonzero((in_camera[:, 2] > 0.5) & (left > 0).all(axis=1) & (left < [640, 480]).all(axis=1))
        yield cv.StereoTracks(stamp_ns, ids, left[ids], left[ids] - disparity[ids, None] * [1.0, 0.0])


def main() -> None:
    odometry = cv.make_estimator("stereo", calibration=CAMERAS, sensors=frozenset({cv.StereoTracks}))
    outputs = [output for frame in tracks() for output in odometry.push(frame)]
    last = [output.state for output in outputs if isinstance(output, cv.Estimate)][-1]
    print(f"estimated {last.nav.T_world_body[0, 3]:.3f} m, travelled {travelled_m(last.stamp_ns / 1e9):.3f} m")


if __name__ == "__main__":
    main()
