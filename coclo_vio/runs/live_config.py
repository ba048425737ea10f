# SPDX-License-Identifier: BSD-3-Clause
"""How the estimator runs on a wire: what is waited for, how much is held, what is published."""

from typing import Annotated, Literal

from pydantic import Field

from coclo_vio.values.config import StageConfig


class ZenohConfig(StageConfig):
    """The zenoh session; without a file as rmw_zenoh sets it up: a peer, no multicast."""

    config_file: Annotated[
        str | None, Field(description="zenoh's own configuration (JSON5) in place of what follows; null: none")
    ] = None
    connect: Annotated[
        tuple[str, ...], Field(description="endpoints to connect to; --endpoint is in their place where it is given")
    ] = ("tcp/localhost:7447",)
    listen: Annotated[tuple[str, ...], Field(description="endpoints to listen on; empty: none")] = ()


class LiveConfig(StageConfig):
    """Running on a wire."""

    distribution: Annotated[
        Literal["humble", "iron", "jazzy", "kilted"],
        Field(description="the distribution of ROS 2 whose message definitions and type hashes count"),
    ] = "jazzy"
    definitions: dict[str, str] = Field(
        default_factory=dict,
        description="message type: path of its .msg file, for types outside the distribution that are read by "
        "dataset.rosbag.fields",
    )
    zenoh: Annotated[ZenohConfig, Field(description="the zenoh session")] = ZenohConfig()
    first_messages_s: Annotated[
        float, Field(gt=0, le=60, description="messages are gathered for this long before topics are chosen, s")
    ] = 2.0
    wait_s: Annotated[float, Field(gt=0, description="an error where what the mode needs has not come by then, s")] = (
        60.0
    )
    idle_s: Annotated[
        float, Field(ge=0, description="the run ends where no message came for this long, s; 0: it never does")
    ] = 0.0
    unstamped: Annotated[
        Literal["sent", "arrived"],
        Field(description="time of messages without a header: when they were sent, by the sender's clock, or arrived"),
    ] = "sent"
    most_messages: Annotated[
        int, Field(ge=1, description="messages that wait for the estimator; further ones are dropped and counted")
    ] = 2000
    most_images: Annotated[
        int, Field(ge=2, description="images that wait for the estimator; the oldest are dropped before anything else")
    ] = 8
    node_name: Annotated[str, Field(min_length=1, description="name of the node on the wire")] = "coclo_vio"
    odom_frame: Annotated[str, Field(min_length=1, description="frame of the published poses")] = "odom"
    body_frame: Annotated[str, Field(min_length=1, description="frame of the body")] = "base_link"
    odometry_rate_hz: Annotated[
        float, Field(ge=0, description="odometry and transforms are published at most this often, Hz; 0: all")
    ] = 0.0
    diagnostics_s: Annotated[float, Field(gt=0, description="diagnostics are published this often, s")] = 1.0
    event_s: Annotated[
        float, Field(ge=0, description="of refused messages of one topic and reason one event in this time, s")
    ] = 1.0
    publishes: Annotated[bool, Field(description="whether odometry, tf and diagnostics go out on the wire")] = True
    records: Annotated[bool, Field(description="whether what came and what went out is recorded as MCAP")] = True
