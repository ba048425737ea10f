# SPDX-License-Identifier: BSD-3-Clause
"""What goes wrong with joints, ground truth and a robot's description: each a change of a content."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from coclo_vio.experiments.contradictions.content import Content
from coclo_vio.geometry import se3, so3
from coclo_vio.robot.description import RobotDescription
from coclo_vio.values.arrays import Array
from coclo_vio.values.measurements import JointSample
from coclo_vio.values.trajectory import Trajectory

Change = Callable[[Content], Content]
_Readings = tuple[Array, Array, Array]


def joints(change: Callable[[Array, Array, Array], _Readings]) -> Change:
    """Change the joints' readings; the function takes and returns angles, velocities and torques, (J,) each."""

    def changed(sample: JointSample) -> JointSample:
        return JointSample(sample.stamp_ns, *change(sample.position, sample.velocity, sample.effort))

    return lambda content: content.changed(JointSample, changed)


def still(content: Content) -> Content:
    """All angles keep their first value."""
    first = next(each for each in content.measurements if isinstance(each, JointSample)).position
    return joints(lambda _, velocity, effort: (first, velocity, effort))(content)


def negated(*which: int) -> Change:
    """Some joints have the other sign."""

    def change(position: Array, velocity: Array, effort: Array) -> _Readings:
        signs = np.ones(len(position))
        signs[list(which)] = -1.0
        return signs * position, signs * velocity, signs * effort

    return joints(change)


def ordered(*legs: int) -> Change:
    """The legs of three joints come in another order."""
    order = [3 * leg + joint for leg in legs for joint in range(3)]
    return joints(lambda position, velocity, effort: (position[order], velocity[order], effort[order]))


def truth(change: Callable[[Array, Array], tuple[Array, Array]]) -> Change:
    """Change the reference trajectory; the function takes and returns rotations (N, 3, 3) and positions (N, 3)."""

    def changed(content: Content) -> Content:
        given = content.truth
        if given is None:
            return content
        poses = change(given.trajectory.rotations.copy(), given.trajectory.positions.copy())
        trajectory = Trajectory(given.trajectory.stamps_ns, se3.transform(*poses))
        return replace(content, truth=replace(given, trajectory=trajectory))

    return changed


def scalar_first(rotations: Array, positions: Array) -> tuple[Array, Array]:
    """Quaternions in the order w x y z where x y z w is read."""
    return so3.from_quat_xyzw(np.roll(so3.to_quat_xyzw(rotations), 1, axis=1)), positions


def jumping(rotations: Array, positions: Array) -> tuple[Array, Array]:
    """Single poses far away."""
    positions[[50, 51, 300, 420]] += [2.0, -1.0, 0.5]
    return rotations, positions


def lost(rotations: Array, positions: Array) -> tuple[Array, Array]:
    """Poses at the origin while the tracker does not see the body."""
    rotations[100:140], positions[100:140] = np.eye(3), 0.0
    return rotations, positions


def described(**changes: Any) -> Change:
    """The robot's description has other values."""
    return lambda content: replace(content, description=content.robot.model_copy(update=changes))


def foot_frames(frame: str) -> Change:
    """Every leg's foot frame is another link: ``{leg}`` stands for the leg's name."""

    def change(content: Content) -> Content:
        legs = tuple(each.model_copy(update={"foot_frame": frame.format(leg=each.name)}) for each in content.robot.legs)
        return described(legs=legs)(content)

    return change


def without_last_joints(content: Content) -> Content:
    """The description lists two of the three joints of each leg."""
    robot: RobotDescription = content.robot
    legs = tuple(each.model_copy(update={"joints": each.joints[:2]}) for each in robot.legs)
    return described(legs=legs)(content)
