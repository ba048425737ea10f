# SPDX-License-Identifier: BSD-3-Clause
"""Limits of what drivers may do to stamps before samples are refused, and how long is waited for a missing one."""

from typing import Annotated

from pydantic import Field

from coclo_vio.values.config import StageConfig


class LatencyConfig(StageConfig):
    """How long a sample of each stream may be under way longer than others; nothing waits for images."""

    joints_s: Annotated[float, Field(ge=0, le=1, description="joint samples, s; 0: nothing waits for them")] = 0.03
    imu_s: Annotated[float, Field(ge=0, le=1, description="readings of the body's IMU, s")] = 0.03
    foot_force_s: Annotated[float, Field(ge=0, le=1, description="foot forces, s")] = 0.03
    camera_imu_s: Annotated[float, Field(ge=0, le=1, description="readings of the cameras' IMU, s")] = 0.005
    body_twist_s: Annotated[float, Field(ge=0, le=1, description="body twists, s")] = 0.03


class OnlineConfig(StageConfig):
    """The guard in front of every estimator."""

    latency: Annotated[LatencyConfig, Field(description="how long is waited for a missing sample")] = LatencyConfig()
    future_s: Annotated[
        float, Field(gt=0, le=3600, description="a stamp further ahead of the newest of all streams is in doubt, s")
    ] = 1.0
    past_s: Annotated[
        float, Field(gt=0, le=3600, description="a stamp further behind the newest of all streams is in doubt, s")
    ] = 1.0
    step_samples: Annotated[
        int, Field(ge=3, le=1000, description="so many samples in doubt that agree are a clock that stepped")
    ] = 10
    step_images: Annotated[int, Field(ge=2, le=1000, description="the same for images and tracks")] = 3
    longest_pause_s: Annotated[
        float,
        Field(
            ge=0,
            description="without times of arrival: where all streams jump ahead by at most this, no sample came for "
            "that time; by more, the clock stepped, s",
        ),
    ] = 60.0
    step_gap_s: Annotated[
        float, Field(ge=0, le=60, description="one sigma of the unknown time that passed while the clock stepped, s")
    ] = 0.1
    silent_s: Annotated[
        float,
        Field(ge=0, description="a stream that gives nothing for longer, while others go on, is reported, s; 0: none"),
    ] = 0.5
    constant_readings: Annotated[
        int,
        Field(
            ge=0,
            description="an IMU that gives the same reading so often in a row, or six times and three times as often "
            "as it ever did before, is reported and left out until it changes; 0: never",
        ),
    ] = 25
    leaves_out_saturated: Annotated[
        bool,
        Field(
            description="readings of a gyroscope at its limit, which is found where an axis stays the same to the bit "
            "while the others change, are reported and left out"
        ),
    ] = True
    joint_interval_s: Annotated[
        float,
        Field(
            ge=0,
            le=0.1,
            description="joint samples and foot forces that follow sooner are left out and counted, for computers that "
            "do not keep pace with all of them, s; 0: none is",
        ),
    ] = 0.0
    status_every_s: Annotated[
        float, Field(ge=0, description="a Status comes out this often, s; 0: never, it can be read at any time")
    ] = 1.0
