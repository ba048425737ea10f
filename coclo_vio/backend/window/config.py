# SPDX-License-Identifier: BSD-3-Clause
"""Parameters of the sliding-window smoother; loads no GTSAM."""

from typing import Annotated

from pydantic import Field

from coclo_vio.robot.standstill import StandstillLimits
from coclo_vio.values.config import StageConfig

_REST_FORCE_MPS2 = 2.0  # how far the force at rest may be from gravity: more than any bias


class PixelNoiseConfig(StageConfig):
    """Noise of tracks and disparities.

    A track drifts, and its error is nearly the same in the left and the right image. The disparity, matched anew in
    each frame, has a smaller error.
    """

    track_px: Annotated[float, Field(gt=0, le=50, description="one sigma of a track, common to both images, px")] = 1.0
    disparity_px: Annotated[float, Field(gt=0, le=50, description="one sigma of a landmark's first disparity, px")] = (
        0.7
    )
    repeated_disparity_px: Annotated[
        float,
        Field(gt=0, le=100, description="one sigma of its later disparities, which repeat the first one's error, px"),
    ] = 1.0
    walk_px: Annotated[
        float,
        Field(ge=0, le=50, description="drift of a track off its point from keyframe to keyframe, one sigma, px"),
    ] = 0.0
    huber: Annotated[
        float, Field(gt=0, le=100, description="residuals beyond this many sigmas are weighted down (Huber)")
    ] = 1.5
    outlier: Annotated[
        float, Field(gt=0, le=100, description="residuals beyond this many sigmas are wrong matches")
    ] = 5.0
    is_learnt: Annotated[
        bool, Field(description="whether these sigmas are scaled by what the residuals of the windows show")
    ] = True
    least_scale: Annotated[
        float, Field(gt=0, le=1, description="least scale of the sigmas: errors that repeat do not show in residuals")
    ] = 0.5
    ample_tracks: Annotated[
        int,
        Field(
            ge=1,
            le=1000,
            description="with fewer tracks than this in a keyframe their errors repeat more: the least scale grows as "
            "the root of the ratio",
        ),
    ] = 40
    least_shown: Annotated[
        float, Field(gt=0, le=1, description="least scale of the limits of wrong matches, which follow the residuals")
    ] = 0.2
    largest_scale: Annotated[float, Field(ge=1, le=100, description="largest scale")] = 4.0
    prior_windows: Annotated[
        float, Field(gt=0, description="the configured sigmas weigh as much as the residuals of so many windows")
    ] = 1.0
    memory_windows: Annotated[float, Field(gt=1, description="residuals are forgotten after about so many windows")] = (
        10.0
    )


class DisparityOffsetConfig(StageConfig):
    """A disparity that is wrong by the same amount everywhere."""

    is_estimated: Annotated[bool, Field(description="whether it is estimated and corrected")] = True
    sigma_px: Annotated[float, Field(ge=0, le=10, description="one sigma of it, px")] = 0.1
    scale_sigma: Annotated[
        float, Field(ge=0, le=0.5, description="one sigma of the scale of the path against that of disparities")
    ] = 0.02
    point_sigma_px: Annotated[
        float, Field(gt=0, le=10, description="one sigma of the disparity of a point at first; then learnt, px")
    ] = 0.25
    least_point_sigma_px: Annotated[
        float, Field(gt=0, le=10, description="least of that: errors that all points have in common do not show, px")
    ] = 0.15
    least_parallax_rad: Annotated[
        float, Field(gt=0, le=1, description="least angle between the rays to a point, rad")
    ] = 0.04
    memory_points: Annotated[float, Field(gt=10, description="points are forgotten after about so many")] = 1500.0


class KeyframeConfig(StageConfig):
    """When a frame becomes a keyframe: enough parallax, or too few tracks in common with the last keyframe."""

    parallax_px: Annotated[
        float, Field(gt=0, description="mean motion of tracks since the last keyframe, at a focal length of 460 px")
    ] = 10.0
    least_kept_share: Annotated[
        float, Field(ge=0, le=1, description="least share of the last keyframe's tracks that are still tracked")
    ] = 0.6
    most_new_share: Annotated[
        float, Field(gt=0, le=1, description="largest share of tracks that the last keyframe does not have")
    ] = 0.5
    longest_s: Annotated[
        float, Field(gt=0, le=60, description="time since the last keyframe while the body moves, s")
    ] = 1.0


