# SPDX-License-Identifier: BSD-3-Clause
"""The filter's state on its manifold, and the order and meaning of its errors.

Paper section III-B lists position, velocity, quaternion, angular velocity, gyroscope and accelerometer bias, feet and
contacts. It counts 46 states and 32 measurements for six legs; the members it lists make 43 and 33. The error state
here has 3 numbers for a rotation, so 42 of the paper's. The states in which the models are nonlinear come first (see
``unscented_transform``). The rate is in the body frame: the paper calls it a world rate but multiplies it from the
right. Six kinds of states are not the paper's: the relative errors of the
gyroscope's scale (``GYROSCOPE_SCALE``, each axis) and of the effective leg length (``LEG_SCALE``), the compression of a
leg under the load from which it stands (``LEG_COMPLIANCE``, m), and the common slip of all standing feet
(``SLIP_TURN``, rad/m, and ``SLIP``, a share of the body's speed, and ``LOAD_SLIP``, a share of the speed of their
takeover of weight, all in body axes) are zero and certain where they are not estimated; the errors of the cameras'
calibration are there where frames are remembered, in either profile.

A rotation error turns the world: ``R = exp(e) R_mean``, and with it everything measured in the world,
``v = exp(e) (v_mean + e_v)`` and the same for position and feet (right-invariant error; Barrau and Bonnabel, "The
invariant extended Kalman filter as a stable observer", 2017). Legs and IMU cannot observe a rotation about the vertical
or a shift of the world, and with this error neither do their sigma points: yaw never becomes falsely observable,
however large its uncertainty. ``plain_jacobian`` leads from these errors to ordinary ones.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from coclo_vio.filter.config import InitialConfig, RobustConfig
from coclo_vio.filter.state_blocks import Curvature, Retraction, StateBlock, body_blocks
from coclo_vio.filter.unscented_transform import SigmaSpread
from coclo_vio.geometry import se3, so3
from coclo_vio.values.arrays import Array, IntArray
from coclo_vio.values.calibration import ImuCalibration
from coclo_vio.values.errors import FilterError


@dataclass(frozen=True)  # no slots: what is derived is computed once
class StateLayout:
    """The order of the errors, and all that follows from the declaration of their blocks.

    Curved blocks come first (see ``unscented_transform``), passive ones last; otherwise the order is as declared.

    Attributes:
        blocks: in order.

    Raises:
        FilterError: two blocks of one name, or vectors of the world that do not follow one another.
    """

    blocks: tuple[StateBlock, ...]

    def __post_init__(self) -> None:
        blocks = sorted(self.blocks, key=lambda block: (block.is_passive, block.curvature.value))
        object.__setattr__(self, "blocks", tuple(blocks))
        names = [block.name for block in blocks]
        if len(set(names)) < len(names):
            raise FilterError(f"the state has two blocks of one name: {', '.join(names)}; give the new block its own")
        in_world = [row for row, block in enumerate(blocks) if block.retraction is Retraction.WORLD]
        if in_world != list(range(in_world[0], in_world[-1] + 1)):
            raise FilterError(
                f"the vectors of the world are not together: {', '.join(names)}; declare the new block after the feet"
            )

    @cached_property
    def _slices(self) -> dict[str, slice]:
        ends = np.cumsum([block.size for block in self.blocks]).tolist()
        starts = [0, *ends[:-1]]
        return {block.name: slice(*ends_of) for block, *ends_of in zip(self.blocks, starts, ends, strict=True)}

    def at(self, name: str) -> slice:
        """The errors of a block.

        Raises:
            FilterError: no block has this name.
        """
        if name not in self._slices:
            raise FilterError(f"the state has no block {name!r}; there are {', '.join(self._slices)}")
        return self._slices[name]

    def rotation_of(self, name: str) -> slice:
        """The rotation error of a remembered pose, which rotates its position."""
        start = self.at(name).start
        return slice(start, start + 3)

    def position_of(self, name: str) -> slice:
        """The position of a remembered pose, world frame, m."""
        stop = self.at(name).stop
        return slice(stop - 3, stop)

    @cached_property
    def poses(self) -> tuple[str, ...]:
        """Names of the remembered poses, in order."""
        return tuple(block.name for block in self.blocks if block.retraction is Retraction.POSE)

    @cached_property
    def rotations(self) -> tuple[slice, ...]:
        """All rotation errors: of the body, then of the remembered poses."""
        return (ROTATION, *(self.rotation_of(name) for name in self.poses))

    @cached_property
    def world(self) -> slice:
        """Velocity, position and feet: all vectors that turn with the world."""
        in_world = [self._slices[block.name] for block in self.blocks if block.retraction is Retraction.WORLD]
        return slice(in_world[0].start, in_world[-1].stop)

    @cached_property
    def feet(self) -> slice:
        """Foot centres, world frame, m, leg by leg."""
        return self.at("feet")

    @cached_property
    def legs(self) -> int:
        """Number of legs."""
        return int(self.feet.stop - self.feet.start) // 3

    @cached_property
    def has_contacts(self) -> bool:
        """Whether contact probabilities are states (paper) or taken from the detector (robust)."""
        return "contacts" in self._slices

    @cached_property
    def has_frame(self) -> bool:
        """Whether the poses of a camera frame and of the anchor and the cameras' errors are states."""
        return "frame" in self._slices

    @cached_property
    def active(self) -> int:
        """Number of errors that process and measurements touch; those of remembered poses and cameras follow."""
        return sum(block.size for block in self.blocks if not block.is_passive)

    @cached_property
    def dimension(self) -> int:
        """Length of the error state."""
        return sum(block.size for block in self.blocks)

    @cached_property
    def curved_in_process(self) -> int:
        """Number of leading errors in which the prediction is not linear."""
        return sum(block.size for block in self.blocks if block.curvature is not Curvature.FLAT)

    @cached_property
    def curved_in_measurement(self) -> int:
        """Number of leading errors in which the measurements are not linear."""
        curved = Curvature.PROCESS_AND_MEASUREMENT
        return sum(block.size for block in self.blocks if block.curvature is curved)

    def sigmas(self, *, is_moving: bool) -> Array:
        """One sigma of each error at the start, from rest or on the move, (L,)."""
        sigmas = [
            block.moving_sigma if is_moving and block.moving_sigma is not None else block.sigma for block in self.blocks
        ]
        return self._spread_out(sigmas)

    @cached_property
    def walks(self) -> Array:
        """Density of the random walk of each error, (L,)."""
        return self._spread_out([block.walk for block in self.blocks])

    @cached_property
    def walking(self) -> IntArray:
        """Errors that have a random walk, (k,)."""
        return np.flatnonzero(self.walks)

    @cached_property
    def memories_s(self) -> Array:
        """Time constant with which the mean of each error decays, s; infinite where it does not, (L,)."""
        return self._spread_out([block.memory_s for block in self.blocks])

    def kept(self, dt_s: float) -> Array:
        """What is left of the mean of each error after a time, as a share, (L,)."""
        return np.exp(-dt_s / self.memories_s)

    def _spread_out(self, values: Sequence[float | tuple[float, ...]]) -> Array:
        of_blocks = zip(self.blocks, values, strict=True)
        return np.concatenate([np.broadcast_to(np.asarray(value, dtype=np.float64), b.size) for b, value in of_blocks])


