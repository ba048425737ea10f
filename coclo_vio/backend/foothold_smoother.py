# SPDX-License-Identifier: BSD-3-Clause
"""GTSAM's contact-aided fixed-lag smoother, ``LeggedFixedLagSmoother``, in the place of its filter in ``inekf``.

Observed of the class in GTSAM 4.3:

* Contacts at each joint sample of 500 Hz make it stop with "indeterminate linear system" after seconds, and cost ten
  times as much; contacts at 100 Hz do not, with the IMU integrated in between.
* A yaw and a position that are certain to 1e-6 at the start, or no covariance of integration, make it stop likewise at
  its first correction on a log of an iCub; certain to 1e-3, and with a small covariance, it goes through.
* It has no covariance to ask for: that of the start is given out, which says nothing about errors.
"""

from collections.abc import Sequence
from typing import Any

import gtsam
import numpy as np

from coclo_vio.backend.foothold_filter import FootholdFilter
from coclo_vio.backend.inekf import InvariantLegOdometry
from coclo_vio.robot.standstill import ImuMeans
from coclo_vio.values.arrays import Array, BoolArray
from coclo_vio.values.errors import SmootherError
from coclo_vio.values.object_fields import CheckpointUnsupported
from coclo_vio.values.units import GRAVITY_MPS2

LAG_S = 0.3  # longer than a stance of a trot
STEP_S = 0.01  # between two corrections by the feet
_LEAST_SIGMA = 1e-3  # of the start: rad, m, m/s
_INTEGRATION_VARIANCE = 1e-8  # of positions, m^2/s
_UNCERTAIN_M = 0.5  # sigma of a foothold before its first measurement


class FootholdSmoother(FootholdFilter):
    """Pose, velocity and footholds from IMU and stance feet over the last moments, all of them estimated anew."""

    _since_s = 0.0  # the last correction

    def predict(self, dt_s: float, angular_velocity: Array, specific_force: Array) -> None:
        """Move on by ``dt_s`` > 0 with the mean readings of that time, rad/s and m/s^2, imu frame, (3,)."""
        super().predict(dt_s, angular_velocity, specific_force)
        self._since_s += dt_s

    def correct(self, position_body: Array, is_stance: BoolArray) -> None:
        """Correct the body by the feet in stance, unless that was done a moment ago.

        Args:
            position_body: feet by the joints, m, body frame, (legs, 3); NaN allowed where not in stance.
            is_stance: feet in stance, (legs,); all others end their stance.

        Raises:
            SmootherError: GTSAM failed.
        """
        if self._since_s + 1e-6 >= STEP_S:
            self._since_s = 0.0
            super().correct(position_body, is_stance)

    def checkpoint_fields(self) -> dict[str, Any]:
        """Its window cannot be kept.

        Raises:
            CheckpointUnsupported: always.
        """
        raise CheckpointUnsupported("GTSAM's LeggedFixedLagSmoother cannot be kept")

    def _gtsam_filter(self, rotation: Array, blocks: Array, covariance: Array) -> Any:
        config = self._config
        state = gtsam.NavState(gtsam.Rot3(rotation), blocks[:, 0], blocks[:, 1])
        imu = gtsam.PreintegrationParams.MakeSharedU(GRAVITY_MPS2)
        imu.setGyroscopeCovariance(np.eye(3) * config.gyroscope_noise_density**2)
        imu.setAccelerometerCovariance(np.eye(3) * config.accelerometer_noise_density**2)
        imu.setIntegrationCovariance(np.eye(3) * _INTEGRATION_VARIANCE)
        params = gtsam.LeggedEstimatorParams()
        params.preintegrationParams = imu
        params.body_P_imu = gtsam.Pose3(self._T_body_imu)
        params.footholdProcessSigma = config.foothold_walk
        params.footholdInitSigma = _UNCERTAIN_M
        params.contactCovariance = np.eye(3) * config.foot_position_noise_m**2
        params.imuBias = gtsam.imuBias.ConstantBias(np.zeros(3), self._bias)
        params.useFullContactInitialization = False
        return _Smoother(state, blocks[:, 2:], covariance, params, self._leg_names)


class SmoothedLegOdometry(InvariantLegOdometry):
    """``inekf`` with the smoother instead of the filter; its covariance says nothing."""

    def _started(self, stamp_ns: int, rest: ImuMeans | None) -> FootholdSmoother | None:
        core = super()._started(stamp_ns, rest)
        if core is None:
            return None
        nav, config, is_rest = core.state_at(np.zeros(3))[0], self.config, rest is not None
        return FootholdSmoother(
            config.noise,
            self._T_body_imu,
            self._robot.leg_names,
            rotation_world_body=nav.T_world_body[:3, :3],
            gyroscope_bias=self._T_body_imu[:3, :3].T @ nav.gyroscope_bias,
            tilt_rad=config.initial_tilt_rad if is_rest else config.moving_tilt_rad,
            velocity_mps=config.initial_velocity_mps if is_rest else config.moving_velocity_mps,
        )


class _Smoother:
    """The smoother with the methods of the filter that ``FootholdFilter`` calls."""

    def __init__(
        self,
        state: gtsam.NavState,
        footholds: Array,
        covariance: Array,
        params: gtsam.LeggedEstimatorParams,
        names: Sequence[str],
    ) -> None:
        self._covariance = covariance
        start = covariance[:9, :9] + _LEAST_SIGMA**2 * np.eye(9)
        self._smoother = gtsam.LeggedFixedLagSmoother(state, footholds, start, params, LAG_S, list(names))
        self.predict = self._smoother.predict
        self.estimate = self._smoother.estimate

    def covariance(self) -> Array:
        """That of the start, (9 + 3 legs, 9 + 3 legs)."""
        return self._covariance.copy()

    def processContacts(self, contacts: Sequence[gtsam.ContactMeasurement]) -> None:  # noqa: N802 -- GTSAM's name
        """Correct by feet in stance.

        Raises:
            SmootherError: GTSAM failed.
        """
        try:
            self._smoother.processContacts(contacts)
        except RuntimeError as error:
            raise SmootherError(
                f"GTSAM's LeggedFixedLagSmoother failed: {str(error).strip().splitlines()[0]} Raise the noise in "
                "FootholdNoiseConfig, or take the mode inekf"
            ) from error
