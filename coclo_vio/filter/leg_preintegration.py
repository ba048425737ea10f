# SPDX-License-Identifier: BSD-3-Clause
"""Leg odometry between two keyframes as a factor: the filter runs from one keyframe's state, whose prior is removed.

At a keyframe the filter takes over a state with its covariance ``P_0`` and remembers it beside the present one. At the
next keyframe the joint covariance of remembered state ``a`` and present state ``b`` gives what was measured meanwhile:

    b given a      b - Phi (a - m_a) ~ N(0, Q),  Phi = P_ba P_aa^-1,  Q = P_bb - Phi P_ab
    on a alone     information P_aa^-1 - P_0^-1, vector P_aa^-1 m_a

On a linear model both are exact and independent of ``P_0``, which only spreads the sigma points and opens the gates.
Since ``a`` and ``b`` are the filter's full states, footholds that stand across a keyframe and readings of its stamp are
in one factor only. A shift of the world or a rotation about the vertical is not measured. With feet relative to the
body the right-invariant errors carry it unchanged, so its columns are known and set: ``Phi`` the identity, the
information zero.

Poses of keyframes are as the cameras measure them (``camera_frame``). The constant errors of that, of the cameras'
mounting, of their stereo scale and of the anchor's tilt, are the last six of a keyframe's states: neither process nor
measurements of the legs touch them, they only change coordinates.
Source: Forster et al. 2017 (preintegration); derivatives by statistical linearisation.
"""

from collections.abc import Callable, Sequence

import numpy as np
from scipy.linalg import block_diag, cho_solve

from coclo_vio.filter.between_states import between, lower_factor
from coclo_vio.filter.camera_frame import CAMERA, ERRORS, TILT, CameraFrame
from coclo_vio.filter.config import InitialConfig
from coclo_vio.filter.frame_motion import FrameMotion
from coclo_vio.filter.passive_states import PassiveStates
from coclo_vio.filter.revision import Prior, replaced_prior
from coclo_vio.filter.square_root_filter import SquareRootFilter
from coclo_vio.filter.state import BODY_ERRORS, POSITION, RATE, ROTATION, VELOCITY, State
from coclo_vio.filter.state_blocks import KNOWN_SIGMA, ZERO_SIGMA, StateBlock
from coclo_vio.geometry import se3, so3
from coclo_vio.values.arrays import Array, IntArray
from coclo_vio.values.leg_motion import LegMotion, LegState
from coclo_vio.values.outputs import Calibration

START = "start"
_KNOWN = 1e-10  # sigma at the filter's start below which a state is known and no state of a keyframe
_FLOOR = 1e-6  # least sigma that is added to every state, in its own unit, so that the covariances have inverses
_FLOOR_SHARE = 5e-4  # the same as a share of the sigma at the start of what has a prior of its own: biases, slip

_CALIBRATED_RAD = 0.005  # least turn of the cameras by which a calibration is off


def start_block(legs: int, extra: Sequence[StateBlock] = ()) -> StateBlock:
    """The remembered state of a keyframe, as a block of the robust profile's state for a number of legs.

    Args:
        legs: their number.
        extra: further blocks of the state; those that are not passive are remembered too.
    """
    size = BODY_ERRORS + 3 * legs + sum(block.size for block in extra if not block.is_passive)
    return StateBlock(START, size, sigma=ZERO_SIGMA, is_passive=True)


