# SPDX-License-Identifier: BSD-3-Clause
"""The filter with input as it comes from robots: late, repeated, with gaps, without some of the sensors."""

from collections.abc import Iterable
from dataclasses import replace

import numpy as np
import pytest

from coclo_vio.filter.config import FilterConfig, RobustConfig
from coclo_vio.filter.odometry import LegOdometryFilter
from coclo_vio.geometry import so3
from coclo_vio.robot.model import RobotModel
from coclo_vio.simulation.analytic import AnalyticTrial, AnalyticTrialConfig, SensorNoiseConfig, generate
from coclo_vio.simulation.body_motion import BodyMotionConfig
from coclo_vio.values.errors import RobotModelError
from coclo_vio.values.estimates import StateEstimate
from coclo_vio.values.measurements import FootForceSample, ImuSample, JointSample, Measurement
from coclo_vio.values.units import NS_PER_S

NOMINAL = RobustConfig(estimates_leg_scale=False, estimates_leg_compliance=False)
PROFILES = [FilterConfig(robust=NOMINAL), FilterConfig(profile="paper")]
TICK_NS = 10_000_000

CleanRuns = dict[str, tuple[list[StateEstimate], LegOdometryFilter]]


def run(
    robot: RobotModel, measurements: Iterable[Measurement], config: FilterConfig = PROFILES[0]
) -> tuple[list[StateEstimate], LegOdometryFilter]:
    odometry = LegOdometryFilter(robot, config)
    estimates = [estimate for estimate in map(odometry.push, measurements) if estimate is not None]
    return estimates, odometry


def position(estimate: StateEstimate) -> np.ndarray:
    return estimate.nav.T_world_body[:3, 3]


def position_sigma_m(estimate: StateEstimate) -> float:
    return float(np.sqrt(np.trace(estimate.covariance[3:6, 3:6])))


def miss_m(estimate: StateEstimate, trial: AnalyticTrial) -> float:
    """Distance of an estimate from the truth, whose heading and place at the start are those of the world."""
    row = int(np.searchsorted(trial.truth.stamps_ns, estimate.stamp_ns))
    return float(np.linalg.norm(position(estimate) - (trial.truth.positions[row] - trial.truth.positions[0])))


@pytest.fixture(scope="module")
def clean_runs(daisy: RobotModel, noisy_walk: AnalyticTrial) -> CleanRuns:
    """Both profiles over the whole walk."""
    return {config.profile: run(daisy, noisy_walk.measurements, config) for config in PROFILES}


@pytest.fixture(params=PROFILES, ids=["robust", "paper"])
def config(request: pytest.FixtureRequest) -> FilterConfig:
    assert isinstance(request.param, FilterConfig)
    return request.param


def test_a_clean_stream_has_no_unusual_counts(
    daisy: RobotModel, noisy_walk: AnalyticTrial, config: FilterConfig, clean_runs: CleanRuns
) -> None:
    estimates, odometry = clean_runs[config.profile]
    assert set(odometry.counts) <= {"standstill", "leg_rejected"}
    assert miss_m(estimates[-1], noisy_walk) < (0.02 if config.profile == "robust" else 0.06)
    steps = np.diff([estimate.stamp_ns for estimate in estimates])
    assert np.all(steps == TICK_NS)


def test_repeated_and_late_samples_are_refused_and_change_nothing(
    daisy: RobotModel, noisy_walk: AnalyticTrial, config: FilterConfig, clean_runs: CleanRuns
) -> None:
    measurements = noisy_walk.measurements
    disturbed: list[Measurement] = []
    for number, measurement in enumerate(measurements):
        disturbed.append(measurement)
        if number % 30 in {0, 1, 2} and number > 60:
            disturbed.append(measurement)  # twice
            disturbed.append(measurements[number - 30])  # again, 0.1 s late
    clean, _ = clean_runs[config.profile]
    estimates, odometry = run(daisy, disturbed, config)
    assert len(estimates) == len(clean)
    np.testing.assert_array_equal(estimates[-1].nav.T_world_body, clean[-1].nav.T_world_body)
    np.testing.assert_array_equal(estimates[-1].covariance, clean[-1].covariance)
    for kind, name in ((JointSample, "joint"), (ImuSample, "imu"), (FootForceSample, "foot_force")):
        extra = sum(isinstance(sample, kind) for sample in disturbed) - sum(
            isinstance(sample, kind) for sample in measurements
        )
        assert extra > 80
        assert odometry.counts[f"{name}_stamp_refused"] == extra