class MotionPriorConfig(StageConfig):
    """The constant-velocity model for motion that neither IMU nor odometry measures."""

    acceleration_mps2: Annotated[float, Field(gt=0, description="one sigma of acceleration, m/s^2")] = 3.0
    turn_acceleration_radps2: Annotated[
        float, Field(gt=0, description="one sigma of angular acceleration, rad/s^2")
    ] = 3.0
    velocity_mps: Annotated[float, Field(gt=0, description="one sigma of the velocity derived from poses, m/s")] = 0.5
    rate_radps: Annotated[float, Field(gt=0, description="one sigma of the rate derived from poses, rad/s")] = 0.5
    learning_s: Annotated[
        float, Field(gt=0, description="how constant the velocity is, is learnt with this time constant, s")
    ] = 10.0
    learnt_sigma_inflation: Annotated[float, Field(gt=0, description="factor on the learnt sigmas")] = 2.0
    decay_s: Annotated[
        float, Field(gt=0, description="without vision, the velocity decays with this time constant, s")
    ] = 0.5


class InertialConfig(StageConfig):
    """Noise of the IMU: at least the values given here, whatever the calibration, which does not include shocks."""

    gyroscope_noise_density: Annotated[
        float, Field(ge=0, description="least white noise, rad/s/sqrt(Hz), also with a better calibration")
    ] = 1e-3
    accelerometer_noise_density: Annotated[
        float, Field(ge=0, description="least white noise, m/s^2/sqrt(Hz): shocks between samples")
    ] = 2e-2
    gyroscope_bias_walk: Annotated[
        float, Field(ge=0, description="least random walk of the bias, rad/s^2/sqrt(Hz)")
    ] = 2e-5
    accelerometer_bias_walk: Annotated[
        float, Field(ge=0, description="least random walk of the bias, m/s^3/sqrt(Hz)")
    ] = 1e-3
    gyroscope_bias: Annotated[
        float | None, Field(gt=0, description="one sigma before the start, rad/s; null: by the IMU's grade")
    ] = None
    accelerometer_bias: Annotated[
        float | None, Field(gt=0, description="one sigma before the start, m/s^2; null: by the IMU's grade")
    ] = None
    max_gap_s: Annotated[float, Field(gt=0, description="longest gap between readings that is integrated over, s")] = (
        0.2
    )


class StandstillWindowConfig(StageConfig):
    """When vision and IMU both show a standstill."""

    window_s: Annotated[float, Field(gt=0, le=10, description="time for which the IMU has to be at rest, s")] = 0.3
    gyroscope_std_radps: Annotated[
        float, Field(gt=0, description="largest standard deviation of the angular velocity, all axes together, rad/s")
    ] = 0.03
    accelerometer_std_mps2: Annotated[
        float, Field(gt=0, description="largest standard deviation of the specific force, all axes together, m/s^2")
    ] = 0.3
    motion_px: Annotated[float, Field(gt=0, description="largest motion of tracks (median) since the keyframe, px")] = (
        1.0
    )
    velocity_mps: Annotated[float, Field(gt=0, description="one sigma of the velocity at standstill, m/s")] = 0.005

    @property
    def limits(self) -> StandstillLimits:
        """Those of the IMU."""
        return StandstillLimits(
            window_s=self.window_s,
            gyroscope_std_radps=self.gyroscope_std_radps,
            accelerometer_std_mps2=self.accelerometer_std_mps2,
            force_error_mps2=_REST_FORCE_MPS2,
        )


class StartConfig(StageConfig):
    """The start, and the uncertainty of the first keyframe."""

    rest_timeout_s: Annotated[float, Field(ge=0, description="wait this long for rest, then start in motion, s")] = 1.0
    alignment_s: Annotated[
        float,
        Field(ge=0, description="after a start in motion, time until gravity is known and estimates are given, s"),
    ] = 1.5
    rest_tilt_rad: Annotated[float, Field(gt=0, description="one sigma of roll and pitch from rest, rad")] = 0.05
    moving_tilt_rad: Annotated[float, Field(gt=0, description="one sigma of roll and pitch in motion, rad")] = 0.3
    rest_velocity_mps: Annotated[float, Field(gt=0, description="one sigma of velocity from rest, m/s")] = 0.01
    moving_velocity_mps: Annotated[float, Field(gt=0, description="one sigma of velocity in motion, m/s")] = 10.0


