# SPDX-License-Identifier: BSD-3-Clause
"""What the window holds, as a value for a view."""

import numpy as np

from coclo_vio.backend.window.window import Window
from coclo_vio.values.outputs import WindowSnapshot


def snapshot_of(window: Window) -> WindowSnapshot:
    """The poses of the keyframes and the positions of the landmarks that were solved."""
    poses = [window.pose(keyframe.number) for keyframe in window.keyframes]
    points = [window.landmarks.point(landmark_id) for landmark_id in window.solved_landmarks]
    return WindowSnapshot(window.newest.stamp_ns, np.array(poses), np.array(points).reshape(len(points), 3))
