# SPDX-License-Identifier: BSD-3-Clause
"""The estimators that can be run, by name. A further one is one row here, one class, one test."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

from coclo_vio.errors import ConfigError, listing
from coclo_vio.estimates import Estimator
from coclo_vio.filter.naive import NaiveLegOdometry
from coclo_vio.filter.odometry import LegOdometryFilter
from coclo_vio.robot.model import RobotModel
from coclo_vio.run_config import RunConfig


@dataclass(frozen=True, slots=True)
class EstimatorKind:
    """One row of the registry.

    Attributes:
        summary: what it is, in a line.
        make: from a robot and a configuration to a fresh estimator.
    """

    summary: str
    make: Callable[[RobotModel, RunConfig], Estimator]


def _coclo(robot: RobotModel, config: RunConfig) -> Estimator:
    return LegOdometryFilter(robot, config.filter)


def _coclo_leg_scale(robot: RobotModel, config: RunConfig) -> Estimator:
    robust = config.filter.robust.model_copy(update={"estimates_leg_scale": True})
    return LegOdometryFilter(robot, config.filter.model_copy(update={"profile": "robust", "robust": robust}))


def _coclo_paper(robot: RobotModel, config: RunConfig) -> Estimator:
    return LegOdometryFilter(robot, config.filter.model_copy(update={"profile": "paper"}))


def _inekf(robot: RobotModel, config: RunConfig) -> Estimator:
    from coclo_vio.backend.inekf import InvariantLegOdometry  # noqa: PLC0415 -- loads GTSAM only where it is asked for

    return InvariantLegOdometry(robot, config.inekf)


def _naive(*, rolls_feet: bool, weighs_load: bool) -> Callable[[RobotModel, RunConfig], Estimator]:
    return lambda robot, config: NaiveLegOdometry(robot, config.filter, rolls_feet=rolls_feet, weighs_load=weighs_load)


ESTIMATORS: Mapping[str, EstimatorKind] = {
    "coclo": EstimatorKind("contact-centric leg odometry, the configured profile (default: robust)", _coclo),
    "coclo_leg_scale": EstimatorKind("the robust profile, estimating the effective leg length", _coclo_leg_scale),
    "coclo_paper": EstimatorKind("the paper's profile, section III as printed", _coclo_paper),
    "inekf": EstimatorKind("IMU-centric contact-aided filter of GTSAM, a baseline", _inekf),
    "naive": EstimatorKind(
        "stance feet averaged, foot centres at rest, gyroscope attitude", _naive(rolls_feet=False, weighs_load=False)
    ),
    "naive_rolling": EstimatorKind("naive with rolling feet", _naive(rolls_feet=True, weighs_load=False)),
    "naive_weighted": EstimatorKind(
        "naive with rolling feet weighed by load", _naive(rolls_feet=True, weighs_load=True)
    ),
}


def make_estimator(name: str, robot: RobotModel, config: RunConfig) -> Estimator:
    """A fresh estimator.

    Raises:
        ConfigError: no such name; lists those there are.
    """
    kind = ESTIMATORS.get(name)
    if kind is None:
        raise ConfigError(f"there is no mode {name!r}; the modes are: {listing(ESTIMATORS)}")
    return kind.make(robot, config)