class FailureConfig(StageConfig):
    """When vision counts as lost, and a solution as diverged."""

    fewest_inliers: Annotated[
        int, Field(ge=1, description="a frame with fewer tracks that fit the landmarks has no vision")
    ] = 3
    max_without_vision_s: Annotated[
        float, Field(gt=0, description="longest time without vision; then the velocity by the IMU is discarded, s")
    ] = 5.0
    restart_speed_mps: Annotated[
        float,
        Field(gt=0, description="one sigma of the velocity, about zero, with which the window starts anew then, m/s"),
    ] = 0.5
    fastest_mps: Annotated[
        float, Field(gt=0, description="a solution that moves faster than this has diverged, m/s")
    ] = 60.0


class TwistConfig(StageConfig):
    """Noise of a measured body twist: large, since wheels slip and rates lag."""

    rate_noise_density: Annotated[float, Field(gt=0, description="white noise of the rate, rad/s/sqrt(Hz)")] = 0.03
    velocity_noise_density: Annotated[float, Field(gt=0, description="white noise of the velocity, m/s/sqrt(Hz)")] = (
        0.05
    )


class SmootherConfig(StageConfig):
    """Parameters of the sliding-window smoother."""

    keyframes: Annotated[int, Field(ge=3, le=60, description="keyframes in the window")] = 10
    iterations: Annotated[int, Field(ge=1, le=100, description="most iterations of the solver at a keyframe")] = 6
    tolerance: Annotated[
        float, Field(ge=0, lt=1, description="the solver stops once an iteration lowers the cost by less, relative")
    ] = 1e-4
    nearest_m: Annotated[float, Field(gt=0, description="points nearer than this are wrong matches, m")] = 0.15
    min_disparity_px: Annotated[
        float, Field(gt=0, description="points with less disparity become landmarks only by parallax, px")
    ] = 1.0
    spacing_px: Annotated[
        float, Field(ge=0, description="new points nearer than this to another one are left out, px")
    ] = 6.0
    most_kept_landmarks: Annotated[
        int,
        Field(ge=0, description="landmarks still tracked that enter the marginal prior; of others the past is dropped"),
    ] = 60
    stereo_scale_sigma: Annotated[
        float, Field(ge=0, lt=0.2, description="relative error of lengths by stereo, in the covariance of vision alone")
    ] = 0.005
    camera_rotation_sigma_rad: Annotated[
        float,
        Field(ge=0, lt=0.2, description="error of the cameras' mounting, each axis, in the covariance of vins, rad"),
    ] = 0.004
    direction_sigma_rad: Annotated[
        float,
        Field(
            ge=0,
            lt=0.2,
            description="error of the direction of displacements by vision that lasts, about each axis of the body, in "
            "the covariance of every mode with cameras, rad",
        ),
    ] = 0.0005
    heading_sigma: Annotated[
        float,
        Field(ge=0, lt=0.2, description="error of the heading there, as a share of how far the body has turned"),
    ] = 0.0005
    noise: Annotated[PixelNoiseConfig, Field(description="noise of the tracks")] = PixelNoiseConfig()
    disparity_offset: Annotated[DisparityOffsetConfig, Field(description="estimated offset of all disparities")] = (
        DisparityOffsetConfig()
    )
    keyframe: Annotated[KeyframeConfig, Field(description="choice of keyframes")] = KeyframeConfig()
    motion: Annotated[MotionPriorConfig, Field(description="the constant-velocity model")] = MotionPriorConfig()
    inertial: Annotated[InertialConfig, Field(description="the IMU")] = InertialConfig()
    standstill: Annotated[StandstillWindowConfig, Field(description="detection of a standstill")] = (
        StandstillWindowConfig()
    )
    twist: Annotated[TwistConfig, Field(description="a body twist as odometry")] = TwistConfig()
    start: Annotated[StartConfig, Field(description="the first keyframe")] = StartConfig()
    failure: Annotated[FailureConfig, Field(description="loss of vision, and divergence")] = FailureConfig()