def test_irregular_rates_are_integrated_over_their_true_steps(daisy: RobotModel, noisy_walk: AnalyticTrial) -> None:
    """A third of the joint samples is lost at random, and IMU samples independently of them."""
    random = np.random.default_rng(2)
    kept = [sample for sample in noisy_walk.measurements if random.uniform() > 0.33]
    estimates, odometry = run(daisy, kept)
    assert len(set(np.diff([estimate.stamp_ns for estimate in estimates]).tolist())) > 2
    assert odometry.counts["imu_missing"] > 10
    assert miss_m(estimates[-1], noisy_walk) < 0.03


def test_a_gap_ends_the_footholds_and_the_covariance_grows(
    daisy: RobotModel, noisy_walk: AnalyticTrial, config: FilterConfig, clean_runs: CleanRuns
) -> None:
    gap = (2_000_000_000, 2_500_000_000)
    kept = [sample for sample in noisy_walk.measurements if not gap[0] <= sample.stamp_ns < gap[1]]
    estimates, odometry = run(daisy, kept, config)
    assert odometry.counts["gap"] == 1
    before = next(estimate for estimate in reversed(estimates) if estimate.stamp_ns < gap[0])
    after = next(estimate for estimate in estimates if estimate.stamp_ns >= gap[1])
    whole, _ = clean_runs[config.profile]
    unbroken = next(estimate for estimate in whole if estimate.stamp_ns >= gap[1])
    assert position_sigma_m(after) > position_sigma_m(before)
    if config.profile == "robust":  # the paper does not treat gaps: its feet hold through them
        assert position_sigma_m(after) > 1.5 * position_sigma_m(unbroken)
    assert miss_m(after, noisy_walk) < 4.0 * position_sigma_m(after)
    assert np.isfinite(estimates[-1].nav.T_world_body).all()


@pytest.mark.long
@pytest.mark.parametrize("what", ["position", "velocity"])
def test_an_unknown_joint_removes_its_own_leg_only(
    daisy: RobotModel, noisy_walk: AnalyticTrial, config: FilterConfig, what: str
) -> None:
    unknown = (2_000_000_000, 3_000_000_000)
    disturbed: list[Measurement] = []
    for sample in noisy_walk.measurements:
        if isinstance(sample, JointSample) and unknown[0] <= sample.stamp_ns < unknown[1]:
            values = np.array(getattr(sample, what))
            values[4] = np.nan  # of the second leg
            disturbed.append(replace(sample, **{what: values}))
        else:
            disturbed.append(sample)
    estimates, odometry = run(daisy, disturbed, config)
    assert odometry.counts["leg_unknown"] == 100
    during = [sample for sample in estimates if unknown[0] <= sample.stamp_ns < unknown[1]]
    assert len(during) == 100
    assert not any(estimate.feet is not None and estimate.feet.is_stance[1] for estimate in during)
    assert miss_m(estimates[-1], noisy_walk) < (0.03 if config.profile == "robust" else 0.1)


def test_without_an_imu_the_filter_runs_on_the_legs_alone(
    daisy: RobotModel, noisy_walk: AnalyticTrial, clean_runs: CleanRuns
) -> None:
    """No gravity, no rate: it starts on the move after the timeout, level, and finds its way by the joints."""
    joints = [sample for sample in noisy_walk.measurements if not isinstance(sample, ImuSample)]
    estimates, odometry = run(daisy, joints)
    assert odometry.counts["started_moving"] == 1
    assert odometry.counts["imu_missing"] == len(noisy_walk.truth)
    with_imu, _ = clean_runs["robust"]
    assert estimates[-1].covariance[2, 2] > with_imu[-1].covariance[2, 2]
    assert miss_m(estimates[-1], noisy_walk) < 0.1


