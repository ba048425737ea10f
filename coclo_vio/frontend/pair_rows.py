# SPDX-License-Identifier: BSD-3-Clause
"""How far the rows of a rectified pair differ, by the matches of a few frames."""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from coclo_vio.frontend.frontend import StereoFrontend
from coclo_vio.values.calibration import StereoCalibration
from coclo_vio.values.measurements import StereoFrame


@dataclass(frozen=True, slots=True)
class RowDifference:
    """What is left in the corner of the image where it is largest, for points far away.

    Attributes:
        rows_px: row in the right image less that in the left one, px.
        sigma_px: of it, px.
        offset_px: the part that is the same everywhere, px.
        roll_rad: turn of the right camera about its optical axis against its calibration, rad.
    """

    rows_px: float
    sigma_px: float
    offset_px: float
    roll_rad: float


def row_difference(stereo: StereoCalibration, frames: Iterable[StereoFrame]) -> RowDifference:
    """Track the frames, and take what their matches show of the right camera's calibration.

    Raises:
        ConfigError: the calibration is of no pair that can be rectified.
        DatasetError: the images are not of the size that was calibrated.
    """
    frontend = StereoFrontend(stereo)
    for frame in frames:
        frontend.track(frame)
    rig, pair = frontend.rig, frontend.pair_calibration
    right, bottom = stereo.left.width_px - 1.0, stereo.left.height_px - 1.0
    corners = np.array([(0.0, 0.0), (right, 0.0), (0.0, bottom), (right, bottom)])
    far = np.zeros(len(corners))
    rows, sigmas = pair.rows(corners, far), pair.row_sigmas(corners, far)
    worst = int(np.argmax(np.abs(rows)))
    offset = pair.rows(np.array([rig.principal_point_px]), np.zeros(1))[0]
    return RowDifference(float(rows[worst]), float(sigmas[worst]), float(offset), float(pair.errors[2]))
