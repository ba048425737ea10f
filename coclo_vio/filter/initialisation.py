# SPDX-License-Identifier: BSD-3-Clause
"""The filter's first state: from rest where the robot stands still, otherwise from the mean specific force so far."""

from dataclasses import dataclass

import numpy as np

from coclo_vio.filter import measurement_model
from coclo_vio.filter.config import InitialConfig
from coclo_vio.filter.square_root_filter import SquareRootFilter
from coclo_vio.filter.stance import Reading
from coclo_vio.filter.state import (
    GYROSCOPE_BIAS,
    LEG_COMPLIANCE,
    State,
    StateLayout,
)
from coclo_vio.geometry import so3
from coclo_vio.robot.standstill import ImuMeans
from coclo_vio.values.arrays import Array

_MIN_FORCE_MPS2 = 1.0  # a smaller mean specific force has no usable direction: the body is taken as level


@dataclass(frozen=True, slots=True, eq=False)
class FootPrior:
    """Uncertainty of the feet at the start.

    Attributes:
        noise_m: one sigma of a foot position in the body frame by itself, m.
        load_ratio: load on each foot as a multiple of the load from which a foot stands, (n,).
    """

    noise_m: float
    load_ratio: Array


def initial_filter(
    layout: StateLayout,
    config: InitialConfig,
    reading: Reading,
    rest: ImuMeans | None,
    *,
    moving_force: Array | None,
    foot_prior: FootPrior,
    is_wide: bool,
    is_moving: bool | None = None,
) -> SquareRootFilter:
    """The filter at its first reading: position and yaw zero, level by gravity, gyroscope bias from rest.

    Args:
        layout: order of the errors.
        config: uncertainties.
        reading: the first reading; unknown legs start under the body.
        rest: mean readings of the body's IMU at rest; None without.
        moving_force: mean specific force for a start without them, body frame, m/s^2, (3,); None: level.
        foot_prior: uncertainty of the feet.
        is_wide: see ``SquareRootFilter``.
        is_moving: whether the robot may move; None: where there are no readings at rest.
    """
    force = moving_force if rest is None else rest.specific_force
    is_level = force is None or float(np.linalg.norm(force)) < _MIN_FORCE_MPS2
    rotation = np.eye(3) if force is None or is_level else so3.from_gravity(force)
    vector = np.zeros(layout.dimension)
    vector[layout.feet] = (np.nan_to_num(reading.feet.position_body) @ rotation.T).ravel()
    if layout.has_contacts:
        vector[layout.at("contacts")] = reading.contact.probability
    if rest is not None:
        vector[GYROSCOPE_BIAS] = rest.angular_velocity
    mean = State(layout, rotation, vector, np.tile(np.eye(3), (len(layout.poses), 1, 1)))
    sigmas = layout.sigmas(is_moving=rest is None if is_moving is None else is_moving)
    sigmas[layout.feet] = foot_prior.noise_m
    core = SquareRootFilter(mean, sigmas, is_wide=is_wide)
    _correlate_feet(core, foot_prior)
    if rest is not None:
        _update_at_rest(core, config, rest)
    return core


def _correlate_feet(core: SquareRootFilter, foot_prior: FootPrior) -> None:
    """Correlate the feet with the leg compliance: they are placed as by rigid legs and share the error of that.

    Without it the first footholds, measured by the same joint angles, would determine the compliance to be zero.
    """
    feet = core.mean.layout.feet
    compliance_m = core.active_factor[LEG_COMPLIANCE, LEG_COMPLIANCE].item()
    core.active_factor[feet.start + 2 : feet.stop : 3, LEG_COMPLIANCE] = compliance_m * foot_prior.load_ratio[:, None]


def _update_at_rest(core: SquareRootFilter, config: InitialConfig, rest: ImuMeans) -> None:
    """One update with gravity (tilt and accelerometer bias become correlated) and with the rate at rest."""

    def model(stack: State) -> Array:
        return np.concatenate(
            (
                measurement_model.specific_force_at_rest(stack),
                measurement_model.gyroscope(stack, rest.angular_velocity),
            ),
            axis=1,
        )

    predicted, rows = core.observe(model)
    measured = np.concatenate((rest.specific_force, rest.angular_velocity))
    noise = np.repeat((config.rest_force_noise_mps2, config.rest_rate_noise_radps), 3)
    core.update(rows, np.diag(noise), measured - predicted)
