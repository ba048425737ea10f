# SPDX-License-Identifier: BSD-3-Clause
"""A frame that came late is where the body was, not where constant velocity leads back to, and says how well."""

import numpy as np
import pytest
from test_keyframe_exchange import pushed, started

from coclo_vio.filter.config import FilterConfig, RobustConfig
from coclo_vio.filter.frame_motion import FrameMotion
from coclo_vio.filter.odometry import LegOdometryFilter
from coclo_vio.geometry import se3
from coclo_vio.robot.model import RobotModel
from coclo_vio.simulation.analytic import AnalyticTrial
from coclo_vio.values.estimates import StateEstimate
from coclo_vio.values.units import NS_PER_S


def walked(daisy: RobotModel, trial: AnalyticTrial) -> tuple[LegOdometryFilter, list[StateEstimate]]:
    """A filter that has walked, and its estimates."""
    odometry, last = started(daisy, trial.measurements[:600])
    return odometry, [last, *pushed(odometry, trial.measurements[600:1500])]


def test_a_late_frame_is_where_the_body_was(daisy: RobotModel, noisy_walk: AnalyticTrial) -> None:
    odometry, states = walked(daisy, noisy_walk)
    now = states[-1]
    for late in (1, 5, 15, 30):
        then = states[-1 - late]
        mark = odometry.mark_frame(then.stamp_ns)
        by_filter = np.linalg.norm(se3.log(se3.inverse(then.nav.T_world_body) @ mark.T_world_body))
        dt_s = (then.stamp_ns - now.stamp_ns) / NS_PER_S
        straight = now.nav.T_world_body[:3, 3] + dt_s * now.nav.velocity_world
        by_velocity = np.linalg.norm(straight - then.nav.T_world_body[:3, 3])
        assert by_filter < 0.004
        assert late < 15 or by_filter < 0.5 * by_velocity


def test_the_uncertainty_of_a_late_frame_grows_with_its_delay_and_covers_the_error(
    daisy: RobotModel, noisy_walk: AnalyticTrial
) -> None:
    odometry, states = walked(daisy, noisy_walk)
    keyframe = odometry.mark_frame(states[-60].stamp_ns).anchor()
    nees, traces = [], []
    for late in (1, 10, 20, 30):
        then = states[-1 - late]
        poses = keyframe.mark_frame(then.stamp_ns).poses()
        truth = se3.inverse(states[-60].nav.T_world_body) @ then.nav.T_world_body
        error = se3.log(se3.inverse(truth) @ poses.T_world_end)[3:]
        covariance = poses.covariance[9:, 9:]
        nees.append(error @ np.linalg.solve(covariance, error) / 3.0)
        now_to_frame = odometry._motion_to(then.stamp_ns).noise[1]
        traces.append(now_to_frame)
    assert traces == sorted(traces)
    assert max(nees) < 4.0


def test_a_frame_has_a_noise_in_proportion_to_the_speed(daisy: RobotModel, noisy_walk: AnalyticTrial) -> None:
    traces, speeds = [], []
    for deflection_s in (0.0, 0.05):
        robust = RobustConfig(step_deflection_s=deflection_s)
        odometry = LegOdometryFilter(daisy, FilterConfig(robust=robust), remembers_frames=True)
        now = pushed(odometry, noisy_walk.measurements[:1000])[-1]
        keyframe = odometry.mark_frame(now.stamp_ns).anchor()
        traces.append(np.trace(keyframe.mark_frame(now.stamp_ns).poses().covariance[9:, 9:]))
        speeds.append(float(np.linalg.norm(now.nav.velocity_world)))
    assert speeds[0] == speeds[1] > 0.03
    assert traces[1] - traces[0] == pytest.approx(2 * 3 * (0.05 * speeds[0]) ** 2, rel=0.01)


def test_between_two_samples_the_motion_back_is_divided(daisy: RobotModel, noisy_walk: AnalyticTrial) -> None:
    odometry, states = walked(daisy, noisy_walk)
    first, second = states[-6], states[-5]
    middle = odometry.mark_frame((first.stamp_ns + second.stamp_ns) // 2).T_world_body
    expected = 0.5 * (first.nav.T_world_body[:3, 3] + second.nav.T_world_body[:3, 3])
    np.testing.assert_allclose(middle[:3, 3], expected, atol=1e-3)


def test_a_frame_longer_ago_than_remembered_is_not_reached(daisy: RobotModel, noisy_walk: AnalyticTrial) -> None:
    odometry, states = walked(daisy, noisy_walk)
    now_ns, delay_ns = states[-1].stamp_ns, round(odometry.config.max_frame_delay_s * NS_PER_S)
    assert odometry.reaches(now_ns + 10**9)
    assert odometry.reaches(now_ns - delay_ns // 2)
    assert not odometry.reaches(now_ns - delay_ns - 20_000_000)


@pytest.mark.parametrize("dt_s", [0.0, 0.004])
@pytest.mark.parametrize("is_late", [False, True])
def test_now_is_the_inverse_of_pose(dt_s: float, is_late: bool, daisy: RobotModel, noisy_walk: AnalyticTrial) -> None:
    odometry, _ = started(daisy, noisy_walk.measurements[:900])
    mean = odometry._started().mean
    back = se3.exp(np.array([0.1, -0.2, 0.05, -0.03, 0.01, 0.02])) if is_late else None
    motion = FrameMotion(0.0 if is_late else dt_s, T_now_frame=back)
    rotation, position = motion.now(mean, motion.pose(mean))
    np.testing.assert_allclose(rotation, mean.rotation, atol=1e-12)
    np.testing.assert_allclose(position, mean.vector[odometry._started().mean.layout.at("position")], atol=1e-12)
