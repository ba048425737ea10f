# SPDX-License-Identifier: BSD-3-Clause
"""The baseline ``inekf``: an IMU-centric, contact-aided filter on the same feet, contacts and IMU as the filter.

The filtering is GTSAM's, see ``foothold_filter``.
"""

from collections import Counter
from collections.abc import Mapping

import numpy as np

from coclo_vio.backend.config import InvariantConfig
from coclo_vio.backend.foothold_filter import FootholdFilter
from coclo_vio.geometry import so3
from coclo_vio.robot.leg_sensing import LegSensing, Reading
from coclo_vio.robot.model import FeetKinematics, RobotModel
from coclo_vio.robot.standstill import ImuMeans, StartRule
from coclo_vio.values.arrays import Array, BoolArray
from coclo_vio.values.estimates import FootState, StateEstimate
from coclo_vio.values.measurements import JointSample, Measurement
from coclo_vio.values.units import NS_PER_S

_MOST_RESTS = 100  # windows of one standstill whose mean is the gyroscope bias


class InvariantLegOdometry:
    """Contact-aided invariant Kalman filter: an estimate at each joint sample once it has started, from rest.

    World: origin and heading of the body at the start. At a standstill every foot counts as in stance, and the
    gyroscope bias is the mean rate since it began.
    """

    def __init__(self, robot: RobotModel, config: InvariantConfig | None = None) -> None:
        self.config = config or InvariantConfig()
        self._robot, self._legs = robot, len(robot.leg_names)
        contact, timeout_s = robot.description.contact, self.config.force_timeout_s
        rest = self.config.standstill
        self._sensing = LegSensing(robot, contact, rest, force_timeout_s=timeout_s, rocks_soles=True)
        self._start_rule = StartRule(self.config.rest_timeout_s)
        self._counts: Counter[str] = Counter()
        self._T_body_imu = robot.description.imu.T_body_imu
        self._filter: FootholdFilter | None = None
        self._rests: list[ImuMeans] = []  # windows of the present standstill, one after another
        self._stamp_ns = 0  # of the filter's state
        self._feet_body: Array = np.zeros((self._legs, 3))  # last known
        self._rolled: Array = np.zeros((self._legs, 3))  # since touchdown, m, world
        self._R_world_foot: Array = np.tile(np.eye(3), (self._legs, 1, 1))
        self._R_world_body: Array = np.eye(3)  # at the last reading

    @property
    def counts(self) -> Mapping[str, int]:
        """Samples refused for their stamp, unknown legs, gaps, standstills and missing loads."""
        counts = {**self._counts, **self._sensing.counts}
        return {name: count for name, count in sorted(counts.items()) if count}

    def push(self, measurement: Measurement) -> StateEstimate | None:
        """Take one measurement; a joint sample gives the new estimate once the filter has started.

        Raises:
            RobotModelError: the sample is not of this robot.
            SmootherError: GTSAM failed.
        """
        before = self._sensing.imu
        reading = self._sensing.push(measurement, self._up_body() if isinstance(measurement, JointSample) else None)
        imu = self._sensing.imu
        if self._filter is not None and imu is not None and imu is measurement:
            earlier = before or imu
            rate = 0.5 * (earlier.angular_velocity + imu.angular_velocity)
            self._advance(self._filter, imu.stamp_ns, rate, 0.5 * (earlier.specific_force + imu.specific_force))
        return None if reading is None else self._take_reading(reading)

    def _take_reading(self, reading: Reading) -> StateEstimate | None:
        rest, imu = self._sensing.rest, self._sensing.imu
        self._filter = self._filter or self._started(reading.stamp_ns, rest)
        if self._filter is None or imu is None:
            return None
        self._advance(self._filter, reading.stamp_ns, imu.angular_velocity, imu.specific_force)
        self._take_rest(self._filter, rest)
        self._correct(self._filter, reading)
        nav, covariance = self._filter.state_at(imu.angular_velocity)
        feet_world = nav.T_world_body[:3, 3] + self._feet_body @ nav.T_world_body[:3, :3].T
        standing = FootState(feet_world, reading.contact.probability, self._filter.is_stance)
        return StateEstimate(reading.stamp_ns, nav, covariance, standing)

    def _up_body(self) -> Array | None:
        """Upward direction in the body frame, (3,); None before the start."""
        return None if self._filter is None else np.asarray(self._filter.T_world_body[2, :3])

    def _started(self, stamp_ns: int, rest: ImuMeans | None) -> FootholdFilter | None:
        """The filter at its start, levelled by gravity; None as long as it waits for rest."""
        imu = self._sensing.imu
        if not self._start_rule.is_met(stamp_ns, rest) or imu is None:
            return None
        self._counts["started_moving"] += rest is None
        turn = self._T_body_imu[:3, :3]
        force = turn @ imu.specific_force if rest is None else rest.specific_force
        config, self._stamp_ns = self.config, stamp_ns
        return FootholdFilter(
            config.noise,
            self._T_body_imu,
            self._robot.leg_names,
            rotation_world_body=so3.from_gravity(force),
            gyroscope_bias=np.zeros(3) if rest is None else turn.T @ rest.angular_velocity,
            tilt_rad=config.moving_tilt_rad if rest is None else config.initial_tilt_rad,
            velocity_mps=config.moving_velocity_mps if rest is None else config.initial_velocity_mps,
        )

    def _take_rest(self, core: FootholdFilter, rest: ImuMeans | None) -> None:
        """Set the gyroscope bias to the mean over the standstill, once a window."""
        if rest is None:
            self._rests = []
            return
        window_ns = self.config.standstill.window_s * NS_PER_S
        if self._rests and rest.stamp_ns - self._rests[-1].stamp_ns < window_ns:
            return
        self._rests = [*self._rests[1 - _MOST_RESTS :], rest]
        bias_body = np.mean([each.angular_velocity for each in self._rests], axis=0)
        core.set_gyroscope_bias(self._T_body_imu[:3, :3].T @ bias_body)

    def _advance(self, core: FootholdFilter, stamp_ns: int, angular_velocity: Array, specific_force: Array) -> None:
        """Predict to ``stamp_ns`` with readings in the imu frame; a long gap inflates the covariance."""
        dt_s = (stamp_ns - self._stamp_ns) / NS_PER_S
        if dt_s <= 0.0:
            return
        core.predict(dt_s, angular_velocity, specific_force)
        self._stamp_ns = stamp_ns
        if dt_s > self.config.max_gap_s:
            self._counts["gap"] += 1
            turn, push = self.config.gap_rate_radps * dt_s, self.config.gap_acceleration_mps2 * dt_s
            core.inflate(np.repeat(np.square([turn, 0.5 * push * dt_s, push]), 3))

    def _correct(self, core: FootholdFilter, reading: Reading) -> None:
        """Correct the body by the feet in stance whose joints are known."""
        feet = reading.feet
        is_known: BoolArray = ~np.isnan(feet.position_body[:, 0])  # a velocity is not needed
        self._feet_body = np.where(is_known[:, None], feet.position_body, self._feet_body)
        is_held = (reading.contact.is_stance | reading.is_stationary) & is_known
        points = feet.position_body
        shift = reading.contact_shift_body
        if self.config.rolling_feet or shift is not None:
            points = self._unrolled(core.T_world_body[:3, :3], feet, is_held & core.is_stance, shift)
        core.correct(points, is_held)

    def _unrolled(
        self, rotation_world_body: Array, feet: FeetKinematics, is_rolling: BoolArray, shift_body: Array | None
    ) -> Array:
        """Feet less what they have rolled since touchdown, m, body frame, (legs, 3): points at rest in the world.

        A sphere that turns by the small rotation ``theta`` on flat ground moves by ``theta x r e_z``; the point of
        contact of a sole that rocks goes along the sole by ``shift_body``, as in ``Reading``.
        """
        step = np.zeros((self._legs, 3))
        if self.config.rolling_feet:
            now = rotation_world_body @ feet.rotation_body_foot
            turned = so3.log_below_pi(now @ np.swapaxes(self._R_world_foot, 1, 2))
            step = np.cross(turned, self._robot.foot_radii_m[:, None] * np.array([0.0, 0.0, 1.0]))
            self._R_world_foot = now
        if shift_body is not None:
            step = step + 0.5 * (shift_body[0] @ self._R_world_body.T + shift_body[1] @ rotation_world_body.T)
            self._R_world_body = rotation_world_body
        self._rolled = np.where(is_rolling[:, None], self._rolled + step, 0.0)
        return np.asarray(feet.position_body - self._rolled @ rotation_world_body)
