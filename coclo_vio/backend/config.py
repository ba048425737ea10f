# SPDX-License-Identifier: BSD-3-Clause
"""Parameters of the GTSAM baselines; loads no GTSAM."""

from typing import Annotated

from pydantic import Field

from coclo_vio.robot.standstill import StandstillConfig
from coclo_vio.values.config import StageConfig


class FootholdNoiseConfig(StageConfig):
    """Noise of the baseline, fitted to nothing here.

    IMU noise and foothold walk are those of the kinematics example in Hartley's published implementation; a foot
    position is taken to be good to a centimetre.
    """

    gyroscope_noise_density: Annotated[float, Field(gt=0, description="white noise, rad/s/sqrt(Hz)")] = 0.01
    accelerometer_noise_density: Annotated[float, Field(gt=0, description="white noise, m/s^2/sqrt(Hz)")] = 0.1
    foothold_walk: Annotated[float, Field(gt=0, description="random walk of a foot in stance, m/s/sqrt(Hz)")] = 0.01
    foot_position_noise_m: Annotated[
        float, Field(gt=0, description="one sigma of a foot position from the joints, m")
    ] = 0.01


class InvariantConfig(StageConfig):
    """The baseline: its noise, how it starts and how it copes with gaps."""

    noise: Annotated[FootholdNoiseConfig, Field(description="noise of IMU and feet")] = FootholdNoiseConfig()
    rolling_feet: Annotated[
        bool, Field(description="whether the roll of spherical feet is taken out; false as published")
    ] = False
    initial_tilt_rad: Annotated[float, Field(gt=0, description="one sigma of roll and pitch from rest, rad")] = 0.02
    initial_velocity_mps: Annotated[float, Field(gt=0, description="one sigma at rest, m/s")] = 0.02
    moving_tilt_rad: Annotated[
        float, Field(gt=0, description="one sigma of roll and pitch of a start in motion, rad")
    ] = 0.2
    moving_velocity_mps: Annotated[
        float, Field(gt=0, description="one sigma of the velocity of a start in motion, m/s")
    ] = 1.0
    standstill: Annotated[StandstillConfig, Field(description="detection of a standstill")] = StandstillConfig()
    rest_timeout_s: Annotated[
        float, Field(ge=0, description="wait this long for the robot to stand still, then start in motion, s")
    ] = 3.0
    max_gap_s: Annotated[
        float, Field(gt=0, description="longest gap between IMU samples that is integrated over without inflation, s")
    ] = 0.1
    gap_rate_radps: Annotated[float, Field(ge=0, description="one sigma of the angular velocity in a gap, rad/s")] = 0.3
    gap_acceleration_mps2: Annotated[
        float, Field(ge=0, description="one sigma of the acceleration in a gap, m/s^2")
    ] = 1.0
    force_timeout_s: Annotated[float, Field(gt=0, description="foot forces older than this count as missing, s")] = 0.1
