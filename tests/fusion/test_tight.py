# SPDX-License-Identifier: BSD-3-Clause
"""Legs and vision in one estimator: nothing is counted twice, and the estimate follows an analytic walk."""

from collections.abc import Iterable
from functools import cache

import numpy as np
import pytest
from walk_among_points import (
    DAISY,
    FRAME_NS,
    JOINT_NS,
    NOISE_PX,
    RIG,
    error_m,
    in_order,
    states,
    stream,
    without,
    without_tracks,
)

from coclo_vio.backend.window.config import SmootherConfig
from coclo_vio.backend.window.leg_source import LegSource
from coclo_vio.backend.window.smoother import SlidingWindowSmoother
from coclo_vio.filter.between_states import between
from coclo_vio.filter.config import FilterConfig
from coclo_vio.filter.odometry import LegOdometryFilter
from coclo_vio.frontend.config import FrontendConfig
from coclo_vio.fusion.tight import TightOdometry, tight_odometry
from coclo_vio.fusion.vision_chain import Smoother
from coclo_vio.values.arrays import Array
from coclo_vio.values.calibration import CameraCalibration, StereoCalibration, matrix4
from coclo_vio.values.errors import ConfigError
from coclo_vio.values.leg_motion import LegState
from coclo_vio.values.measurements import JointSample, Measurement, StereoTracks
from coclo_vio.values.outputs import Estimate, Output

