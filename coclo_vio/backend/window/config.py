# SPDX-License-Identifier: BSD-3-Clause
"""Parameters of the sliding-window smoother; loads no GTSAM."""

from typing import Annotated

from pydantic import Field

from coclo_vio.values.config import StageConfig


class PixelNoiseConfig(StageConfig):
    """How well a track says where its point is.

    A track wanders: what it is off by is much the same in the left and the right image. The disparity, found anew in
    each frame, is better than that.
    """

    track_px: Annotated[float, Field(gt=0, le=50, description="one sigma of a track, both images alike, px")] = 1.0
    disparity_px: Annotated[float, Field(gt=0, le=50, description="one sigma of a landmark's first disparity, px")] = (
        0.7
    )
    repeated_disparity_px: Annotated[
        float,
        Field(gt=0, le=100, description="one sigma of its later disparities, which repeat the first one's error, px"),
    ] = 1.0
    walk_px: Annotated[
        float,
        Field(
            ge=0, le=50, description="how far a track wanders off its point from keyframe to keyframe, one sigma, px"
        ),
    ] = 0.0
    huber: Annotated[float, Field(gt=0, le=100, description="residuals beyond this many sigmas count less (Huber)")] = (
        1.5
    )
    outlier: Annotated[
        float, Field(gt=0, le=100, description="residuals beyond this many sigmas are taken for wrong matches")
    ] = 5.0


class KeyframeConfig(StageConfig):
    """When a frame becomes a keyframe: enough parallax, or too much of what the last keyframe saw is out of sight."""

    parallax_px: Annotated[
        float, Field(gt=0, description="mean motion of tracks since the last keyframe, at a focal length of 460 px")
    ] = 10.0
    least_kept_share: Annotated[
        float, Field(ge=0, le=1, description="share of the last keyframe's tracks that are still seen")
    ] = 0.6
    most_new_share: Annotated[
        float, Field(gt=0, le=1, description="share of tracks that the last keyframe does not have")
    ] = 0.5
    longest_s: Annotated[
        float, Field(gt=0, le=60, description="time since the last keyframe while the body moves, s")
    ] = 1.0


class MotionPriorConfig(StageConfig):
    """What is believed of motion that nothing measures: that it goes on, give or take."""

    acceleration_mps2: Annotated[float, Field(gt=0, description="one sigma of acceleration, m/s^2")] = 3.0
    turn_acceleration_radps2: Annotated[
        float, Field(gt=0, description="one sigma of angular acceleration, rad/s^2")
    ] = 3.0
    velocity_mps: Annotated[float, Field(gt=0, description="one sigma of the velocity told from poses, m/s")] = 0.5
    rate_radps: Annotated[float, Field(gt=0, description="one sigma of the rate told from poses, rad/s")] = 0.5
    habit_s: Annotated[
        float, Field(gt=0, description="how steady motion is, is learnt from the last so many seconds of it, s")
    ] = 10.0
    habit_caution: Annotated[
        float, Field(gt=0, description="how many times its learnt sigma motion is expected to be off")
    ] = 2.0
    memory_s: Annotated[
        float, Field(gt=0, description="without sight, velocity is believed to fade with this time constant, s")
    ] = 0.5


