# SPDX-License-Identifier: BSD-3-Clause
"""How recordings are read: column names, order, and what is estimated where a log is silent."""

from typing import Annotated

from pydantic import Field

from coclo_vio.datasets.columns import ColumnNames
from coclo_vio.datasets.joint_velocity import JointVelocityConfig
from coclo_vio.datasets.rosbag.config import RosbagConfig
from coclo_vio.values.config import StageConfig


class DatasetConfig(StageConfig):
    """Everything a reader may be told."""

    columns: Annotated[ColumnNames, Field(description="patterns of column names")] = ColumnNames()
    joint_velocity: Annotated[
        JointVelocityConfig, Field(description="the estimate where a log has no joint velocity")
    ] = JointVelocityConfig()
    sort: Annotated[
        bool, Field(description="put measurements in time order (holds them all in memory); else as in the file")
    ] = False
    rosbag: Annotated[RosbagConfig, Field(description="how a rosbag is read")] = RosbagConfig()
    allow_partial: Annotated[
        bool,
        Field(
            description="take what can be read of a damaged bag, and leave out what cannot: what comes after a break, "
            "joints that are missing, samples whose stamps go back; the report tells of it"
        ),
    ] = False
    frame_rate_hz: Annotated[
        float, Field(gt=0, le=1e6, description="pairs of images a second in a recording without stamps, Hz")
    ] = 10.0
    gap_s: Annotated[
        float, Field(gt=0, description="a longer pause is counted as a gap, if it is 2.5 usual steps too, s")
    ] = 0.1
