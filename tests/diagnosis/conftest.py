# SPDX-License-Identifier: BSD-3-Clause
"""Beginnings of sound walks."""

from itertools import takewhile

import pytest
from altered_walks import Walk

from coclo_vio.datasets.dataset import open_dataset
from coclo_vio.datasets.sample import sample_path
from coclo_vio.robot.description import load_robot
from coclo_vio.robot.model import RobotModel
from coclo_vio.simulation.analytic import AnalyticTrialConfig, generate
from coclo_vio.simulation.body_motion import BodyMotionConfig
from coclo_vio.values.trajectory import GroundTruth

_LENGTH_S = 11.0


@pytest.fixture(scope="session")
def walk() -> Walk:
    """The first seconds of the bundled recording: torques, no foot forces."""
    robot = load_robot("daisy")
    dataset = open_dataset(sample_path(), robot)
    stream = dataset.measurements()
    first = next(stream)
    end_ns = first.stamp_ns + round(_LENGTH_S * 1e9)
    samples = [first, *takewhile(lambda sample: sample.stamp_ns < end_ns, stream)]
    kept = set(sorted({sample.stamp_ns for sample in samples})[::2])  # 50 Hz are enough
    samples = [sample for sample in samples if sample.stamp_ns in kept]
    truth = dataset.ground_truth()
    assert truth is not None
    trajectory = truth.trajectory
    return Walk(robot, samples, GroundTruth(trajectory.select(trajectory.stamps_ns < end_ns), True, truth.source))


@pytest.fixture(scope="session")
def go1_walk() -> Walk:
    """A Go1 that turns as it walks: foot forces in counts."""
    robot = load_robot("go1")
    body = BodyMotionConfig(rest_s=1.0, walk_s=4.0, stop_s=0.5, ramp_s=0.5)
    trial = generate(AnalyticTrialConfig(body=body, rate_hz=50.0), RobotModel(robot), seed=5)
    return Walk(robot, trial.measurements, GroundTruth(trial.truth, True, "truth"))