def test_without_any_force_no_foot_stands_and_the_uncertainty_grows(
    daisy: RobotModel, noisy_walk: AnalyticTrial, clean_runs: CleanRuns
) -> None:
    """Torques of NaN: no foot is known to stand once the robot moves; all of them are used with a large noise."""
    disturbed = [
        replace(sample, effort=np.full_like(sample.effort, np.nan)) if isinstance(sample, JointSample) else sample
        for sample in noisy_walk.measurements
    ]
    estimates, _ = run(daisy, disturbed)
    with_force, _ = clean_runs["robust"]
    walking = [sample for sample in estimates if 2_000_000_000 < sample.stamp_ns < 3_500_000_000]
    assert not any(estimate.feet is not None and estimate.feet.is_stance.any() for estimate in walking)
    assert position_sigma_m(estimates[-1]) > 3.0 * position_sigma_m(with_force[-1])
    assert miss_m(estimates[-1], noisy_walk) < noisy_walk.truth.path_length_m()


def test_a_start_on_the_move_is_counted_and_starts_uncertain(
    daisy: RobotModel, noisy_walk: AnalyticTrial, config: FilterConfig, clean_runs: CleanRuns
) -> None:
    begin_ns = 2_000_000_000
    moving = [sample for sample in noisy_walk.measurements if sample.stamp_ns >= begin_ns]
    estimates, odometry = run(daisy, moving, config)
    assert odometry.counts["started_moving"] == 1
    waited_s = (estimates[0].stamp_ns - begin_ns) / NS_PER_S
    assert waited_s == pytest.approx(FilterConfig().rest_timeout_s, abs=0.02)
    rested, _ = clean_runs[config.profile]
    assert estimates[0].covariance[0, 0] > rested[0].covariance[0, 0]
    assert estimates[0].covariance[6, 6] > rested[0].covariance[6, 6]
    speed = np.linalg.norm(estimates[-60].nav.velocity_world)
    row = int(np.searchsorted(noisy_walk.truth.stamps_ns, estimates[-60].stamp_ns))
    assert noisy_walk.truth.velocity_world is not None
    assert speed == pytest.approx(np.linalg.norm(noisy_walk.truth.velocity_world[row]), abs=0.08)


@pytest.mark.long
def test_a_minute_of_standing_does_not_drift(daisy: RobotModel) -> None:
    body = BodyMotionConfig(rest_s=61.0, walk_s=0.0, stop_s=0.0)
    trial = generate(AnalyticTrialConfig(rate_hz=25.0, substeps=1, body=body), daisy, seed=4)
    estimates, odometry = run(daisy, trial.measurements)
    moved = np.linalg.norm([position(estimate) for estimate in estimates], axis=1)
    assert moved.max() < 3e-3  # noise of the joints, as far as feet may creep: 0.003 m/sqrt(s) each
    assert moved[-1] < 0.5 * position_sigma_m(estimates[-1])
    assert odometry.counts["standstill"] > 1450
    yaw = so3.yaw(np.array([estimate.nav.T_world_body[:3, :3] for estimate in estimates]))
    assert abs(yaw[-1]) < 2e-3


def test_samples_of_another_robot_are_an_error(daisy: RobotModel) -> None:
    odometry = LegOdometryFilter(daisy)
    with pytest.raises(RobotModelError, match=r"17 joints.*18"):
        odometry.push(JointSample(0, np.zeros(17), np.zeros(17), np.zeros(17)))
    with pytest.raises(RobotModelError, match=r"4 entries, robot .* 6 legs"):
        odometry.push(FootForceSample(0, np.zeros(4)))


