# SPDX-License-Identifier: BSD-3-Clause
"""Preintegrated legs: the filter, stopped and started anew at keyframes, loses nothing, and its prior is removed."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from coclo_vio.filter.between_states import between
from coclo_vio.filter.camera_frame import CameraFrame
from coclo_vio.filter.config import FilterConfig, InitialConfig, RobustConfig
from coclo_vio.filter.leg_preintegration import START
from coclo_vio.filter.odometry import LegOdometryFilter
from coclo_vio.filter.revision import Prior
from coclo_vio.geometry import se3, so3
from coclo_vio.robot.model import RobotModel
from coclo_vio.simulation.analytic import AnalyticTrial
from coclo_vio.values.arrays import Array
from coclo_vio.values.errors import FilterError
from coclo_vio.values.estimates import StateEstimate
from coclo_vio.values.leg_motion import LegMotion, LegState
from coclo_vio.values.measurements import Measurement

EVERY = 25  # estimates from keyframe to keyframe
FRAME_NS = 3_000_000  # from a joint sample to a frame


CONFIG = FilterConfig(
    initial=InitialConfig(accelerometer_bias_mps2=0.05, gyroscope_bias_radps=0.02),
    robust=RobustConfig(step_deflection_s=0.0),  # a noise at each frame, which one filter without frames has not
)


def fresh(robot: RobotModel, config: FilterConfig = CONFIG) -> LegOdometryFilter:
    return LegOdometryFilter(robot, config, preintegrates=True)


def walked(
    robot: RobotModel, measurements: Sequence[Measurement], spread: float = 1.0
) -> tuple[list[LegMotion], list[StateEstimate]]:
    """The motions between keyframes and all estimates; each keyframe's covariance is that of the filter, spread."""
    odometry, legs = fresh(robot), None
    motions: list[LegMotion] = []
    estimates: list[StateEstimate] = []
    for measurement in measurements:
        estimate = odometry.push(measurement)
        if estimate is None:
            continue
        estimates.append(estimate)
        if legs is None:
            legs = odometry.preintegration(estimate.stamp_ns + FRAME_NS)
            legs.restart(legs.state(estimate.stamp_ns + FRAME_NS))
        elif len(estimates) % EVERY == 0:
            motion = legs.motion(estimate.stamp_ns + FRAME_NS)
            motions.append(motion)
            legs.restart(replace(motion.end, covariance=spread * motion.end.covariance))
    return motions, estimates


def gauge(state: LegState, anchor: Array) -> Array:
    """Errors of a state by a shift of the world or a rotation about the vertical, (size, 4)."""
    frame = CameraFrame(anchor, state.legs[-6:])
    T_world_body = frame.true(state.T_world_body)
    directions = np.zeros((len(state.covariance), 4))
    directions[:6] = frame.measured(T_world_body)[1] @ se3.adjoint(se3.inverse(T_world_body))[:, 2:]
    return directions


@pytest.fixture(scope="module")
def motions(daisy: RobotModel, noisy_walk: AnalyticTrial) -> list[LegMotion]:
    return walked(daisy, noisy_walk.measurements)[0]


def test_a_filter_that_starts_anew_at_keyframes_from_its_own_state_estimates_as_one_that_does_not(
    daisy: RobotModel, noisy_walk: AnalyticTrial
) -> None:
    whole = [one for one in map(LegOdometryFilter(daisy, CONFIG).push, noisy_walk.measurements) if one is not None]
    parted = walked(daisy, noisy_walk.measurements)[1]
    assert len(parted) == len(whole) > 10 * EVERY
    np.testing.assert_allclose(parted[-1].nav.T_world_body, whole[-1].nav.T_world_body, atol=2e-5)
    np.testing.assert_allclose(np.diag(parted[-1].covariance), np.diag(whole[-1].covariance), rtol=0.01)


def test_prior_and_factor_together_are_the_filters_own_marginal(motions: list[LegMotion]) -> None:
    for motion in motions:
        size = len(motion.start.covariance)
        information = motion.rows.T @ motion.rows
        information[:size, :size] += np.linalg.inv(motion.start.covariance)
        covariance = np.linalg.inv(information)
        mean = covariance @ motion.rows.T @ motion.measured
        sigmas = np.sqrt(np.diag(motion.end.covariance))
        np.testing.assert_allclose(np.sqrt(np.diag(covariance))[size:], sigmas, rtol=2e-3)
        np.testing.assert_allclose(mean[size:] / sigmas, 0.0, atol=2e-3)


