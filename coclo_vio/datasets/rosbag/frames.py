# SPDX-License-Identifier: BSD-3-Clause
"""Mountings in a bag: the static transforms between named frames (REP 105), and poses in messages."""

from collections import deque
from collections.abc import Iterable
from typing import Any

import numpy as np

from coclo_vio.arrays import Array
from coclo_vio.datasets.rosbag.storage.bag_file import BagFile
from coclo_vio.geometry import se3, so3

_BODY_FRAMES = ("base_link", "base", "trunk", "body", "torso", "pelvis", "base_footprint")
_SHORTEST_QUATERNION = 0.5


class FrameTree:
    """Static transforms, and what follows from chains of them."""

    def __init__(self, transforms: Iterable[Any] = ()) -> None:
        """Take TransformStamped messages; those without a rotation are left out."""
        self._T: dict[str, dict[str, Array]] = {}
        for transform in transforms:
            parent, child = str(transform.header.frame_id).lstrip("/"), str(transform.child_frame_id).lstrip("/")
            T_parent_child = pose_of(transform.transform.translation, transform.transform.rotation)
            if T_parent_child is not None:
                self._T.setdefault(parent, {})[child] = T_parent_child
                self._T.setdefault(child, {})[parent] = se3.inverse(T_parent_child)

    @property
    def frames(self) -> tuple[str, ...]:
        """All frames that are known."""
        return tuple(self._T)

    def body(self, *wanted: str | None) -> str:
        """The body's frame: the first of ``wanted`` that is given, otherwise the usual name that is there."""
        named = next((name for name in wanted if name), None)
        return named or next((name for name in _BODY_FRAMES if name in self._T), _BODY_FRAMES[0])

    def between(self, a: str, b: str) -> Array | None:
        """``T_a_b`` (4, 4) along the chain between two frames, None where there is none."""
        if a == b:
            return np.eye(4)
        reached = {a: np.eye(4)}
        open_ends = deque([a])
        while open_ends:
            frame = open_ends.popleft()
            for neighbour, T_frame_neighbour in self._T.get(frame, {}).items():
                if neighbour not in reached:
                    reached[neighbour] = reached[frame] @ T_frame_neighbour
                    open_ends.append(neighbour)
        return reached.get(b)


def read_frames(bag: BagFile, topic: str) -> FrameTree:
    """The static transforms on a TFMessage topic, read to the end of the bag; none where there is no such topic.

    Raises:
        DatasetError: the topic holds something else.
    """
    if topic not in bag.topics:
        return FrameTree()
    messages = (bag.readable(topic, data) for _, _, data in bag.messages([topic]))
    return FrameTree(transform for message in messages for transform in getattr(message, "transforms", ()))


def pose_of(position: Any, orientation: Any) -> Array | None:
    """The transform (4, 4) of a position and a quaternion as ROS holds them; None without a finite rotation."""
    quat_xyzw = np.array([orientation.x, orientation.y, orientation.z, orientation.w])
    translation = np.array([position.x, position.y, position.z])
    if not np.isfinite(translation).all() or not np.linalg.norm(quat_xyzw) > _SHORTEST_QUATERNION:
        return None
    if not np.isfinite(quat_xyzw).all():
        return None
    return se3.transform(so3.from_quat_xyzw(quat_xyzw), translation)
