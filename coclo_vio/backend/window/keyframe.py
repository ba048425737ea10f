# SPDX-License-Identifier: BSD-3-Clause
"""What the window is made of and what solving it gives: keyframes, and the solution."""

from dataclasses import dataclass, field

from coclo_vio.backend.window.factors import Term
from coclo_vio.values.arrays import Array
from coclo_vio.values.measurements import StereoTracks


@dataclass(slots=True, eq=False)
class Keyframe:
    """A frame of the window.

    Attributes:
        number: counts up; its keys are made of it.
        stamp_ns: its time, ns.
        tracks: points observed in it.
        terms: connect it with the keyframe before it, or are priors on it.
        rest_terms: zero velocity and the gyroscope's bias at a standstill.
        is_supported: whether a weak prior makes its pose solvable.
    """

    number: int
    stamp_ns: int
    tracks: StereoTracks
    terms: list[Term] = field(default_factory=list)
    rest_terms: list[Term] = field(default_factory=list)
    is_supported: bool = False


@dataclass(frozen=True, slots=True)
class Solution:
    """Result of solving.

    Attributes:
        iterations: of the solver.
        factors: in the problem.
        landmarks: in the problem.
        reprojection_px: root mean square of the observations' residuals, px.
        covariance: of the newest pose relative to the oldest one's place and heading, and of velocity and biases
            (accelerometer, gyroscope) where the IMU is used, (6, 6) or (15, 15).
        dropped: landmarks that were not determined, and were dropped.
        supported: poses that were not determined, and got a weak prior.
    """

    iterations: int
    factors: int
    landmarks: int
    reprojection_px: float
    covariance: Array
    dropped: int = 0
    supported: int = 0
