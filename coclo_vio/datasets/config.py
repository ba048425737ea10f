# SPDX-License-Identifier: BSD-3-Clause
"""How recordings are read: column names, time order, and estimates for missing readings."""

from typing import Annotated

from pydantic import Field

from coclo_vio.datasets.columns import ColumnNames
from coclo_vio.datasets.corrections import Corrections
from coclo_vio.datasets.joint_velocity import JointVelocityConfig
from coclo_vio.datasets.rosbag.config import RosbagConfig
from coclo_vio.values.config import StageConfig


class DatasetConfig(StageConfig):
    """Configuration of the readers."""

    columns: Annotated[ColumnNames, Field(description="patterns of column names")] = ColumnNames()
    joint_velocity: Annotated[
        JointVelocityConfig, Field(description="estimation of joint velocities that a log lacks")
    ] = JointVelocityConfig()
    sort: Annotated[
        bool, Field(description="sort measurements by time (holds all of them in memory); otherwise as in the file")
    ] = False
    spreads_bursts: Annotated[
        bool,
        Field(
            description="spread joint samples that came in a burst evenly over the pause before it: they were stamped "
            "on arrival"
        ),
    ] = True
    corrections: Annotated[
        Corrections, Field(description="units, axes and clocks of the recording that are not as they should be")
    ] = Corrections()
    rosbag: Annotated[RosbagConfig, Field(description="how a rosbag is read")] = RosbagConfig()
    allow_partial: Annotated[
        bool,
        Field(
            description="read a damaged recording as far as possible and leave out the rest: data after the damage, "
            "missing joints, samples whose stamps go back; the report counts them. Readings that physics contradicts "
            "are used as they are"
        ),
    ] = False
    frame_rate_hz: Annotated[
        float, Field(gt=0, le=1e6, description="rate of image pairs in a recording without stamps, Hz")
    ] = 10.0
    reading_threads: Annotated[
        int, Field(ge=0, le=1, description="threads beside the estimator's that read and decode ahead of it")
    ] = 0
    gap_s: Annotated[
        float, Field(gt=0, description="a pause counts as a gap if it is longer than this and than 2.5 median steps, s")
    ] = 0.1
