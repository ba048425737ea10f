# SPDX-License-Identifier: BSD-3-Clause
"""One step of the ``robust`` profile: predict with the feet, reject legs that slip, update with the others."""

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial

import numpy as np
from scipy.stats import chi2

from coclo_vio.filter import measurement_model
from coclo_vio.filter.acceleration_input import AccelerationInput
from coclo_vio.filter.compiled_models import CompiledModels
from coclo_vio.filter.config import InitialConfig, RobustConfig
from coclo_vio.filter.foot_weights import FootWeights
from coclo_vio.filter.gravity import GravityScale, GravityWindow
from coclo_vio.filter.ground_plane import GroundPlane
from coclo_vio.filter.imu_delay import ImuDelay
from coclo_vio.filter.initialisation import FootPrior
from coclo_vio.filter.leg_check import LegCheck
from coclo_vio.filter.leg_intervals import IntervalNoise
from coclo_vio.filter.measurement_model import LegConstants
from coclo_vio.filter.robust_models import DirectModels, Expectation, RobustModels
from coclo_vio.filter.sole_rotation import SOLES, SoleRotation, sole_block
from coclo_vio.filter.square_root_filter import SquareRootFilter
from coclo_vio.filter.stance import Footholds, Reading, load_ratio_of
from coclo_vio.filter.state import CONSIDERED_BY_LEGS, GYROSCOPE_BIAS, VELOCITY, StateLayout
from coclo_vio.filter.state_blocks import FEW_LEGS, KNOWN_SIGMA, StateBlock, bias_sigmas, robust_blocks
from coclo_vio.geometry import so3
from coclo_vio.geometry.compiled import IS_COMPILED
from coclo_vio.robot.description import RobotDescription
from coclo_vio.robot.leg_sensing import InertialStep
from coclo_vio.robot.model import RobotModel
from coclo_vio.values.arrays import Array, BoolArray


