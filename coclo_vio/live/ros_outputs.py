# SPDX-License-Identifier: BSD-3-Clause
"""Outputs of an estimator as messages of ROS: odometry with covariance, transforms, diagnostics.

============================ ================ ======================================================================
``/<trajectory>/odometry``   Odometry         pose of the body in ``odom``, twist in ``base_link``, both with covariance
``/tf``                      TFMessage        ``odom`` to ``base_link``, of a mode's first trajectory; a further one has
                                              ``<trajectory>/odom`` and ``<trajectory>/base_link``
``/diagnostics``             DiagnosticArray  counts of each topic that is read, what became of the samples, counts of
                                              the estimator, events
============================ ================ ======================================================================
"""

from collections.abc import Iterator, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from coclo_vio.datasets.rosbag.storage.type_definitions import TypeDefinitions
from coclo_vio.datasets.rosbag.writing.messages import BagMessages
from coclo_vio.datasets.rosbag.writing.result_writer import frames_of, ros_pose_covariance
from coclo_vio.live.topic_counts import TopicRecord
from coclo_vio.live.wire import TF_MESSAGE
from coclo_vio.runs.live_config import LiveConfig
from coclo_vio.values.arrays import Array
from coclo_vio.values.estimates import StateEstimate
from coclo_vio.values.outputs import Estimate, Event, Status, StreamStatus
from coclo_vio.values.units import NS_PER_S

ODOMETRY = "nav_msgs/msg/Odometry"
DIAGNOSTICS = "diagnostic_msgs/msg/DiagnosticArray"
_MOST_EVENTS = 20  # in one message


class OutgoingMessage(NamedTuple):
    """A message to be published: its topic, type, time and CDR."""

    topic: str
    msgtype: str
    stamp_ns: int
    data: bytes


class RosOutputs:
    """Makes the messages."""

    def __init__(self, types: TypeDefinitions, trajectories: Sequence[str], config: LiveConfig) -> None:
        """Set the frames of each trajectory.

        Args:
            types: the message types.
            trajectories: names, the first has the frames as configured.
            config: names of the frames, rate.
        """
        self._types, self._make = types, BagMessages(types)
        self._frames = {
            name: frames_of(name, is_first=number == 0, odom=config.odom_frame, body=config.body_frame)
            for number, name in enumerate(trajectories)
        }
        self._step_ns = round(NS_PER_S / config.odometry_rate_hz) if config.odometry_rate_hz else 0
        self._next_ns: dict[str, int] = {}
        self._node = config.node_name

    def of_estimate(self, estimate: Estimate) -> Iterator[OutgoingMessage]:
        """Odometry and transform; none where the one before is not long enough ago."""
        state, name = estimate.state, estimate.name
        due_ns = self._next_ns.get(name, state.stamp_ns)
        if self._step_ns:
            if due_ns - self._step_ns < state.stamp_ns < due_ns:
                return
            self._next_ns[name] = max(due_ns + self._step_ns, state.stamp_ns)
        odom, body = self._frames[name]
        pose, twist = self._make.pose(state.nav.T_world_body), self._make.twist(*body_twist(state))
        R = state.nav.T_world_body[:3, :3]
        covariances = ros_pose_covariance(state.covariance[:6, :6], R), body_twist_covariance(state)
        header = self._make.header(state.stamp_ns, odom)
        odometry = self._make.odometry(header, body, (pose, covariances[0]), (twist, covariances[1]))
        yield OutgoingMessage(f"/{name}/odometry", ODOMETRY, state.stamp_ns, self._types.serialized(odometry))
        transform = self._make.transform_of_pose(header, body, pose)
        yield OutgoingMessage("/tf", TF_MESSAGE, state.stamp_ns, self._types.serialized(self._make.tf([transform])))

    def diagnostics(
        self,
        stamp_ns: int,
        topics: Mapping[str, TopicRecord],
        counts: Mapping[str, int],
        samples: Status,
        events: Sequence[Event],
    ) -> OutgoingMessage:
        """What came, what became of it, what the estimator counted, and what happened since the message before.

        Args:
            stamp_ns: of the message.
            topics: what came, by topic.
            counts: of the estimator.
            samples: what became of those of each sensor in front of the estimator.
            events: since the message before.
        """
        statuses = [_stream_status(self._node, stream) for stream in samples.streams]
        statuses += [_topic_status(self._node, topic, record) for topic, record in topics.items()]
        values = {name: str(count) for name, count in counts.items()}
        level = 1 if events else 0
        sentence = events[-1].detail if events else "runs"
        values |= {f"event {event.kind} at {event.stamp_ns}": event.detail for event in events[-_MOST_EVENTS:]}
        statuses.insert(0, (level, f"{self._node}: estimator", sentence, values))
        message = self._make.diagnostics(stamp_ns, statuses)
        return OutgoingMessage("/diagnostics", DIAGNOSTICS, stamp_ns, self._types.serialized(message))


def body_twist(state: StateEstimate) -> tuple[Array, Array]:
    """Linear velocity, m/s, and angular velocity, rad/s, of the body, both (3,) in body axes."""
    R = state.nav.T_world_body[:3, :3]
    return np.asarray(R.T @ state.nav.velocity_world), state.nav.angular_velocity_body


def body_twist_covariance(state: StateEstimate) -> Array:
    """Covariance of the twist [linear m/s, angular rad/s] in body axes, (6, 6).

    The velocity in the world is ``v``, the attitude error is right/local: ``R = R_mean exp([phi]x)``. So the velocity
    in body axes, ``u = R^T v``, has the error ``R^T dv + [u]x phi``. The estimate has no covariance of the angular
    velocity: its block is zero, which is ROS's unknown.
    """
    R = state.nav.T_world_body[:3, :3]
    x, y, z = R.T @ state.nav.velocity_world
    J = np.zeros((3, 9))
    J[:, :3] = [[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]]
    J[:, 6:] = R.T
    covariance = np.zeros((6, 6))
    covariance[:3, :3] = J @ state.covariance @ J.T
    return covariance


def _stream_status(node: str, stream: StreamStatus) -> tuple[int, str, str, dict[str, str]]:
    values = {"arrived": stream.arrived, "used": stream.used, "late": stream.late, "held": stream.held}
    values |= {f"refused: {reason}": count for reason, count in stream.refused.items()}
    level = 1 if stream.refused else 0
    return level, f"{node}: samples of {stream.name}", str(stream), {name: str(count) for name, count in values.items()}


def _topic_status(node: str, topic: str, record: TopicRecord) -> tuple[int, str, str, dict[str, str]]:
    defects = {
        "lost": record.lost,
        "late": record.late,
        "dropped": record.dropped,
        "refused": sum(record.refused.values()),
    }
    found = ", ".join(f"{count} {name}" for name, count in defects.items() if count)
    values = {"received": str(record.received), **{name: str(count) for name, count in defects.items()}}
    values |= {f"refused: {reason}": str(count) for reason, count in record.refused.items()}
    if record.latency is not None:
        values |= {"latency p50 ms": f"{record.latency.p50_ms:.3f}", "latency p99 ms": f"{record.latency.p99_ms:.3f}"}
    return 1 if found else 0, f"{node}: {topic}", found or "all messages came", values
