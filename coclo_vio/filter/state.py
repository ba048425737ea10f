# SPDX-License-Identifier: BSD-3-Clause
"""The filter's state on its manifold, and the order and meaning of its errors.

Paper section III-B lists position, velocity, quaternion, angular velocity, gyroscope and accelerometer bias, feet and
contacts. It counts 46 states and 32 measurements for six legs; the members it lists make 43 and 33. The error state
here has 3 numbers for a rotation, so 42 of the paper's. The states in which the models bend stand first (see
``square_root``). The rate is in the body frame: the paper calls it a world rate but multiplies it from the right.
Four kinds of states are not the paper's: the relative error of the effective leg length (``LEG_SCALE``), how far a leg
gives under the load from which it stands (``LEG_COMPLIANCE``, m), and how all standing feet seem to slip together
(``SLIP_TURN``, rad/m, and ``SLIP``, a share of the body's speed, both in body axes) stay zero and certain where they
are not estimated; what is wrong with the cameras is there where frames are remembered, in either profile.

A rotation error turns the world: ``R = exp(e) R_mean``, and with it everything measured in the world,
``v = exp(e) (v_mean + e_v)`` and the same for position and feet (right-invariant error; Barrau and Bonnabel, "The
invariant extended Kalman filter as a stable observer", 2017). Legs and IMU cannot see a turned or shifted world, and
with this error their sigma points do not see it either: yaw never becomes falsely observable, however large its
uncertainty. ``plain_jacobian`` leads from these errors to ordinary ones.
"""

from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from coclo_vio.filter.unscented_transform import SigmaSpread
from coclo_vio.geometry import so3
from coclo_vio.values.arrays import Array

ROTATION = slice(0, 3)
LEG_SCALE = slice(3, 4)
RATE = slice(4, 7)
GYROSCOPE_BIAS = slice(7, 10)
ACCELEROMETER_BIAS = slice(10, 13)
LEG_COMPLIANCE = slice(13, 14)
SLIP_TURN = slice(14, 17)
SLIP = slice(17, 20)
VELOCITY = slice(20, 23)
POSITION = slice(23, 26)
_BODY = 26


@dataclass(frozen=True)  # no slots: where things stand is worked out once
class StateLayout:
    """Where the errors of feet, contacts and cloned poses stand behind the 26 of the body.

    Attributes:
        legs: number of legs.
        has_contacts: whether contact probabilities are states (paper) or taken from the detector (robust).
        has_frame: whether two further poses are cloned: that of a camera frame whose result is still to come, and the
            anchor, where whoever looks at frames began.
    """

    legs: int
    has_contacts: bool
    has_frame: bool = False

    @cached_property
    def world(self) -> slice:
        """Velocity, position and feet: all vectors that turn with the world, (2 + legs) x 3 errors."""
        return slice(VELOCITY.start, _BODY + 3 * self.legs)

    @cached_property
    def feet(self) -> slice:
        """Foot centres, world frame, m, leg by leg."""
        return slice(_BODY, _BODY + 3 * self.legs)

    @cached_property
    def contacts(self) -> slice:
        """Contact probabilities; empty where they are no states."""
        return slice(self.feet.stop, self.feet.stop + self.legs * self.has_contacts)

    @cached_property
    def keyframe_rotation(self) -> slice:
        """Rotation error of the cloned keyframe pose, turning its position."""
        return slice(self.contacts.stop, self.contacts.stop + 3)

    @cached_property
    def keyframe_position(self) -> slice:
        """Position of the cloned keyframe pose, world frame, m."""
        return slice(self.contacts.stop + 3, self.contacts.stop + 6)

    @cached_property
    def frame_rotation(self) -> slice:
        """Rotation error of the frame's pose; empty where no frame is remembered."""
        start = self.keyframe_position.stop
        return slice(start, start + 3 * self.has_frame)

    @cached_property
    def frame_position(self) -> slice:
        """Position of the frame's pose, world frame, m; empty where no frame is remembered."""
        start = self.frame_rotation.stop
        return slice(start, start + 3 * self.has_frame)

    @cached_property
    def anchor_rotation(self) -> slice:
        """Rotation error of the anchor; empty where no frame is remembered."""
        start = self.frame_position.stop
        return slice(start, start + 3 * self.has_frame)

    @cached_property
    def anchor_position(self) -> slice:
        """Position of the anchor, world frame, m; empty where no frame is remembered."""
        start = self.anchor_rotation.stop
        return slice(start, start + 3 * self.has_frame)

    @cached_property
    def camera(self) -> slice:
        """How eyes see the world wrongly: turn (3, rad) and stretch (1); empty where no frame is remembered."""
        start = self.anchor_position.stop
        return slice(start, start + 4 * self.has_frame)

    @cached_property
    def dimension(self) -> int:
        """Length of the error state."""
        return int(self.camera.stop)