class LegPreintegration:
    """A filter's states at keyframes, and what it measures between them.

    Args:
        core: the filter that has started, with the block of ``start_block``.
        motion_to: from a frame's stamp to the motion from the last sample to it.
        initial: sigmas of the cameras' errors at the start.
        anchor_ns: time of the anchor, the first frame.

    Attributes:
        calibrated: rotation ``E`` (3, 3), as in ``calibration``, of what has become part of the cameras' calibration.
    """

    def __init__(
        self, core: SquareRootFilter, motion_to: Callable[[int], FrameMotion], initial: InitialConfig, anchor_ns: int
    ) -> None:
        self._core, self._motion_to = core, motion_to
        layout = core.mean.layout
        sigmas = layout.sigmas(is_moving=False)[: layout.active]
        used = np.flatnonzero(sigmas > _KNOWN)
        pose = np.r_[ROTATION, POSITION]
        self._legs: IntArray = np.setdiff1d(used, pose)
        self._used: IntArray = np.concatenate((pose, self._legs))
        self._unmeasured = (2, 3, 4, 5)  # heading and position among the used errors
        relative = np.eye(layout.active)  # the filter's errors with feet relative to the body
        relative[layout.feet, POSITION] = np.tile(-np.eye(3), (layout.legs, 1))
        self._relative = relative[np.ix_(self._used, self._used)]
        self._floor = np.maximum(_FLOOR, _FLOOR_SHARE * sigmas[self._used])
        self._floor[:6] = _FLOOR
        self._frame = CameraFrame(motion_to(anchor_ns).pose(core.mean), np.zeros(ERRORS))
        camera = np.maximum([*[initial.camera_rotation_sigma_rad] * 3, initial.stereo_scale_sigma], _FLOOR)
        tilt = np.maximum(np.sqrt(np.sum(np.square(core.active_factor[:2]), axis=1)), _FLOOR)
        constants = np.concatenate((camera, tilt))
        self._constants_floor = np.maximum(_FLOOR, np.append(_FLOOR_SHARE * camera, np.zeros(2)))
        self._constants_covariance = np.diag(np.square(constants))  # at the start of the motion
        self._gain = np.zeros((len(self._used), ERRORS))  # of the constants on the state at the start of the motion
        self.calibrated: Array = np.eye(3)
        self._mounting_prior = Prior(np.zeros(3), np.eye(3) * camera[0] ** 2)
        self._start: LegState | None = None
        self._prior_factor = np.eye(len(self._used))
        self._prior = np.eye(len(self._used))
        self._to_start = np.eye(len(self._used) + ERRORS)
        self._to_start_true = np.eye(len(self._used))

    def true_pose(self, T_measured: Array) -> Array:
        """The pose of the body, (4, 4), that the cameras measure as ``T_measured``."""
        return self._frame.true(T_measured)

    def true_covariance(self, T_measured: Array, covariance: Array) -> Array:
        """Covariance of the true pose at a frame, (6, 6), which the cameras measure as ``T_measured``.

        Args:
            T_measured: the pose as measured, (4, 4).
            covariance: of the same, as propagated from the last keyframe, (6, 6); that keyframe's share of it is
                exchanged for the covariance of its true pose, in which errors of the cameras do not add up.
        """
        assert self._start is not None, "restart() comes first"
        rows = self._to_start_true[:6] @ self._prior_factor
        moved = se3.adjoint(se3.inverse(T_measured) @ self._start.T_world_body)
        exchanged = covariance + moved @ (rows @ rows.T - self._start.covariance[:6, :6]) @ moved.T
        is_covariance = float(np.linalg.eigvalsh(exchanged)[0]) > 0.0  # not after the keyframe was solved for again
        return np.asarray(exchanged if is_covariance else covariance)

    def calibration(self, stamp_ns: int) -> Calibration:
        """The estimated errors of the cameras, as in ``LegOdometryFilter.camera_calibration``."""
        sigma, camera = np.sqrt(np.diag(self._constants_covariance)), self._frame.errors
        rotation = so3.log(self.calibrated @ so3.exp(camera[:3]))
        return Calibration(stamp_ns, rotation, sigma[:3], float(1.0 + camera[3]), float(sigma[3]))

    def with_mounting_prior(self, state: LegState, prior: Prior) -> LegState:
        """A keyframe's state as if a wider prior of the cameras' rotation had held from the start.

        Args:
            state: of the keyframe, with all that has been measured.
            prior: of the rotation vector of ``calibration``, wider than the one that holds.
        """
        first = len(state.covariance) - ERRORS
        at, value = slice(first, first + 3), state.legs[-ERRORS : 3 - ERRORS]
        moved = Prior(prior.mean - so3.log(self.calibrated), prior.covariance)
        columns, step = replaced_prior(state.covariance, at, value, self._mounting_prior, moved)
        self._mounting_prior = moved
        covariance = state.covariance + columns @ columns.T
        return LegState(state.stamp_ns, state.T_world_body @ se3.exp(step[:6]), state.legs + step[6:], covariance)

    @property
    def camera_errors(self) -> Prior:
        """What is known of the cameras' errors, (4,): rotation, relative error of stereo lengths."""
        return Prior(self._frame.errors[CAMERA], self._constants_covariance[CAMERA, CAMERA])

    def resume_cameras(self, errors: Prior) -> None:
        """Go on with what was known of the cameras' errors earlier."""
        self._set_camera(errors.mean)
        self._constants_covariance[CAMERA] = self._constants_covariance[:, CAMERA] = self._gain[:, CAMERA] = 0.0
        self._constants_covariance[CAMERA, CAMERA] = errors.covariance

    def calibrate(self) -> None:
        """Make the estimated mounting part of the calibration, for a window that begins then."""
        rotation, scale = self._frame.errors[:3], self._frame.errors[3]
        self._mounting_prior = Prior(self._mounting_prior.mean - rotation, self._mounting_prior.covariance)
        self.calibrated = np.asarray(self.calibrated @ so3.exp(rotation))
        self._set_camera(np.array([0.0, 0.0, 0.0, scale]))

    @property
    def is_calibration_off(self) -> bool:
        """Whether the cameras are surely turned against the calibration that their window has."""
        turn, covariance = self._frame.errors[:3], self._constants_covariance[:3, :3]
        size = float(np.linalg.norm(turn))
        return size > _CALIBRATED_RAD and size**2 > 4.0 * float(turn @ covariance @ turn) / size**2

    def anchor_at(self, stamp_ns: int) -> None:
        """Make a frame the anchor, for a window that begins there with ``state``."""
        camera = np.concatenate((self._frame.errors[CAMERA], np.zeros(2)))
        self._frame = CameraFrame(self._motion_to(stamp_ns).pose(self._core.mean), camera)
        self._constants_covariance[CAMERA, TILT] = self._constants_covariance[TILT, CAMERA] = 0.0
        self._start = None

    def _set_camera(self, errors: Array) -> None:
        self._frame = CameraFrame(self._frame.anchor, np.concatenate((errors, self._frame.errors[TILT])))

    def state(self, stamp_ns: int) -> LegState:
        """The filter's state at a frame, from the last sample on with constant rate and velocity."""
        motion = self._motion_to(stamp_ns)
        mean = self._core.mean
        frame = self._present_frame
        T_measured, to_local = self._to_local(mean, motion, frame)
        own, mixed, constants = self._present()
        covariance = to_local @ np.block([[own, mixed], [mixed.T, constants]]) @ to_local.T
        floor = np.square(self._constants_floor)
        covariance[np.diag_indices_from(covariance)] += np.concatenate((self._noise(motion.noise), floor))
        legs = np.concatenate((self._legs_of(mean, motion.pose(mean)), frame.errors))
        return LegState(stamp_ns, T_measured, legs, covariance)

    def _present(self) -> tuple[Array, Array, Array]:
        """Covariances of the present state (n, n), of it with the constant errors (n, 6), and of these (6, 6).

        The constants are correlated with data through the state at the start of the motion only. At the anchor their
        tilt is the filter's own.
        """
        rows = self._relative @ self._core.active_factor[self._used]
        present = rows @ rows.T
        if self._start is None:
            constants, tilt = self._constants_covariance.copy(), slice(0, 2)
            mixed = np.zeros((len(present), ERRORS))
            mixed[:, TILT], constants[TILT, TILT] = present[:, tilt], present[tilt, tilt]
            return present, mixed, constants
        own, cross = self._remembered()
        known = self._gain.T @ (self._prior - own) @ self._gain
        return present, cross @ self._gain, self._constants_covariance - known

    @property
    def _present_frame(self) -> CameraFrame:
        """The frame of the cameras with its constant errors by all that was measured until now."""
        if self._start is None:
            return self._frame
        moved = self._relative @ self._core.mean.vector[self._core.mean.layout.at(START)][self._used]
        return CameraFrame(self._frame.anchor, self._frame.errors + self._gain.T @ moved)

    def _remembered(self) -> tuple[Array, Array]:
        """Covariance of the state at the start of the motion now, and of the present state with it, (n, n) each."""
        used, relative, passive = self._used, self._relative, self._core.passive
        at = np.ix_(used, used)
        return relative @ passive.own[at] @ relative.T, relative @ passive.cross[at] @ relative.T

    def restart(self, state: LegState) -> None:
        """Take over the state at a frame; from now on motion is measured from there."""
        core, motion = self._core, self._motion_to(state.stamp_ns)
        self._frame = CameraFrame(self._frame.anchor, state.legs[-ERRORS:])
        mean = self._mean_of(state, motion)
        self._to_start, self._to_start_true = self._to_local(mean, motion, self._frame)[1], self._to_true(mean, motion)
        back = np.linalg.inv(self._to_start)
        beyond = np.zeros(len(back))
        beyond[:6] = np.repeat(np.square(motion.noise), 3)
        covariance = back @ (state.covariance + np.diag(beyond)) @ back.T
        self._constants_covariance = covariance[-ERRORS:, -ERRORS:]
        to_filter = np.linalg.inv(self._relative)
        own = to_filter @ covariance[:-ERRORS, :-ERRORS] @ to_filter.T
        order = np.argsort(self._used)  # the filter's factor is lower in its own order
        in_order = np.ix_(self._used[order], self._used[order])
        factor = np.diag(np.full(len(core.active_factor), KNOWN_SIGMA))
        factor[in_order] = lower_factor(own[np.ix_(order, order)])
        joint = factor @ factor.T
        self._prior_factor = lower_factor(self._relative @ joint[np.ix_(self._used, self._used)] @ self._relative.T)
        core.mean, core.passive = mean, PassiveStates(joint.copy(), joint)
        core.replace_active(factor)
        self._prior = self._prior_factor @ self._prior_factor.T
        self._gain = cho_solve((self._prior_factor, True), covariance[:-ERRORS, -ERRORS:])
        self._start = state

    def motion(self, stamp_ns: int) -> LegMotion:
        """What was measured from the last ``restart`` on to a frame."""
        assert self._start is not None, "restart() comes first"
        core, reach = self._core, self._motion_to(stamp_ns)
        used, relative, end = self._used, self._relative, self.state(stamp_ns)
        to_end = self._to_local(core.mean, reach, self._present_frame)[1]
        back, to_back = np.linalg.inv(self._to_start), np.linalg.inv(to_end)
        own, cross = self._remembered()
        rows = relative @ core.active_factor[used]
        measured = between(
            self._prior_factor,
            own,
            cross,
            rows @ rows.T,
            relative @ core.mean.vector[core.mean.layout.at(START)][used],
            noise=to_back[:-ERRORS, :-ERRORS] @ np.diag(self._noise(reach.noise)) @ to_back[:-ERRORS, :-ERRORS].T,
            unmeasured=self._unmeasured,
        )
        size = len(used)
        constant = np.diag(1.0 / self._constants_floor)
        start_rows = block_diag(measured.rows[:, :size], -constant) @ back
        end_rows = block_diag(measured.rows[:, size:], constant) @ to_back
        return LegMotion(
            self._start,
            end,
            np.concatenate((start_rows, end_rows), axis=1),
            np.concatenate((measured.values, (self._frame.errors - end.legs[-ERRORS:]) / self._constants_floor)),
            core.mean.vector[VELOCITY],
            self._motion_covariance(end, to_end),
        )

    def _motion_covariance(self, end: LegState, to_end: Array) -> Array:
        """Of the motion between the poses as measured, right/local, (6, 6)."""
        assert self._start is not None
        T_start_end = se3.inverse(self._start.T_world_body) @ end.T_world_body
        before, after = -se3.adjoint(se3.inverse(T_start_end)) @ self._to_start[:6], to_end[:6]
        own, cross = self._remembered()
        constants = self._present()[2]
        below = np.concatenate(((own @ self._gain).T, constants), axis=1)
        mixed = after @ np.concatenate((np.concatenate((cross, cross @ self._gain), axis=1), below)) @ before.T
        start = before @ np.concatenate((np.concatenate((own, own @ self._gain), axis=1), below)) @ before.T
        return np.asarray(start + mixed + mixed.T + end.covariance[:6, :6])

    def _noise(self, beyond: tuple[float, float]) -> Array:
        """Variances of what the body does beyond constant velocity until a frame, and a floor, (n,)."""
        variances = np.square(self._floor)
        variances[:6] += np.repeat(np.square(beyond), 3)
        return np.asarray(variances)

    def _legs_of(self, mean: State, T_world_body: Array) -> Array:
        """The states of a keyframe besides its pose: velocity and feet in body axes at the frame, the others as is."""
        to_body, vector = T_world_body[:3, :3].T, mean.vector.copy()
        vector[VELOCITY] = to_body @ vector[VELOCITY]
        feet = (mean.feet - T_world_body[:3, 3]) @ to_body.T
        vector[mean.layout.feet] = feet.ravel()
        return np.asarray(vector[self._legs])

    def _mean_of(self, state: LegState, motion: FrameMotion) -> State:
        """The filter's state at its last sample; the inverse of ``state``."""
        layout, vector = self._core.mean.layout, self._core.mean.vector.copy()
        T_world_body = self.true_pose(state.T_world_body)
        R, position = T_world_body[:3, :3], T_world_body[:3, 3]
        vector[self._legs] = state.legs[:-ERRORS]
        vector[VELOCITY] = R @ vector[VELOCITY]
        vector[layout.feet] = (vector[layout.feet].reshape(-1, 3) @ R.T + position).ravel()
        vector[layout.at(START)] = 0.0
        at_frame = State(layout, R, vector, self._core.mean.remembered)
        rotation, vector[POSITION] = motion.now(at_frame, T_world_body)
        return State(layout, rotation, vector, self._core.mean.remembered)

    def _to_local(self, mean: State, motion: FrameMotion, frame: CameraFrame) -> tuple[Array, Array]:
        """The pose as the cameras measure it, and d(errors of a keyframe's state) / d(errors of filter and constants).

        The filter's errors are the used ones, with feet relative to the body, (n + 6, n + 6).
        """
        measured, by_pose, by_errors = frame.measured(motion.pose(mean))
        jacobian = block_diag(self._to_true(mean, motion), np.eye(ERRORS))
        jacobian[:6] = by_pose @ jacobian[:6]
        jacobian[:6, -ERRORS:] = by_errors
        return measured, jacobian

    def _to_true(self, mean: State, motion: FrameMotion) -> Array:
        """d(errors of the true pose and the legs) / d(used errors of the filter), (n, n)."""
        layout = mean.layout
        T_world_body, dt_s = motion.pose(mean), motion.dt_s
        to_body = T_world_body[:3, :3].T
        turning = so3.right_jacobian(mean.vector[RATE] * dt_s) * dt_s
        full = np.eye(layout.active)
        full[ROTATION, ROTATION], full[ROTATION, RATE] = to_body, turning
        full[POSITION, ROTATION] = -to_body @ so3.hat(T_world_body[:3, 3])
        full[POSITION, POSITION], full[POSITION, VELOCITY] = to_body, to_body * dt_s
        full[VELOCITY, VELOCITY] = to_body
        full[VELOCITY, RATE] = so3.hat(to_body @ mean.vector[VELOCITY]) @ turning
        for leg, foot in enumerate(mean.feet):
            at = slice(layout.feet.start + 3 * leg, layout.feet.start + 3 * leg + 3)
            full[at, at] = to_body
            full[at, VELOCITY] = -to_body * dt_s
            full[at, RATE] = so3.hat(to_body @ (foot - T_world_body[:3, 3])) @ turning
        return full[np.ix_(self._used, self._used)]