def test_a_turn_during_a_gap_of_the_joints_is_not_lost(daisy: RobotModel) -> None:
    """The gyroscope goes on in a gap of the joints: what it turned is turned, to what its noise allows."""
    body = BodyMotionConfig(rest_s=1.5, walk_s=3.0, stop_s=0.0, curvature_per_m=1.5)
    trial = generate(AnalyticTrialConfig(body=body, sensors=SensorNoiseConfig(noise_scale=0.0)), daisy, seed=3)
    gap = range(1_500_000_000, 2_600_000_000)
    odometry = LegOdometryFilter(daisy)
    turned: list[float] = []
    for sample in trial.measurements:
        if isinstance(sample, JointSample) and sample.stamp_ns in gap:
            continue
        estimate = odometry.push(sample)
        if estimate is not None and sample.stamp_ns >= 1_490_000_000:
            turned.append(float(so3.yaw(estimate.nav.T_world_body[:3, :3])))
            if sample.stamp_ns >= gap.stop:
                break
    yaw = so3.yaw(trial.truth.rotations)
    true_turn = yaw[260] - yaw[149]
    assert odometry.counts["gap"] == 1
    assert abs(true_turn) > np.radians(3.0)
    assert turned[-1] - turned[0] == pytest.approx(true_turn, abs=np.radians(0.2))


def test_silent_joints_leave_the_imu_which_gives_estimates_of_honest_covariance(
    daisy: RobotModel, noisy_walk: AnalyticTrial, clean_runs: CleanRuns
) -> None:
    """For a second there are no joints: rotation by the gyroscope, velocity by the accelerometer, feet carried."""
    silent = range(2_000_000_000, 3_000_000_000)
    kept = [
        sample for sample in noisy_walk.measurements if isinstance(sample, ImuSample) or sample.stamp_ns not in silent
    ]
    estimates, odometry = run(daisy, kept)
    during = [estimate for estimate in estimates if estimate.stamp_ns in range(2_110_000_000, silent.stop)]
    imu = [sample for sample in noisy_walk.measurements if isinstance(sample, ImuSample)]
    assert [estimate.stamp_ns for estimate in during] == [
        sample.stamp_ns for sample in imu if during[0].stamp_ns <= sample.stamp_ns < silent.stop
    ]
    assert odometry.counts["gap"] == 1
    assert odometry.counts["joints_late"] <= 1
    for estimate in during:
        assert estimate.feet is not None
        assert not estimate.feet.is_stance.any()
        assert not estimate.feet.contact_probability.any()
        assert miss_m(estimate, noisy_walk) < 3.0 * position_sigma_m(estimate)
    sigmas = np.array([position_sigma_m(estimate) for estimate in during])
    assert np.all(np.diff(sigmas) > 0.0)
    assert miss_m(during[-1], noisy_walk) < 0.03
    after = [estimate for estimate in estimates if estimate.stamp_ns >= silent.stop]
    whole, _ = clean_runs["robust"]
    assert len(after) >= len([estimate for estimate in whole if estimate.stamp_ns >= silent.stop]) - 1
    assert after[-1].feet is not None
    assert after[-1].feet.is_stance.any()


def test_a_time_without_joints_is_no_time_without_support(daisy: RobotModel, noisy_walk: AnalyticTrial) -> None:
    """No joints for 2 s, and no foot in stance for 0.2 s after it, as in the flight phase of a trot."""
    silent, flight = range(2_000_000_000, 4_000_000_000), range(4_000_000_000, 4_200_000_000)
    odometry, events = LegOdometryFilter(daisy), []
    for sample in noisy_walk.measurements:
        changed = sample
        if isinstance(sample, JointSample | FootForceSample) and sample.stamp_ns in silent:
            continue
        if isinstance(sample, JointSample) and sample.stamp_ns in flight:
            changed = replace(sample, effort=np.zeros_like(sample.position))
        elif isinstance(sample, FootForceSample) and sample.stamp_ns in flight:
            changed = replace(sample, force=np.zeros_like(sample.force))
        if odometry.push(changed) is not None:
            events += odometry.take_events()
    assert "no_support" not in [event.kind for event in events]


