# SPDX-License-Identifier: BSD-3-Clause
"""Analytic trials of Daisy, made once a session, and the filter's readings of them."""

from collections.abc import Callable, Iterable

import numpy as np
import pytest

from coclo_vio.filter.config import FilterConfig
from coclo_vio.filter.stance import Reading
from coclo_vio.robot.description import load_robot
from coclo_vio.robot.leg_sensing import LegSensing
from coclo_vio.robot.model import RobotModel
from coclo_vio.simulation.analytic import AnalyticTrial, AnalyticTrialConfig, SensorNoiseConfig, generate
from coclo_vio.simulation.body_motion import BodyMotionConfig
from coclo_vio.values.measurements import Measurement

WALK = BodyMotionConfig(rest_s=1.0, walk_s=3.0, stop_s=0.5, ramp_s=0.6, speed_mps=0.18, curvature_per_m=0.4)


@pytest.fixture(scope="session")
def daisy() -> RobotModel:
    return RobotModel(load_robot("daisy"))


@pytest.fixture(scope="session")
def noisy_walk(daisy: RobotModel) -> AnalyticTrial:
    return generate(AnalyticTrialConfig(body=WALK), daisy, seed=7)


@pytest.fixture(scope="session")
def clean_walk(daisy: RobotModel) -> AnalyticTrial:
    config = AnalyticTrialConfig(body=WALK, sensors=SensorNoiseConfig(noise_scale=0.0))
    return generate(config, daisy, seed=7)


@pytest.fixture(scope="session")
def readings_of(daisy: RobotModel) -> Callable[[Iterable[Measurement]], list[Reading]]:
    """The readings of measurements, with the upward direction along the body's z axis."""

    def read(measurements: Iterable[Measurement]) -> list[Reading]:
        config = FilterConfig()
        timeout_s = config.force_timeout_s
        sensing = LegSensing(daisy, daisy.description.contact, config.standstill, force_timeout_s=timeout_s)
        pushed = (sensing.push(measurement, np.array([0.0, 0.0, 1.0])) for measurement in measurements)
        return [reading for reading in pushed if reading is not None]

    return read
