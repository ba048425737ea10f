# SPDX-License-Identifier: BSD-3-Clause
"""GTSAM's contact-aided invariant filter, ``LeggedInvariantEKF``, for the body frame; its peculiarities stay here.

The IMU drives the prediction, the positions of stance feet correct it (Hartley, Ghaffari, Eustice, Grizzle,
"Contact-aided invariant extended Kalman filtering for robot state estimation", IJRR 2020). Observed of the class
in GTSAM 4.3:

* Left to its defaults it stops with "indeterminate linear system near x0" when all feet first stand together. Its
  start from full contact, ``useFullContactInitialization``, fixes yaw, x, y and velocity by priors of 1e-6 beside
  priors of 1 and factorises that by Cholesky: on one fifth of the postures of a real Go1 log rounding makes it fail.
  Initial covariance and process noise change nothing; filtering itself solves no such system. So that start is
  switched off here: gravity and gyroscope bias come from rest, as in our filter.
* Its default ``body_P_imu`` puts the IMU at (0.30, 0, 0.15) m: it has to be set.
* Its errors are right/local, where Hartley's right-invariant ones are world-fixed: the matrix of the innovation depends
  on the estimated place of the foot in the body. IMU biases are parameters, no states; a new bias means a new object.
* A foot that is not reported leaves its stance; at touchdown its block becomes a wide prior.
* Which feet are in stance is state too, and only a touchdown, which forgets the foothold, can set it. So a checkpoint
  has the last state without any stance, which can be set, and the calls since (``filter_calls``): the same again.
"""

from typing import Any

import gtsam
import numpy as np

from coclo_vio.backend.config import FootholdNoiseConfig
from coclo_vio.backend.filter_calls import FilterCalls
from coclo_vio.geometry import se3, so3
from coclo_vio.values.arrays import Array, BoolArray
from coclo_vio.values.errors import SmootherError
from coclo_vio.values.estimates import NavState
from coclo_vio.values.object_fields import CheckpointPostponed
from coclo_vio.values.units import GRAVITY_MPS2

_FIXED = 1e-6  # sigma of what is zero by definition at the start: yaw (rad) and position (m)
_UNCERTAIN_M = 0.5  # sigma of a foothold before its first measurement