def test_a_frame_has_the_deflection_within_a_step_in_its_covariance_and_in_the_factor(
    daisy: RobotModel, noisy_walk: AnalyticTrial
) -> None:
    deflection_s, ends = 0.05, []
    for value_s in (0.0, deflection_s):
        odometry = fresh(daisy, CONFIG.model_copy(update={"robust": RobustConfig(step_deflection_s=value_s)}))
        estimates = [one for one in map(odometry.push, noisy_walk.measurements[:600]) if one is not None]
        speed_mps = float(np.linalg.norm(estimates[-1].nav.velocity_world))
        stamp_ns = estimates[-1].stamp_ns + FRAME_NS
        legs = odometry.preintegration(stamp_ns)
        legs.restart(legs.state(stamp_ns))
        motion = legs.motion(stamp_ns)
        ends.append((legs.state(stamp_ns).covariance, motion.covariance))
    expected = (deflection_s * speed_mps) ** 2
    assert speed_mps > 0.1
    (exact, exact_motion), (deflected, deflected_motion) = ends
    np.testing.assert_allclose(np.diag(deflected_motion - exact_motion)[3:], expected, rtol=0.02)
    np.testing.assert_allclose(np.diag(deflected_motion - exact_motion)[:3], 0.0, atol=1e-3 * expected)
    assert np.all(np.diag(deflected - exact)[3:6] > 0.99 * expected)


def test_nothing_of_the_prior_is_left_in_the_factor(
    daisy: RobotModel, noisy_walk: AnalyticTrial, motions: list[LegMotion]
) -> None:
    """A prior that is too large by a fifth gives the same information, where the models are nearly linear."""
    others, _ = walked(daisy, noisy_walk.measurements, spread=1.2)
    for motion, other in zip(motions[1:3], others[1:3], strict=True):
        sigmas = np.sqrt(np.diag(motion.start.covariance))
        scales = np.concatenate((sigmas, np.sqrt(np.diag(motion.end.covariance))))
        one, two = (np.linalg.norm(each.rows * scales) ** 2 for each in (motion, other))
        assert two == pytest.approx(one, rel=0.02)


def test_a_shift_of_the_world_or_a_rotation_about_the_vertical_changes_nothing_that_is_measured(
    motions: list[LegMotion],
) -> None:
    anchor = np.asarray(motions[0].start.T_world_body)
    for motion in motions:
        directions = np.concatenate([gauge(each, anchor) for each in (motion.start, motion.end)])
        scale = np.abs(motion.rows).max()
        np.testing.assert_allclose(motion.rows @ directions / scale, 0.0, atol=1e-9)


def test_a_linear_filter_leaves_exactly_what_was_measured() -> None:
    """Two steps with a measurement after each, of a random linear model, and any prior."""
    random, size = np.random.default_rng(5), 4
    step, seen = np.eye(size) + 0.1 * random.normal(size=(2, size, size)), random.normal(size=(2, 2, size))
    values, noise = random.normal(size=(2, 2)), 0.3 * np.eye(size)
    results = []
    for scale in (0.5, 3.0):
        prior = scale * (np.eye(size) + 0.3)
        covariance, mean = np.tile(prior, (2, 2)), np.zeros(2 * size)  # of [earlier, present]
        for F, H, z in zip(step, seen, values, strict=True):
            move = np.block([[np.eye(size), np.zeros((size, size))], [np.zeros((size, size)), F]])
            mean, covariance = move @ mean, move @ covariance @ move.T
            covariance[size:, size:] += noise
            row = np.concatenate((np.zeros_like(H), H), axis=1)
            gain = covariance @ row.T @ np.linalg.inv(row @ covariance @ row.T + np.eye(2))
            mean, covariance = mean + gain @ (z - row @ mean), covariance - gain @ row @ covariance
        blocks = covariance[:size, :size], covariance[size:, :size], covariance[size:, size:]
        factor = between(np.linalg.cholesky(prior), *blocks, mean[:size], noise=np.zeros((size, size)))
        later = factor.rows[:, size:]
        results.append((factor.rows.T @ factor.rows, factor.rows.T @ (factor.values + later @ mean[size:])))
    np.testing.assert_allclose(results[0][0], results[1][0], atol=1e-9)
    np.testing.assert_allclose(results[0][1], results[1][1], atol=1e-9)
    assert np.linalg.norm(results[0][0]) > 1.0


def test_a_filter_that_has_not_started_or_remembers_no_keyframe_says_so(
    daisy: RobotModel, noisy_walk: AnalyticTrial
) -> None:
    with pytest.raises(FilterError, match="has not started"):
        fresh(daisy).preintegration(0)
    odometry = LegOdometryFilter(daisy)
    for measurement in noisy_walk.measurements:
        if odometry.push(measurement) is not None:
            break
    with pytest.raises(FilterError, match=f"no block '{START}'"):
        odometry.preintegration(0)


def shifted(state: LegState) -> LegState:
    """The same state with errors of the cameras, a rotation and a scale, and with a tilt of the anchor."""
    legs = np.array(state.legs)
    legs[-6:] = 0.02, -0.01, 0.03, 0.05, 0.02, -0.03
    return replace(state, legs=legs)