def test_a_robot_without_any_foot_in_stance_is_reported_and_its_covariance_grows(
    daisy: RobotModel, noisy_walk: AnalyticTrial
) -> None:
    """Lifted for 2 s: no torque, joints move on; one event after a second, and one when feet stand again."""
    lifted = range(2_000_000_000, 4_000_000_000)
    odometry, estimates, events = LegOdometryFilter(daisy), [], []
    for sample in noisy_walk.measurements:
        changed = sample
        if isinstance(sample, JointSample) and sample.stamp_ns in lifted:
            changed = replace(sample, effort=np.zeros_like(sample.position))
        elif isinstance(sample, FootForceSample) and sample.stamp_ns in lifted:
            changed = replace(sample, force=np.zeros_like(sample.force))
        estimate = odometry.push(changed)
        if estimate is not None:
            estimates.append(estimate)
            events += odometry.take_events()
    kinds = [(event.kind, event.stamp_ns) for event in events if "support" in event.kind]
    assert [kind for kind, _ in kinds] == ["no_support", "support_again"]
    assert kinds[0][1] == pytest.approx(3_000_000_000, abs=2e8)
    assert kinds[1][1] == pytest.approx(4_000_000_000, abs=2e8)
    by_stamp = {estimate.stamp_ns: estimate for estimate in estimates}
    late, later = by_stamp[3_000_000_000], by_stamp[3_900_000_000]
    assert position_sigma_m(later) > 1.5 * position_sigma_m(late)
    assert miss_m(later, noisy_walk) < 3.0 * position_sigma_m(later)


def test_joint_samples_that_come_after_the_imu_has_gone_on_are_left_out(
    daisy: RobotModel, noisy_walk: AnalyticTrial
) -> None:
    """Joints 0.3 s behind the IMU for a time: those before its estimates are counted, the next ones are used."""
    early, late = [], []
    for sample in noisy_walk.measurements:
        is_held = not isinstance(sample, ImuSample) and 2_000_000_000 <= sample.stamp_ns < 2_300_000_000
        (late if is_held else early).append(sample)
    at = next(number for number, sample in enumerate(early) if sample.stamp_ns >= 2_300_000_000)
    estimates, odometry = run(daisy, [*early[:at], *late, *early[at:]])
    joints = sum(isinstance(sample, JointSample) for sample in late)
    assert joints - 1 <= odometry.counts["joints_late"] <= joints + 1
    stamps = [estimate.stamp_ns for estimate in estimates]
    assert np.all(np.diff(stamps) > 0)
    assert miss_m(estimates[-1], noisy_walk) < 0.03


def test_without_new_imu_samples_gravity_is_not_used(
    daisy: RobotModel, noisy_walk: AnalyticTrial, clean_runs: CleanRuns
) -> None:
    """Its last reading is no reading: tilt grows uncertain by the legs alone instead of being measured for ever."""
    last_ns = 2_000_000_000
    kept = [
        sample for sample in noisy_walk.measurements if not isinstance(sample, ImuSample) or sample.stamp_ns <= last_ns
    ]
    estimates, odometry = run(daisy, kept)
    assert odometry.counts["imu_missing"] == 250

    def gained(path: list[StateEstimate]) -> float:
        before = next(sample for sample in path if sample.stamp_ns >= last_ns)
        return float(path[-1].covariance[0, 0] - before.covariance[0, 0])

    unbroken, _ = clean_runs["robust"]
    assert gained(estimates) > 0.0 > gained(unbroken)


def test_torques_that_are_missing_are_counted(daisy: RobotModel, noisy_walk: AnalyticTrial) -> None:
    odometry = LegOdometryFilter(daisy)
    for sample in noisy_walk.measurements:
        is_joints = isinstance(sample, JointSample)
        odometry.push(replace(sample, effort=np.full(18, np.nan)) if is_joints else sample)
    assert odometry.counts["contact_load_missing"] == 6 * len(noisy_walk.truth)
    assert odometry.counts["no_contact"] > 0