class FootholdFilter:
    """Pose, velocity and footholds from IMU and stance feet.

    GTSAM's state is that of the imu frame; the results are of the body.
    """

    def __init__(
        self,
        config: FootholdNoiseConfig,
        T_body_imu: Array,
        leg_names: tuple[str, ...],
        *,
        rotation_world_body: Array,
        gyroscope_bias: Array,
        tilt_rad: float,
        velocity_mps: float,
    ) -> None:
        """Start with the body at the origin.

        Args:
            config: noise.
            T_body_imu: maps imu coordinates to body, (4, 4).
            leg_names: one for each foot.
            rotation_world_body: ``R_world_body``, (3, 3).
            gyroscope_bias: rad/s, imu frame, (3,).
            tilt_rad: one sigma of roll and pitch, rad.
            velocity_mps: one sigma of each axis of the velocity, m/s.
        """
        self._config, self._T_body_imu, self._leg_names = config, T_body_imu, leg_names
        self._bias = gyroscope_bias
        T_world_imu = se3.transform(rotation_world_body, np.zeros(3)) @ T_body_imu
        turn = T_world_imu[:3, :3]
        legs = len(leg_names)
        covariance = np.eye(9 + 3 * legs) * _UNCERTAIN_M**2
        covariance[:3, :3] = turn.T @ np.diag([tilt_rad**2, tilt_rad**2, _FIXED**2]) @ turn
        covariance[3:6, 3:6] = np.eye(3) * _FIXED**2
        covariance[6:9, 6:9] = np.eye(3) * velocity_mps**2
        blocks = np.zeros((3, 2 + legs))
        blocks[:, 0] = T_world_imu[:3, 3]
        self._calls = FilterCalls(legs)
        self._is_stance: BoolArray
        self._filter: gtsam.LeggedInvariantEKF
        self._known: tuple[Array, Array, Array]
        self._begin(turn, blocks, covariance)

    @property
    def is_stance(self) -> BoolArray:
        """The feet in stance at the last correction, (legs,)."""
        return self._is_stance

    @property
    def T_world_body(self) -> Array:
        """Maps body coordinates to world, (4, 4)."""
        pose = self._filter.estimate()
        return se3.transform(pose.rotation().matrix(), pose.x(0)) @ se3.inverse(self._T_body_imu)

    def predict(self, dt_s: float, angular_velocity: Array, specific_force: Array) -> None:
        """Move on by ``dt_s`` > 0 with the mean readings of that time, rad/s and m/s^2, imu frame, (3,)."""
        self._calls.add_prediction(dt_s, angular_velocity, specific_force)
        self._filter.predict(angular_velocity, specific_force, dt_s)

    def correct(self, position_body: Array, is_stance: BoolArray) -> None:
        """Correct the body by the feet in stance.

        Args:
            position_body: feet by the joints, m, body frame, (legs, 3); NaN allowed where not in stance.
            is_stance: feet in stance, (legs,); all others end their stance.

        Raises:
            SmootherError: GTSAM failed.
        """
        contacts = []
        for leg in np.flatnonzero(is_stance):
            contact = gtsam.ContactMeasurement()
            contact.foot, contact.bodyPoint = int(leg), position_body[leg]
            contact.touchdown = not bool(self._is_stance[leg])
            contacts.append(contact)
        try:
            self._filter.processContacts(contacts)
        except RuntimeError as error:
            raise SmootherError(
                f"GTSAM's LeggedInvariantEKF failed: {str(error).strip().splitlines()[0]} Raise the noise in "
                "FootholdNoiseConfig, or take the mode coclo"
            ) from error
        self._is_stance = is_stance
        if contacts:
            self._calls.add_correction(position_body, is_stance)
        else:
            self._know(*self._state())

    def set_gyroscope_bias(self, gyroscope_bias: Array) -> None:
        """Set another bias, rad/s, imu frame, (3,); state and covariance stay, all feet touch down anew."""
        self._bias = gyroscope_bias
        self.inflate(np.zeros(9))

    def inflate(self, variance: Array) -> None:
        """Add ``variance`` (9,) to the errors [rotation, position, velocity]; all feet touch down anew."""
        turn, blocks, covariance = self._state()
        covariance[np.arange(9), np.arange(9)] += variance
        self._begin(turn, blocks, covariance)

    def state_at(self, angular_velocity: Array) -> tuple[NavState, Array]:
        """The state of the body and the covariance (9, 9) of ``StateEstimate``, at the gyroscope's reading (3,)."""
        T_world_body = self.T_world_body
        rotation, turn, lever = T_world_body[:3, :3], self._T_body_imu[:3, :3], self._T_body_imu[:3, 3]
        rate = turn @ (angular_velocity - self._bias)
        lever_velocity = np.cross(rate, lever)  # of the imu, body axes
        velocity = self._filter.estimate().x(1) - rotation @ lever_velocity
        nav = NavState(T_world_body, velocity, rate, turn @ self._bias, np.zeros(3))
        jacobian = np.zeros((9, 9))  # from GTSAM's errors, [rotation, position, velocity] of the imu in its own axes
        jacobian[:6, :6] = se3.adjoint(self._T_body_imu)
        jacobian[6:, 6:] = rotation @ turn
        jacobian[6:, :3] = rotation @ so3.hat(lever_velocity) @ turn
        covariance = jacobian @ self._filter.covariance()[:9, :9] @ jacobian.T
        return nav, 0.5 * (covariance + covariance.T)

    def checkpoint_fields(self) -> dict[str, Any]:
        """The last state without a stance, the calls since, and what never changes.

        Raises:
            CheckpointPostponed: there were too many calls since then.
        """
        if not self._calls.is_complete:
            raise CheckpointPostponed("too long without a moment in which no foot was in stance")
        kept = {name: value for name, value in self.__dict__.items() if name not in ("_filter", "_calls")}
        return {**kept, "calls": self._calls.numbers()}

    def restore_fields(self, fields: dict[str, Any]) -> None:
        """Set that state, and call the same again."""
        calls = fields.pop("calls")
        self.__dict__.update(fields)
        self._calls = FilterCalls(len(self._leg_names))
        self._begin(*self._known)
        self._calls.repeat(calls, self)

    def _state(self) -> tuple[Array, Array, Array]:
        """Rotation (3, 3), position, velocity and footholds (3, 2 + legs), and covariance of GTSAM's state."""
        pose = self._filter.estimate()
        return pose.rotation().matrix(), pose.xMatrix(), self._filter.covariance()

    def _know(self, rotation: Array, blocks: Array, covariance: Array) -> None:
        """The state is this one, and no foot is in stance."""
        self._known = rotation, blocks, covariance
        self._calls.begin()

    def _begin(self, rotation: Array, blocks: Array, covariance: Array) -> None:
        """Filter on from a state of which no foot is in stance."""
        self._is_stance = np.zeros(len(self._leg_names), dtype=np.bool_)
        self._filter = self._gtsam_filter(rotation, blocks, covariance)
        self._know(rotation, blocks, covariance)

    def _gtsam_filter(self, rotation: Array, blocks: Array, covariance: Array) -> gtsam.LeggedInvariantEKF:
        config = self._config
        state = gtsam.NavState(gtsam.Rot3(rotation), blocks[:, 0], blocks[:, 1])
        imu = gtsam.PreintegrationParams.MakeSharedU(GRAVITY_MPS2)
        imu.setGyroscopeCovariance(np.eye(3) * config.gyroscope_noise_density**2)
        imu.setAccelerometerCovariance(np.eye(3) * config.accelerometer_noise_density**2)
        imu.setIntegrationCovariance(np.zeros((3, 3)))
        params = gtsam.LeggedEstimatorParams()
        params.preintegrationParams = imu
        params.body_P_imu = gtsam.Pose3(self._T_body_imu)
        params.footholdProcessSigma = config.foothold_walk
        params.footholdInitSigma = _UNCERTAIN_M
        params.contactCovariance = np.eye(3) * config.foot_position_noise_m**2
        params.imuBias = gtsam.imuBias.ConstantBias(np.zeros(3), self._bias)
        params.useFullContactInitialization = False
        return gtsam.LeggedInvariantEKF(state, blocks[:, 2:], covariance, params, list(self._leg_names))