def test_the_filter_takes_over_a_state_as_it_is_cameras_included(daisy: RobotModel, noisy_walk: AnalyticTrial) -> None:
    odometry = fresh(daisy)
    estimates = [one for one in map(odometry.push, noisy_walk.measurements) if one is not None]
    stamp_ns = estimates[-1].stamp_ns + FRAME_NS
    legs = odometry.preintegration(stamp_ns - 2_000_000_000)
    state = shifted(legs.state(stamp_ns))
    legs.restart(state)
    again = legs.state(stamp_ns)
    np.testing.assert_allclose(again.T_world_body, state.T_world_body, atol=1e-12)
    np.testing.assert_allclose(again.legs, state.legs, atol=1e-12)
    floor = 1e-6**2  # is added to each variance
    np.testing.assert_allclose(np.diag(again.covariance), np.diag(state.covariance), rtol=1e-2, atol=2.0 * floor)


def test_errors_of_the_cameras_change_how_a_motion_is_measured_and_not_the_motion(
    daisy: RobotModel, noisy_walk: AnalyticTrial
) -> None:
    """Lengths are measured too long by the scale; the factor of both keyframes fits the poses as measured."""
    motions = []
    for change in (lambda state: state, shifted):
        odometry, legs = fresh(daisy), None
        for count, estimate in enumerate(filter(None, map(odometry.push, noisy_walk.measurements))):
            if count == 100:
                legs = odometry.preintegration(estimate.stamp_ns)
                exact = legs.state(estimate.stamp_ns)
                legs.restart(change(exact))
            elif count == 200:
                assert legs is not None
                motions.append(legs.motion(estimate.stamp_ns))
                break
    lengths = [np.linalg.norm((se3.inverse(one.start.T_world_body) @ one.end.T_world_body)[:3, 3]) for one in motions]
    assert lengths[1] / lengths[0] == pytest.approx(1.05, abs=5e-4)


def test_rows_are_the_derivatives_of_the_change_of_coordinates(daisy: RobotModel, noisy_walk: AnalyticTrial) -> None:
    """A filter that starts from a moved state ends in another one, which the rows of the first predict."""
    random = np.random.default_rng(2)
    ends, moved = [], np.zeros(0)
    for is_moved in (False, True):
        odometry = fresh(daisy)
        legs = None
        for count, estimate in enumerate(filter(None, map(odometry.push, noisy_walk.measurements))):
            if count == 150:
                legs = odometry.preintegration(estimate.stamp_ns - 1_000_000_000)
                state = shifted(legs.state(estimate.stamp_ns + FRAME_NS))
                if is_moved:
                    moved = 0.1 * np.sqrt(np.diag(state.covariance)) * random.normal(size=len(state.covariance))
                    T = state.T_world_body @ se3.exp(moved[:6])
                    state = replace(state, T_world_body=T, legs=state.legs + moved[6:])
                legs.restart(state)
            elif count == 175:
                assert legs is not None
                ends.append(legs.motion(estimate.stamp_ns + FRAME_NS))
                break
    first, second = ends
    size = len(first.start.covariance)
    information = first.rows.T @ first.rows
    vector = first.rows.T @ first.measured
    information[:size, :size] += np.linalg.inv(first.start.covariance)
    vector[:size] += np.linalg.inv(first.start.covariance) @ moved  # the prior's mean is the moved state
    expected = np.linalg.solve(information, vector)[size:]
    found = np.concatenate(
        (se3.log(se3.inverse(first.end.T_world_body) @ second.end.T_world_body), second.end.legs - first.end.legs)
    )
    sigmas = np.sqrt(np.diag(first.end.covariance))
    assert np.abs(expected / sigmas).max() > 0.1
    np.testing.assert_allclose(found / sigmas, expected / sigmas, atol=0.01)


def test_a_mounting_that_becomes_the_calibration_is_reported_as_before(
    daisy: RobotModel, noisy_walk: AnalyticTrial
) -> None:
    odometry = fresh(daisy)
    estimates = [each for each in map(odometry.push, noisy_walk.measurements[:600]) if each is not None]
    stamp_ns = estimates[-1].stamp_ns
    legs = odometry.preintegration(estimates[0].stamp_ns)
    before = legs.state(stamp_ns)
    found = Prior(np.array([0.03, -0.02, 0.04]), np.eye(3) * 1e-3)
    legs.restart(legs.with_mounting_prior(before, found))
    reported = legs.calibration(stamp_ns)
    np.testing.assert_allclose(reported.rotation_body, found.mean, atol=2e-3)  # nothing else has measured it
    np.testing.assert_allclose(reported.rotation_sigma, np.sqrt(1e-3), rtol=0.05)
    assert legs.is_calibration_off is False
    legs.calibrate()
    np.testing.assert_allclose(legs.calibration(stamp_ns).rotation_body, reported.rotation_body, atol=1e-9)
    np.testing.assert_allclose(legs.calibrated, so3.exp(reported.rotation_body), atol=1e-9)
    np.testing.assert_array_equal(legs.camera_errors.mean[:3], np.zeros(3))
