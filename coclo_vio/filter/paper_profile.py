# SPDX-License-Identifier: BSD-3-Clause
"""The ``paper`` profile: sections III-B to III-E as printed.

Where the paper contradicts itself or leaves something open:

* it counts 46 states and 32 measurements for six legs; the members it lists make 43 and 33;
* its angular velocity is a world rate in the state and a body rate in the quaternion product: here a body rate;
* the prediction subtracts the gyroscope bias from it, the measurement does not add it: so it is here;
* a swing foot moves with eq. (4), the foot's velocity relative to the body: the body's own velocity is left out;
* the right side of eq. (6) needs a minus for the equation above it to hold: here it has one;
* with fewer than three stance feet eq. (6) has no unique solution: least squares of smallest norm is used there, with
  the rate of the gyroscope alone;
* "we set the innovation to be zero" for gravity unless all feet stand: so it is here, which shrinks the covariance all
  the same. The ``robust`` profile drops the rows.
"""

from collections import Counter
from dataclasses import replace

import numpy as np

from coclo_vio.filter.config import InitialConfig, PaperConfig
from coclo_vio.filter.imu_delay import ImuDelay
from coclo_vio.filter.initialisation import FootPrior
from coclo_vio.filter.leg_check import LegCheck
from coclo_vio.filter.measurement_model import specific_force_at_rest
from coclo_vio.filter.square_root_filter import SquareRootFilter
from coclo_vio.filter.stance import Reading
from coclo_vio.filter.state import (
    GYROSCOPE_BIAS,
    POSITION,
    RATE,
    ROTATION,
    VELOCITY,
    State,
    StateLayout,
)
from coclo_vio.filter.state_blocks import paper_blocks
from coclo_vio.geometry import so3
from coclo_vio.robot.leg_sensing import InertialStep
from coclo_vio.robot.model import RobotModel
from coclo_vio.values.arrays import Array, BoolArray
from coclo_vio.values.errors import FilterError


