# SPDX-License-Identifier: BSD-3-Clause
"""What a comparison of rotations can find: a wrong mounting, late images, a gyroscope that is off, cameras that err."""

from dataclasses import dataclass

from coclo_vio.values.arrays import Array


@dataclass(frozen=True, slots=True, eq=False)
class CameraMounting:
    """The cameras are turned by more than their calibration allows.

    Attributes:
        rotation: ``e`` with ``R_body_camera(calibrated) = exp(e) R_body_camera(true)``, rad, (3,).
        covariance: of it, (3, 3).
    """

    rotation: Array
    covariance: Array


@dataclass(frozen=True, slots=True)
class ImageDelay:
    """Stamps of images are late.

    Attributes:
        delay_s: by so much, s; negative where they are early.
        sigma_s: of it, s.
    """

    delay_s: float
    sigma_s: float


@dataclass(frozen=True, slots=True, eq=False)
class GyroscopeOffset:
    """The body's gyroscope has another bias than the filter takes it to have.

    Attributes:
        bias: as cameras and gyroscope give it, body axes, rad/s, (3,).
        change: of it since it last agreed with the cameras, rad/s, (3,).
        sigma: of each axis, rad/s.
        start_ns: latest time at which it agreed, in nanoseconds.
        end_ns: time of the last frame, in nanoseconds.
        T_start_end: the body's motion between the two by the cameras, their mounting as estimated, (4, 4).
        witness: the sensor that agrees with the cameras; None where the cameras alone show it.
    """

    bias: Array
    change: Array
    sigma: float
    start_ns: int
    end_ns: int
    T_start_end: Array
    witness: str | None


@dataclass(frozen=True, slots=True)
class VisionSuspect:
    """Cameras and gyroscope contradict each other, and no third sensor agrees with the cameras.

    Attributes:
        rate_radps: by so much, rad/s.
        witness: the sensor that agrees with the gyroscope; None where there is none.
    """

    rate_radps: float
    witness: str | None


@dataclass(frozen=True, slots=True)
class VisionAgrees:
    """Cameras that were suspect agree with the gyroscope again."""


@dataclass(frozen=True, slots=True, eq=False)
class GyroscopeAgrees:
    """The body's gyroscope, which was set aside, agrees with the cameras again.

    Attributes:
        bias: of it, body axes, rad/s, (3,).
        sigma: of each axis, rad/s.
    """

    bias: Array
    sigma: float


Finding = CameraMounting | ImageDelay | GyroscopeOffset | VisionSuspect | VisionAgrees | GyroscopeAgrees