KEYFRAMES, STEPS, LANDMARKS = 6, 4, 2
PROCESS = np.diag([0.05, 0.01, 1e-3]) ** 2  # of [place, foothold, bias of the measured step] a step
FOOT_NOISE, VISION_NOISE = 0.02, 0.1
START = np.diag([1e-3, 0.1, 0.2]) ** 2
FORWARD = np.array([[1.0, 0.0, 1.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])  # the step is measured, and has the bias
FOOT = np.array([[-1.0, 1.0, 0.0]])  # measured: the foothold from the place


class LinearLegs:
    """A foothold that stands across all keyframes, a step with a constant bias, and landmarks."""

    def __init__(self, seed: int) -> None:
        random = np.random.default_rng(seed)
        self.steps = random.normal(0.1, 0.05, size=(KEYFRAMES - 1, STEPS))
        self.feet = random.normal(0.0, 0.3, size=(KEYFRAMES - 1, STEPS))
        self.observed = random.normal(1.0, 0.3, size=(KEYFRAMES, LANDMARKS))

    def all_at_once(self) -> tuple[Array, Array]:
        """Mean and covariance of the last state by every measurement in one system."""
        count = (KEYFRAMES - 1) * STEPS + 1
        size = 3 * count + LANDMARKS
        information, vector = np.zeros((size, size)), np.zeros(size)

        def add(columns: Array, at: int, measured: Array, noise: Array) -> None:
            rows = slice(at, at + columns.shape[1])
            information[rows, rows] += columns.T @ np.linalg.inv(noise) @ columns
            vector[rows] += columns.T @ np.linalg.inv(noise) @ measured

        add(np.eye(3), 0, np.zeros(3), START)
        for each, (step, foot) in enumerate(zip(self.steps.ravel(), self.feet.ravel(), strict=True)):
            move = np.concatenate((-FORWARD, np.eye(3)), axis=1)
            add(move, 3 * each, np.array([step, 0.0, 0.0]), PROCESS)
            add(FOOT, 3 * each + 3, np.array([foot]), np.eye(1) * FOOT_NOISE**2)
        for keyframe in range(KEYFRAMES):
            for landmark in range(LANDMARKS):
                at, point = 3 * STEPS * keyframe, 3 * count + landmark
                row = np.zeros(size)
                row[at], row[point] = -1.0, 1.0
                information += np.outer(row, row) / VISION_NOISE**2
                vector += row * self.observed[keyframe, landmark] / VISION_NOISE**2
        covariance = np.linalg.inv(information)
        last = slice(3 * count - 3, 3 * count)
        return (covariance @ vector)[last], covariance[last, last]

    def preintegrated(self, start: Array, covariance: Array, number: int) -> tuple[Array, Array, Array]:
        """The filter from a keyframe to the next: the state there, and the factor of both, (r, 6) and (r,)."""
        mean, joint = np.concatenate((np.zeros(3), start)), np.tile(covariance, (2, 2))
        for step, foot in zip(self.steps[number], self.feet[number], strict=True):
            mean[3:] = FORWARD @ mean[3:] + np.array([step, 0.0, 0.0])
            move = np.eye(6)
            move[3:, 3:] = FORWARD
            joint = move @ joint @ move.T
            joint[3:, 3:] += PROCESS
            row = np.concatenate((np.zeros((1, 3)), FOOT), axis=1)
            gain = joint @ row.T / (row @ joint @ row.T + FOOT_NOISE**2)
            mean, joint = mean + gain @ (foot - row @ mean), joint - gain @ row @ joint
        blocks = joint[:3, :3], joint[3:, :3], joint[3:, 3:]
        factor = between(np.linalg.cholesky(covariance), *blocks, mean[:3], noise=np.zeros((3, 3)))
        return mean[3:], factor.rows, factor.values


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_in_a_linear_world_the_window_estimates_as_all_measurements_at_once(seed: int) -> None:
    """The filter starts at every keyframe from all that the window knows, landmarks observed before included."""
    world = LinearLegs(seed)
    size = 3 * KEYFRAMES + LANDMARKS
    information, vector = 1e-9 * np.eye(size), np.zeros(size)
    information[:3, :3] += np.linalg.inv(START)
    for number in range(KEYFRAMES):
        for landmark in range(LANDMARKS):
            row = np.zeros(size)
            row[3 * number], row[3 * KEYFRAMES + landmark] = -1.0, 1.0
            information += np.outer(row, row) / VISION_NOISE**2
            vector += row * world.observed[number, landmark] / VISION_NOISE**2
        covariance = np.linalg.inv(information)
        newest = slice(3 * number, 3 * number + 3)
        mean = covariance @ vector
        if number == KEYFRAMES - 1:
            break
        end, rows, values = world.preintegrated(mean[newest], covariance[newest, newest], number)
        pair = slice(newest.start, newest.stop + 3)
        values = values + rows @ np.concatenate((mean[newest], end))  # from errors to the states themselves
        information[pair, pair] += rows.T @ rows
        vector[pair] += rows.T @ values
    expected, expected_covariance = world.all_at_once()
    np.testing.assert_allclose(mean[newest], expected, atol=1e-6)
    np.testing.assert_allclose(covariance[newest, newest], expected_covariance, rtol=1e-5, atol=1e-10)


def tight() -> TightOdometry:
    """The real filter and smoother, on tracks."""
    config = SmootherConfig.parse({"noise": {"track_px": NOISE_PX, "disparity_px": NOISE_PX}}, "test")

    def make_smoother(state: LegState, rotation: Array) -> tuple[Smoother, LegSource]:
        source = LegSource(state)
        return SlidingWindowSmoother(RIG, config, None, [source]), source

    legs = LegOdometryFilter(DAISY, preintegrates=True)
    return TightOdometry(legs, make_smoother, None)


def outputs_of(odometry: TightOdometry, measurements: Iterable[Measurement]) -> list[Output]:
    return [*(output for one in measurements for output in odometry.push(one)), *odometry.finish()]


@cache
def whole_walk() -> tuple[TightOdometry, list[Output]]:
    """The whole stream; for tests that only look at it."""
    odometry = tight()
    return odometry, outputs_of(odometry, stream())


def test_two_trajectories_come_out_that_agree() -> None:
    odometry, outputs = whole_walk()
    joints, frames = states(outputs, "tight"), states(outputs, "tight_vins")
    assert {output.name for output in outputs if isinstance(output, Estimate)} == {"tight", "tight_vins"}
    assert set(np.diff([one.stamp_ns for one in joints])) == {JOINT_NS}
    assert set(np.diff([one.stamp_ns for one in frames])) == {FRAME_NS}
    assert error_m(joints[-1]) < 0.01
    assert error_m(frames[-1]) < 0.01
    assert odometry.counts["smoother_keyframes"] > 5
    assert "smoother_window_restart" not in odometry.counts


def test_vision_makes_the_estimate_more_certain_than_legs_alone() -> None:
    alone = states(outputs_of(tight(), without(stream(), StereoTracks, 0.0, 9.0)), "tight")[-1]
    together = states(whole_walk()[1], "tight")[-1]
    sigmas = [np.sqrt(np.trace(one.covariance[3:6, 3:6])) for one in (together, alone)]
    assert sigmas[0] < 0.8 * sigmas[1]


def test_without_any_landmark_the_estimate_is_that_of_leg_odometry() -> None:
    without_landmarks = in_order(without_tracks(one) if isinstance(one, StereoTracks) else one for one in stream())
    legs = LegOdometryFilter(DAISY)
    expected = [one for one in map(legs.push, without_landmarks) if one is not None]
    found = states(outputs_of(tight(), without_landmarks), "tight")
    assert len(found) == len(expected)
    np.testing.assert_allclose(found[-1].nav.T_world_body, expected[-1].nav.T_world_body, atol=1e-3)


def test_without_joints_for_a_second_vision_holds_the_pose() -> None:
    outputs = outputs_of(tight(), without(stream(), JointSample, 2.0, 3.0))
    assert error_m(states(outputs, "tight")[-1]) < 0.03


def test_the_profile_of_the_paper_is_refused() -> None:
    lens = CameraCalibration(width_px=64, height_px=48, focal_px=(40.0, 40.0), principal_point_px=(31.5, 23.5))
    stereo = StereoCalibration(
        left=lens, right=lens, body_left_camera=matrix4(np.eye(4)), body_right_camera=matrix4(np.eye(4))
    )
    with pytest.raises(ConfigError, match="robust"):
        tight_odometry(DAISY, FilterConfig(profile="paper"), stereo, FrontendConfig(), SmootherConfig())