class PaperProfile:
    """The steps of the filter as printed in the paper."""

    def __init__(
        self,
        robot: RobotModel,
        config: PaperConfig,
        counts: Counter[str],
        *,
        initial: InitialConfig | None = None,
        has_frame: bool = False,
    ) -> None:
        """Take a robot and parameters; arguments as in ``RobustProfile``."""
        imu, initial = robot.description.imu, initial or InitialConfig()
        self.layout = StateLayout(paper_blocks(len(robot.leg_names), config, initial, imu, has_frame=has_frame))
        self._contacts = self.layout.at("contacts")
        self.is_wide = True
        self.can_coast = False
        self.leg_check: LegCheck | None = None
        self.imu_delay: ImuDelay | None = None
        self.creep_level = 1.0
        self._config = config
        self._counts = counts

    def start(self, reading: Reading) -> None:
        """Do nothing: this profile has no memory outside the state."""

    def foot_prior(self, reading: Reading) -> FootPrior:
        """Uncertainty of the feet at the start."""
        return FootPrior(self._config.foot_noise_m, load_ratio=np.zeros(self.layout.legs))

    def step(
        self, core: SquareRootFilter, reading: Reading, dt_s: float, gyroscope_noise_radps: float, *, is_gap: bool
    ) -> BoolArray:
        """Predict to the reading and update by it; returns the legs that count as stance, (n,)."""
        config = self._config
        swings = core.mean.vector[self._contacts] < config.swing_probability
        velocity = np.where(reading.is_known[:, None], reading.feet.velocity_body, 0.0) * swings[:, None]
        core.predict(lambda stack: _predict(stack, dt_s, velocity), lambda mean: self._noise_rows(mean, dt_s))
        stance = (core.mean.vector[self._contacts] >= config.swing_probability) & reading.is_known
        self._update(core, reading, stance)
        return np.asarray(stance)

    def coast(self, core: SquareRootFilter, step: InertialStep, dt_s: float, gyroscope_noise_radps: float) -> None:
        """Not there: this profile takes a whole gap in one step, as printed.

        Raises:
            FilterError: always.
        """
        raise FilterError("the paper's profile takes a gap in one step; see can_coast")

    def _noise_rows(self, mean: State, dt_s: float) -> Array:
        """Diagonal Q, smaller for feet in certain stance (section III-E), in the errors of ``State``."""
        config, layout = self._config, self.layout
        sigmas = layout.walks[: layout.active].copy()
        is_certain = mean.vector[self._contacts] >= config.certain_stance_probability
        shrink = np.sqrt(np.where(is_certain, config.certain_stance_ratio, 1.0))
        sigmas[layout.feet] *= np.repeat(shrink, 3)
        rows = np.zeros((len(sigmas), layout.dimension))
        rows[:, : len(sigmas)] = np.diag(sigmas * np.sqrt(dt_s))
        world = mean.vector[layout.world].reshape(-1, 3)
        turned = np.einsum("nij,rj->rni", -so3.hat(world), rows[ROTATION, ROTATION])
        rows[ROTATION, layout.world] -= turned.reshape(3, -1)
        return rows

    def _update(self, core: SquareRootFilter, reading: Reading, stance: BoolArray) -> None:
        config = self._config
        known = np.flatnonzero(reading.is_known)
        body = _body_velocity(reading, stance, core.mean.rotation)

        def model(stack: State) -> Array:
            relative = stack.vector[:, None, POSITION] - stack.feet[:, known]
            feet = (relative @ stack.rotation).reshape(len(stack.vector), -1)
            columns = [feet, stack.vector[:, self._contacts][:, known]]
            if reading.specific_force is not None:
                columns.append(specific_force_at_rest(stack))
            if body is not None:
                columns.append(stack.vector[:, VELOCITY])
                columns.append(stack.vector[:, RATE])
            return np.concatenate(columns, axis=1)

        predicted, rows = core.observe(model)
        measured = [-reading.feet.position_body[known].ravel(), reading.contact.probability[known]]
        sigmas = [np.full(3 * len(known), config.foot_noise_m), np.full(len(known), config.contact_noise)]
        if reading.specific_force is not None:
            gravity = slice(4 * len(known), 4 * len(known) + 3)
            measured.append(reading.specific_force if stance.all() else predicted[gravity])
            sigmas.append(np.full(3, config.gravity_noise_mps2))
        if body is not None:
            measured.extend(body)
            sigmas.append(np.repeat((config.velocity_noise_mps, config.rate_noise_radps), 3))
        core.update(rows, np.diag(np.concatenate(sigmas)), np.concatenate(measured) - predicted)


def _predict(stack: State, dt_s: float, swing_velocity_body: Array) -> State:
    """Eq. (5): constant velocity and rate, swing feet by eq. (4)."""
    vector = stack.vector.copy()
    turn = (vector[:, RATE] - vector[:, GYROSCOPE_BIAS]) * dt_s
    vector[:, POSITION] += vector[:, VELOCITY] * dt_s
    moved = swing_velocity_body @ np.swapaxes(stack.rotation, -1, -2) * dt_s
    vector[:, stack.layout.feet] += moved.reshape(len(vector), -1)
    return replace(stack, rotation=stack.rotation @ so3.exp(turn), vector=vector)


def _body_velocity(reading: Reading, stance: BoolArray, rotation: Array) -> tuple[Array, Array] | None:
    """World velocity and body rate by eq. (6) from the stance feet, the rate averaged with the gyroscope."""
    legs = np.flatnonzero(stance)
    if not len(legs):
        return None
    feet = reading.feet
    left = np.concatenate([np.hstack((np.eye(3), -so3.hat(feet.position_body[leg]))) for leg in legs])
    right = -feet.velocity_body[legs].ravel()
    rate = reading.angular_velocity
    if len(legs) < 3 and rate is not None:
        solution, *_ = np.linalg.lstsq(left[:, :3], right - left[:, 3:] @ rate, rcond=None)
        return rotation @ solution, rate
    solution, *_ = np.linalg.lstsq(left, right, rcond=None)
    if rate is not None:
        return rotation @ solution[:3], 0.5 * (solution[3:] + rate)
    return rotation @ solution[:3], solution[3:]
