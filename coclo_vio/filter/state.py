# SPDX-License-Identifier: BSD-3-Clause
"""The filter's state on its manifold, and the order and meaning of its errors.

Paper section III-B lists position, velocity, quaternion, angular velocity, gyroscope and accelerometer bias, feet and
contacts. It counts 46 states and 32 measurements for six legs; the members it lists make 43 and 33. The error state
here has 3 numbers for a rotation, so 42 of the paper's. The states in which the models are nonlinear come first (see
``unscented_transform``). The rate is in the body frame: the paper calls it a world rate but multiplies it from the
right. Four kinds of states are not the paper's: the relative error of the effective leg length (``LEG_SCALE``), the
compression of a leg under the load from which it stands (``LEG_COMPLIANCE``, m), and the common slip of all standing
feet (``SLIP_TURN``, rad/m, and ``SLIP``, a share of the body's speed, both in body axes) are zero and certain where
they are not estimated; the errors of the cameras' calibration are there where frames are remembered, in either profile.

A rotation error turns the world: ``R = exp(e) R_mean``, and with it everything measured in the world,
``v = exp(e) (v_mean + e_v)`` and the same for position and feet (right-invariant error; Barrau and Bonnabel, "The
invariant extended Kalman filter as a stable observer", 2017). Legs and IMU cannot observe a rotation about the vertical
or a shift of the world, and with this error neither do their sigma points: yaw never becomes falsely observable,
however large its uncertainty. ``plain_jacobian`` leads from these errors to ordinary ones.
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


@dataclass(frozen=True)  # no slots: each slice is computed once
class StateLayout:
    """Order of the errors of feet, contacts, remembered poses and cameras behind the 26 of the body.

    Attributes:
        legs: number of legs.
        has_contacts: whether contact probabilities are states (paper) or taken from the detector (robust).
        has_frame: whether two further poses are remembered, of a camera frame whose result is still to come and of the
            anchor keyframe, and the errors of the cameras' calibration.
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
        """Rotation error of the keyframe's pose, which rotates its position."""
        return slice(self.contacts.stop, self.contacts.stop + 3)

    @cached_property
    def keyframe_position(self) -> slice:
        """Position of the keyframe, world frame, m."""
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
        """Errors of the cameras: mounting (3, rad), relative error of stereo lengths; empty without frames."""
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
        vector: everything else, (..., L); the entries of the rotations are zero and unused.
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
        """The stack of states that differ from this mean by error vectors (points, L); remembered poses do not move."""
        return self._spread(errors, so3.exp(errors[:, ROTATION]))

    def _spread(self, errors: Array, turn: Array) -> "State":
        world = self.layout.world
        vector = self.vector + errors
        turned = vector[:, world].reshape(len(errors), -1, 3) @ np.swapaxes(turn, -1, -2)
        vector[:, world] = turned.reshape(len(errors), -1)
        return replace(self, rotation=turn @ self.rotation, vector=vector)

    def corrected(self, step: Array) -> "State":
        """This mean moved by one error vector (L,), remembered poses included."""
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