_BODY = StateLayout(body_blocks(RobustConfig(), InitialConfig(), ImuCalibration()))
BODY_ERRORS = _BODY.dimension
"""Number of errors of the body, those before the feet."""
ROTATION, LEG_SCALE, RATE = _BODY.at("rotation"), _BODY.at("leg_scale"), _BODY.at("rate")
GYROSCOPE_BIAS, GYROSCOPE_SCALE = _BODY.at("gyroscope_bias"), _BODY.at("gyroscope_scale")
ACCELEROMETER_BIAS = _BODY.at("accelerometer_bias")
LEG_COMPLIANCE, SLIP_TURN, SLIP = _BODY.at("leg_compliance"), _BODY.at("slip_turn"), _BODY.at("slip")
LOAD_SLIP = _BODY.at("load_slip")
VELOCITY, POSITION = _BODY.at("velocity"), _BODY.at("position")
CONSIDERED_BY_LEGS = slice(SLIP.start, GYROSCOPE_SCALE.stop)
"""What legs and IMU do not correct: in a turn, slip and the gyroscope's scale look alike."""
CURVED_IN_PROCESS, CURVED_IN_MEASUREMENT = _BODY.curved_in_process, _BODY.curved_in_measurement


@dataclass(frozen=True, slots=True)
class State:
    """One state, or a stack of sigma points of it.

    Attributes:
        layout: the order of ``vector``.
        rotation: ``R_world_body``, (..., 3, 3).
        vector: everything else, (..., L); the entries of the rotations are zero and unused.
        remembered: rotations ``R_world_pose`` of the mean's remembered poses, in the order of ``layout.poses``,
            (k, 3, 3).
    """

    layout: StateLayout
    rotation: Array
    vector: Array
    remembered: Array = field(default_factory=lambda: np.empty((0, 3, 3)))

    def remembered_rotation(self, name: str) -> Array:
        """Rotation of a remembered pose, (3, 3)."""
        rotation: Array = self.remembered[self.layout.poses.index(name)]
        return rotation

    def remembered_pose(self, name: str) -> Array:
        """A remembered pose, ``T_world_pose``, (4, 4)."""
        return se3.transform(self.remembered_rotation(name), self.vector[self.layout.position_of(name)])

    def remembering(self, name: str, rotation: Array, position: Array) -> "State":
        """This state with another pose under a name; rotation (3, 3), position (3,), m."""
        remembered, vector = self.remembered.copy(), self.vector.copy()
        remembered[self.layout.poses.index(name)] = rotation
        vector[self.layout.position_of(name)] = position
        return replace(self, vector=vector, remembered=remembered)

    @property
    def feet(self) -> Array:
        """Foot centres in the world, m, (..., legs, 3)."""
        return self.vector[..., self.layout.feet].reshape(*self.vector.shape[:-1], self.layout.legs, 3)

    def spread(self, errors: Array) -> "State":
        """The stack of states that differ from this mean by error vectors (points, L); remembered poses do not move.

        Where the vectors end before the passive errors, these are zero.
        """
        passive = len(self.vector) - errors.shape[1]
        if passive:
            errors = np.concatenate((errors, np.zeros((len(errors), passive))), axis=1)
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
        turn, *turns = so3.exp(np.stack([step[at] for at in layout.rotations]))
        moved = self._spread(step[None], turn[None])
        vector, remembered = moved.vector[0], np.empty(self.remembered.shape)
        for row, (name, its_turn) in enumerate(zip(layout.poses, turns, strict=True)):
            at = layout.position_of(name)
            vector[at] = its_turn @ (self.vector[at] + step[at])
            remembered[row] = its_turn @ self.remembered[row]
        self._clear_rotations(vector)
        return State(layout, moved.rotation[0], vector, remembered)

    def _clear_rotations(self, vector: Array) -> None:
        for at in self.layout.rotations:
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
        vector = self.vector[0].copy()
        self._clear_rotations(vector)
        centre = replace(self, rotation=self.rotation[0], vector=vector)
        shift = points.mean(centre.errors_of(self))
        shift[self.layout.active :] = 0.0
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