class RobustProfile:
    """The steps of the filter with rolling feet, an innovation gate for each leg, and rows only where there is data."""

    def __init__(
        self,
        robot: RobotModel,
        config: RobustConfig,
        counts: Counter[str],
        *,
        initial: InitialConfig | None = None,
        has_frame: bool = False,
        extra_blocks: Sequence[StateBlock] = (),
        holds_soles: bool = True,
        is_compiled: bool = IS_COMPILED,
    ) -> None:
        """Take a robot and parameters.

        Args:
            robot: the legs.
            config: parameters of the profile.
            counts: where unusual events are counted.
            initial: sigmas at the start; the defaults if None.
            has_frame: whether camera frames are remembered.
            extra_blocks: further blocks of the state.
            holds_soles: whether the orientations of flat feet are states.
            is_compiled: by kernels, or by NumPy.
        """
        imu, initial = robot.description.imu, initial or InitialConfig()
        soles = sole_block(robot, config) if holds_soles else None
        self.layout = StateLayout(
            robust_blocks(
                len(robot.leg_names),
                config,
                initial,
                imu,
                has_frame=has_frame,
                extra=(*((soles,) if soles else ()), *extra_blocks),
            )
        )
        self._soles = None if soles is None else SoleRotation(robot, config, self.layout.at(SOLES).start, counts)
        self.is_wide = False
        self.can_coast = True
        self.leg_check: LegCheck | None = None
        self.creep_level = 1.0
        self.imu_delay: ImuDelay | None = None
        self.watch: Callable[[int, Expectation], None] | None = None  # called before each update, with its stamp
        self._robot: RobotDescription = robot.description
        self._model = robot
        self._gyroscope_error_radps = bias_sigmas(initial, imu)[0]
        self._config = config
        self._counts = counts
        sensing = _legs_of(robot, config, has_frame=has_frame)
        self._gate = {rows: float(chi2.ppf(config.gate_probability, rows)) for rows in (3, 6)}
        self._models: RobustModels = (
            CompiledModels(sensing, self._robot.encoder_noise_rad, self._gate, self.layout)
            if is_compiled
            else DirectModels(sensing, self._robot.encoder_noise_rad, self._gate)
        )
        self._imu_lever = so3.hat(np.array(imu.position_body_m))  # w @ it = w x position
        self._acceleration = AccelerationInput(config, self._imu_lever)
        self._weights = FootWeights(sensing.radii_m, config, has_soles=robot.description.has_flat_feet)
        self._footholds: Footholds | None = None
        self._rejecting_s, self._stood_s = 0.0, np.zeros(len(robot.leg_names))
        self._gravity_scale = GravityScale(config.gravity_least_scale)
        self._gravity = GravityWindow(config.gravity_dwell_s, config.gravity_window_s)

    def start(self, reading: Reading) -> None:
        """Take the first reading; its feet in stance become footholds."""
        ground = GroundPlane(self.layout.legs, self._config.ground)
        slips_by_load = any(
            each.name == "load_slip" and np.max(each.sigma) > KNOWN_SIGMA for each in self.layout.blocks
        )
        self._footholds = Footholds(reading, self._robot.contact.on_force, ground, follows_takeover=slips_by_load)
        self._rejecting_s = 0.0
        config = self._config.leg_check
        foot_m = float(np.linalg.norm(self._models.foot_noise(reading), axis=(1, 2)).mean() / np.sqrt(3.0))
        expected = self._config.imu_delay_s, self._config.imu_delay_sigma_s
        self.imu_delay = ImuDelay(self._model.foot_radii_m, foot_m, *expected)
        if config.is_enabled:
            noise = IntervalNoise(foot_m, self._config.foothold_creep, self._gyroscope_error_radps)
            self.leg_check = LegCheck(self._model, config, noise)

    def foot_prior(self, reading: Reading) -> FootPrior:
        """Uncertainty of the feet at the start; the noise is the largest of any foot."""
        return FootPrior(
            noise_m=float(np.linalg.norm(self._models.foot_noise(reading), axis=(1, 2)).max() / np.sqrt(3.0)),
            load_ratio=load_ratio_of(reading, self._robot.contact.on_force, before=np.zeros(self.layout.legs)),
        )

    def step(
        self, core: SquareRootFilter, reading: Reading, dt_s: float, gyroscope_noise_radps: float, *, is_gap: bool
    ) -> BoolArray:
        """Predict to the reading and update by it; returns the legs that were used as stance, (n,)."""
        assert self._footholds is not None, "start() comes first"
        motion = self._footholds.advance(reading, speed_mps=_speed_of(core), is_gap=is_gap)
        foot_noise = self._models.foot_noise(reading)
        self._counts["no_contact"] += not reading.stands
        if self.imu_delay is not None:
            self._models.imu_delay_s = self.imu_delay.value_s
        rotation_before = core.mean.rotation
        self._acceleration.predict(core, reading, dt_s, is_gap=is_gap)
        self._models.acceleration_density = self._acceleration.density
        self._models.stance_noise = self._weights.noise(core, reading, motion, dt_s=dt_s, creep_level=self.creep_level)
        self._models.predict(core, motion, dt_s, foot_noise)
        if reading.contact_shift_body is not None:
            _move_footholds(core, rotation_before, np.where(motion.holds[:, None], reading.contact_shift_body, 0.0))
        expectation = self._models.expect(
            core, reading, motion, foot_noise=foot_noise, gyroscope_noise_radps=gyroscope_noise_radps
        )
        if expectation is None:
            self._counts["step_without_measurement"] += 1
            self._gravity.close()
            return np.zeros(self.layout.legs, dtype=np.bool_)
        if self.watch is not None:
            self.watch(reading.stamp_ns, expectation)
        rejected = self._rejected(expectation, self._footholds, reading, dt_s)
        expectation.update(core, rejected)
        self._acceleration.learn(core)
        self._update_gravity(core, reading, is_gap=is_gap)
        if self._soles is not None:
            self._soles.update(core, reading, reading.is_stance & ~rejected, is_gap=is_gap)
        self._compare_legs(core, reading, is_gap=is_gap)
        if self._config.ground.is_enabled and self._config.rolls_feet:
            self._footholds.ground.push(core.mean.feet, reading.is_stance & ~rejected, dt_s)
        if self.imu_delay is not None and self._config.imu_delay_sigma_s > 0.0:
            self.imu_delay.push(reading, core.mean.rotation[2], core.mean.vector[GYROSCOPE_BIAS])
        return reading.is_stance & ~rejected

    def _compare_legs(self, core: SquareRootFilter, reading: Reading, *, is_gap: bool) -> None:
        """Compare each leg with the others, over intervals that end here."""
        if self.leg_check is None:
            return
        if is_gap:
            self.leg_check.clear()
        self.leg_check.push(reading, core.mean.rotation)

    def coast(self, core: SquareRootFilter, step: InertialStep, dt_s: float, gyroscope_noise_radps: float) -> None:
        """One step without joints, to a sample of the IMU."""
        assert self._footholds is not None, "start() comes first"
        self._gravity.close()
        self._acceleration.coast(core, step, dt_s)
        self._models.acceleration_density = self._acceleration.density
        motion = self._footholds.carried()
        self._models.predict(core, motion, dt_s, np.tile(np.eye(3), (self.layout.legs, 1, 1)))
        predicted, rows = core.observe(partial(measurement_model.gyroscope, reading=step.angular_velocity))
        noise_rows = gyroscope_noise_radps * np.eye(3)
        core.update(rows, noise_rows, step.angular_velocity - predicted, considered=CONSIDERED_BY_LEGS)

    def _rejected(self, expectation: Expectation, footholds: Footholds, reading: Reading, dt_s: float) -> BoolArray:
        """The legs (n,) to leave out: those set aside, and others unless all have been rejected for too long."""
        if self.leg_check is None or not self.leg_check.any_aside:
            return self._gated(expectation.rejected, footholds, reading, dt_s)
        is_aside = self.leg_check.is_aside
        footholds.release(is_aside)
        return self._gated(expectation.rejected & ~is_aside, footholds, reading, dt_s) | is_aside

    def _gated(self, rejected: BoolArray, footholds: Footholds, reading: Reading, dt_s: float) -> BoolArray:
        """The legs (n,) that the gate leaves out; none where all stance legs have been rejected for too long."""
        is_settling = self._settling(reading, dt_s)
        if not np.count_nonzero(rejected):
            self._rejecting_s = 0.0
            if np.count_nonzero(is_settling):
                footholds.release(is_settling)
            return is_settling
        stands = reading.is_stance & ~is_settling
        is_rejecting_all = bool(stands.any() and not (stands & ~rejected).any())
        rejected = rejected | is_settling
        self._rejecting_s = self._rejecting_s + dt_s if is_rejecting_all else 0.0
        if self._rejecting_s > self._config.recovery_s:
            self._counts["recovery"] += 1
            self._rejecting_s = 0.0
            return np.zeros(self.layout.legs, dtype=np.bool_)
        self._counts["leg_rejected"] += int((rejected & ~is_settling).sum())
        footholds.release(rejected)
        return rejected

    def _settling(self, reading: Reading, dt_s: float) -> BoolArray:
        """The stance legs (n,) that have just touched down, where the accelerometer has the velocity meanwhile."""
        self._stood_s = np.where(reading.is_stance, self._stood_s + dt_s, 0.0)
        if not self._acceleration.is_used:
            return np.zeros(self.layout.legs, dtype=np.bool_)
        return reading.is_stance & (self._stood_s < self._config.settling_s)

    def _update_gravity(self, core: SquareRootFilter, reading: Reading, *, is_gap: bool) -> None:
        """Collect specific force while all feet stand, and update by gravity where a window is complete."""
        mean = core.mean
        if is_gap:
            self._gravity.close()
            return
        gravity = self._gravity.collect(core, reading, reading.specific_force, self._imu_lever)
        if gravity is None:
            return
        claimed = gravity.sigma(core, self._config.gravity_noise_mps2)
        sigma = claimed * self._gravity_scale.scale
        expectation = self._models.expect_gravity(core, mean.rotation.T @ gravity.force_world, sigma)
        if self._config.gravity_least_scale < 1.0:
            self._gravity_scale.learn(expectation.mean_excess / claimed**2)
        if expectation.innovation_squared > self._gate[3]:
            self._counts["gravity_rejected"] += 1
            return
        expectation.update(core, expectation.rejected)


