# SPDX-License-Identifier: BSD-3-Clause
"""Whether joint readings make a walking robot: within limits, feet below the hips on one plane, distances kept.

Of several orders or signs of the joints the one with the lowest score is the right one.
"""

import numpy as np

from coclo_vio.adoption.recorded_legs import RecordedLegs
from coclo_vio.robot.model import RobotModel
from coclo_vio.robot.urdf_tree import UrdfTree
from coclo_vio.values.arrays import Array, IntArray

_SAMPLES = 120
_MARGIN_RAD = 0.1
_PLANE_M, _STRETCH_MPS, _BELOW_M = 0.02, 0.1, 0.05


class Posture:
    """Scores of joint readings at some samples at rest and some in motion.

    Args:
        robot: the legs.
        tree: its URDF, for the limits.
        recorded: the log, from which the samples are chosen.
    """

    def __init__(self, robot: RobotModel, tree: UrdfTree, recorded: RecordedLegs) -> None:
        self._robot = robot
        joints = [tree.joints[name] for name in robot.joint_names]
        self._lower: Array = np.array([joint.lower for joint in joints]) - _MARGIN_RAD
        self._upper: Array = np.array([joint.upper for joint in joints]) + _MARGIN_RAD
        is_rest = recorded.is_rest()
        speed = np.nan_to_num(np.abs(recorded.velocity)).sum(axis=1)
        moving = np.flatnonzero(speed > np.median(speed))
        self._rest = _some(np.flatnonzero(is_rest), _SAMPLES // 4)
        self._moving = _some(moving, _SAMPLES)
        legs = len(robot.leg_names)
        standing = max(legs // 2, 2)  # that many stand at any time
        self._pairs = np.triu_indices(legs, 1)
        self._standing_pairs = standing * (standing - 1) // 2

    def score(self, position: Array, velocity: Array) -> float:
        """Low for readings (N, J) of a walking robot, about 1 and less; each violation adds to it."""
        outside = self.outside(position)
        return 20.0 * float(outside.mean()) + self._of_rest(position, velocity) + self._of_motion(position, velocity)

    def outside(self, position: Array) -> Array:
        """The share of samples in which a joint is beyond its limits, (J,)."""
        values = position[np.concatenate((self._rest, self._moving))]
        return np.asarray(((values < self._lower) | (values > self._upper)).mean(axis=0))

    def _of_rest(self, position: Array, velocity: Array) -> float:
        rows = self._rest if len(self._rest) else self._moving[: _SAMPLES // 4]
        feet = np.array([self._robot.feet(position[row], velocity[row]).position_body for row in rows])
        above = np.maximum(feet[:, :, 2] - self._robot.hip_position_body[:, 2] + _BELOW_M, 0.0).mean()
        side = feet[:, :, 1].mean(axis=0) * self._robot.hip_position_body[:, 1]
        crossed = float((side < 0.0).mean())  # a foot under the other side of the body
        bent = 0.0
        if len(self._rest) and feet.shape[1] > 2:
            points = feet.mean(axis=0)
            points = points - points.mean(axis=0)
            singular = np.linalg.svd(points, full_matrices=False)
            normal = singular[2][2]
            bent = float(singular[1][2] / np.sqrt(len(points))) / _PLANE_M + (1.0 - abs(float(normal[2]))) * 10.0
        return float(above) / _BELOW_M + crossed + bent

    def _of_motion(self, position: Array, velocity: Array) -> float:
        """How much the distances change that change least: those of feet that stand."""
        feet = [self._robot.feet(position[row], velocity[row]) for row in self._moving]
        places = np.array([each.position_body for each in feet])
        rates = np.array([each.velocity_body for each in feet])
        first, second = self._pairs
        apart, change = places[:, first] - places[:, second], rates[:, first] - rates[:, second]
        stretch = np.abs((apart * change).sum(axis=2)) / np.maximum(np.linalg.norm(apart, axis=2), 1e-6)
        return float(np.median(np.sort(stretch, axis=1)[:, self._standing_pairs - 1])) / _STRETCH_MPS


def _some(rows: IntArray, count: int) -> IntArray:
    """About ``count`` of these rows, evenly."""
    return rows if len(rows) <= count else rows[np.linspace(0, len(rows) - 1, count).astype(int)]