class InertialConfig(StageConfig):
    """How the IMU is used: its calibrated noise, made larger by what the calibration does not know of."""

    gyroscope_noise_density: Annotated[
        float, Field(ge=0, description="least white noise, rad/s/sqrt(Hz), whatever the calibration says")
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
    gyroscope_bias: Annotated[float, Field(gt=0, description="one sigma before the start, rad/s")] = 0.05
    accelerometer_bias: Annotated[float, Field(gt=0, description="one sigma before the start, m/s^2")] = 0.5
    max_gap_s: Annotated[
        float, Field(gt=0, description="a longer silence of the IMU between two frames is not integrated over, s")
    ] = 0.2


class StandstillWindowConfig(StageConfig):
    """When eyes and IMU agree that nothing moves."""

    window_s: Annotated[float, Field(gt=0, le=10, description="time for which it has to hold, s")] = 0.3
    gyroscope_std_radps: Annotated[
        float, Field(gt=0, description="most the angular velocity may scatter, all axes together, rad/s")
    ] = 0.03
    accelerometer_std_mps2: Annotated[
        float, Field(gt=0, description="most the specific force may scatter, all axes together, m/s^2")
    ] = 0.3
    motion_px: Annotated[
        float, Field(gt=0, description="most that tracks may have moved (median) since the keyframe, px")
    ] = 1.0
    velocity_mps: Annotated[float, Field(gt=0, description="one sigma of the velocity at standstill, m/s")] = 0.005


class StartConfig(StageConfig):
    """How the first keyframe is believed to stand."""

    rest_timeout_s: Annotated[float, Field(ge=0, description="wait this long for rest, then start on the move, s")] = (
        1.0
    )
    alignment_s: Annotated[
        float, Field(ge=0, description="after a start on the move, time until gravity is known and poses go out, s")
    ] = 1.5
    rest_tilt_rad: Annotated[float, Field(gt=0, description="one sigma of roll and pitch from rest, rad")] = 0.05
    moving_tilt_rad: Annotated[float, Field(gt=0, description="one sigma of roll and pitch on the move, rad")] = 0.3
    rest_velocity_mps: Annotated[float, Field(gt=0, description="one sigma of velocity from rest, m/s")] = 0.01
    moving_velocity_mps: Annotated[float, Field(gt=0, description="one sigma of velocity on the move, m/s")] = 10.0


class FailureConfig(StageConfig):
    """When sight counts as lost, and what counts as gone wrong."""

    fewest_inliers: Annotated[
        int, Field(ge=1, description="a frame with fewer tracks that fit the landmarks is blind")
    ] = 3
    max_lost_s: Annotated[
        float, Field(gt=0, description="blind for longer, the IMU's velocity is given up and the window starts anew, s")
    ] = 5.0
    blind_speed_mps: Annotated[float, Field(gt=0, description="one sigma of the speed that is believed then, m/s")] = (
        0.5
    )
    fastest_mps: Annotated[
        float, Field(gt=0, description="a solution that moves faster than this has diverged, m/s")
    ] = 60.0


class TwistConfig(StageConfig):
    """How far a measured body twist is believed: weakly, for wheels slip and rates lag."""

    rate_noise_density: Annotated[float, Field(gt=0, description="white noise of the rate, rad/s/sqrt(Hz)")] = 0.03
    velocity_noise_density: Annotated[float, Field(gt=0, description="white noise of the velocity, m/s/sqrt(Hz)")] = (
        0.05
    )


class SmootherConfig(StageConfig):
    """Everything about the sliding window."""

    keyframes: Annotated[int, Field(ge=3, le=60, description="keyframes in the window")] = 10
    iterations: Annotated[int, Field(ge=1, le=100, description="most iterations of the solver at a keyframe")] = 6
    tolerance: Annotated[
        float, Field(ge=0, lt=1, description="the solver stops once an iteration lowers the cost by less, relative")
    ] = 1e-4
    nearest_m: Annotated[float, Field(gt=0, description="nearest point that is believed, m")] = 0.15
    min_disparity_px: Annotated[
        float, Field(gt=0, description="points with less disparity give no landmark until parallax places them, px")
    ] = 1.0
    spacing_px: Annotated[
        float, Field(ge=0, description="a new point nearer than this to another one repeats its errors: left out, px")
    ] = 6.0
    most_kept_landmarks: Annotated[
        int, Field(ge=0, description="landmarks still seen whose past the marginal prior keeps; others forget it")
    ] = 60
    noise: Annotated[PixelNoiseConfig, Field(description="noise of the tracks")] = PixelNoiseConfig()
    keyframe: Annotated[KeyframeConfig, Field(description="choice of keyframes")] = KeyframeConfig()
    motion: Annotated[MotionPriorConfig, Field(description="motion that nothing measures")] = MotionPriorConfig()
    inertial: Annotated[InertialConfig, Field(description="the IMU")] = InertialConfig()
    standstill: Annotated[StandstillWindowConfig, Field(description="rest")] = StandstillWindowConfig()
    twist: Annotated[TwistConfig, Field(description="a body twist as odometry")] = TwistConfig()
    start: Annotated[StartConfig, Field(description="the first keyframe")] = StartConfig()
    failure: Annotated[FailureConfig, Field(description="when sight is lost")] = FailureConfig()