def _speed_of(core: SquareRootFilter) -> float:
    """Speed of the body, m/s."""
    return float(np.linalg.norm(core.mean.vector[VELOCITY]))


def _move_footholds(core: SquareRootFilter, rotation_before: Array, shift_body: Array) -> None:
    """Footholds move with their point of contact, by ``(R_before s_before + R s) / 2``.

    Right-invariant errors stay as they are where something measured in the body is added.

    Args:
        core: the filter after its prediction.
        rotation_before: ``R_world_body`` before it, (3, 3).
        shift_body: displacements in body axes before and after it, m, (2, n, 3).
    """
    vector = core.mean.vector.copy()
    shift_world = 0.5 * (shift_body[0] @ rotation_before.T + shift_body[1] @ core.mean.rotation.T)
    vector[core.mean.layout.feet] += shift_world.ravel()
    core.mean = replace(core.mean, vector=vector)


def _legs_of(robot: RobotModel, config: RobustConfig, *, has_frame: bool) -> LegConstants:
    legs, known = len(robot.leg_names), config.takes_slip_for_known
    return LegConstants(
        robot.foot_radii_m if config.rolls_feet else np.zeros(legs),
        robot.hip_position_body,
        robot.description.joint_velocity_noise_radps,
        config,
        takes_slip_for_known=(legs <= FEW_LEGS and not has_frame) if known is None else known,
    )