@dataclass(frozen=True, slots=True)
class State:
    """One state, or a stack of sigma points of it.

    Attributes:
        layout: the order of ``vector``.
        rotation: ``R_world_body``, (..., 3, 3).
        vector: everything else, (..., L); the places of the rotations are zero and mean nothing.
        keyframe_rotation: ``R_world_keyframe`` of the mean, (3, 3).
        frame_rotation: ``R_world_frame`` of the mean, (3, 3).
        anchor_rotation: ``R_world_anchor`` of the mean, (3, 3).
    """

    layout: StateLayout
    rotation: Array
    vector: Array
    keyframe_rotation: Array
    frame_rotation: Array = field(default_factory=lambda: np.eye(3))
    anchor_rotation: Array = field(default_factory=lambda: np.eye(3))

    @property
    def feet(self) -> Array:
        """Foot centres in the world, m, (..., legs, 3)."""
        return self.vector[..., self.layout.feet].reshape(*self.vector.shape[:-1], self.layout.legs, 3)

    def spread(self, errors: Array) -> "State":
        """The stack of states that differ from this mean by error vectors (points, L); clones are left alone."""
        return self._spread(errors, so3.exp(errors[:, ROTATION]))

    def _spread(self, errors: Array, turn: Array) -> "State":
        world = self.layout.world
        vector = self.vector + errors
        turned = vector[:, world].reshape(len(errors), -1, 3) @ np.swapaxes(turn, -1, -2)
        vector[:, world] = turned.reshape(len(errors), -1)
        return replace(self, rotation=turn @ self.rotation, vector=vector)

    def corrected(self, step: Array) -> "State":
        """This mean moved by one error vector (L,), the clones with it."""
        layout = self.layout
        steps = [step[ROTATION], step[layout.keyframe_rotation]]
        if layout.has_frame:
            steps += [step[layout.frame_rotation], step[layout.anchor_rotation]]
        turn, *turns = so3.exp(np.stack(steps))
        moved = self._spread(step[None], turn[None])
        vector = moved.vector[0]
        places = layout.keyframe_position, layout.frame_position, layout.anchor_position
        for at, its_turn in zip(places, turns, strict=False):
            vector[at] = its_turn @ (self.vector[at] + step[at])
        self._clear_rotations(vector)
        before = self.keyframe_rotation, self.frame_rotation, self.anchor_rotation
        rotations = [its_turn @ rotation for its_turn, rotation in zip(turns, before, strict=False)]
        return State(layout, moved.rotation[0], vector, *rotations)

    def _clear_rotations(self, vector: Array) -> None:
        layout = self.layout
        for at in (ROTATION, layout.keyframe_rotation, layout.frame_rotation, layout.anchor_rotation):
            vector[at] = 0.0

    def errors_of(self, stack: "State") -> Array:
        """Error vectors (points, L) of a stack of states about this mean; inverse of ``spread``."""
        turn = stack.rotation @ self.rotation.T
        world = self.layout.world
        errors = stack.vector - self.vector
        turned_back = stack.vector[:, world].reshape(len(errors), -1, 3) @ turn
        errors[:, world] = turned_back.reshape(len(errors), -1) - self.vector[world]
        errors[:, ROTATION] = so3.log_below_pi(turn)
        return errors

    def mean_and_deviations(self, points: SigmaSpread) -> tuple["State", Array]:
        """The weighted mean of this stack of sigma points, and their error vectors (points, L) about it.

        The mean is one Gauss-Newton step from the centre, exact to third order in the spread.
        """
        layout = self.layout
        vector = self.vector[0].copy()
        self._clear_rotations(vector)
        centre = replace(self, rotation=self.rotation[0], vector=vector)
        shift = points.mean(centre.errors_of(self))
        shift[layout.keyframe_rotation.start :] = 0.0
        mean = centre.corrected(shift)
        deviations = mean.errors_of(self)
        return mean, deviations

    def plain_jacobian(self) -> Array:
        """d(plain) / d(error), (9, L): plain = [rotation (body), position (body), velocity (world)].

        The plain errors are those of ``StateEstimate``: ``T = T_mean exp([rotation, position])``.
        """
        to_body = self.rotation.T
        jacobian = np.zeros((9, self.layout.dimension))
        jacobian[0:3, ROTATION] = to_body
        jacobian[3:6, POSITION] = to_body
        jacobian[3:6, ROTATION] = -to_body @ so3.hat(self.vector[POSITION])
        jacobian[6:9, VELOCITY] = np.eye(3)
        jacobian[6:9, ROTATION] = -so3.hat(self.vector[VELOCITY])
        return jacobian
