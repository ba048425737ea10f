# SPDX-License-Identifier: BSD-3-Clause
"""Legs and eyes joined: on an analytic walk among points that are seen exactly where they are, give or take a pixel."""

from collections.abc import Iterable

import numpy as np
import pytest

from coclo_vio.backend.window.config import SmootherConfig
from coclo_vio.backend.window.smoother import SlidingWindowSmoother
from coclo_vio.filter.config import FilterConfig, RobustConfig
from coclo_vio.filter.odometry import LegOdometryFilter
from coclo_vio.fusion.bridge import BridgeConfig
from coclo_vio.fusion.combined import BY_EYES, BY_LEGS, CombinedOdometry
from coclo_vio.geometry import se3, so3
from coclo_vio.robot.description import load_robot
from coclo_vio.robot.model import RobotModel
from coclo_vio.simulation.analytic import AnalyticTrial, AnalyticTrialConfig, generate
from coclo_vio.simulation.body_motion import BodyMotionConfig
from coclo_vio.values.calibration import RectifiedStereo
from coclo_vio.values.estimates import Several, StateEstimate
from coclo_vio.values.measurements import ImuSample, JointSample, Measurement, StereoTracks

DAISY = RobotModel(load_robot("daisy"))
WALK = BodyMotionConfig(rest_s=1.0, walk_s=3.5, stop_s=0.0, ramp_s=0.6, speed_mps=0.18, curvature_per_m=0.3)
FORWARD = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
RIG = RectifiedStereo((380.0, 380.0), (320.0, 240.0), 0.1, se3.transform(FORWARD, np.array([0.2, 0.05, 0.1])))
FRAME_NS = 66_666_667
POINTS = np.random.default_rng(1).uniform((-3.0, -4.0, -1.0), (6.0, 4.0, 3.0), (1500, 3))
SEEN_PX = 0.3


@pytest.fixture(scope="module")
def trial() -> AnalyticTrial:
    return generate(AnalyticTrialConfig(body=WALK), DAISY, seed=5)


def true_pose(trial: AnalyticTrial, stamp_ns: int) -> np.ndarray:
    """Between samples on the geodesic."""
    stamps = trial.truth.stamps_ns
    row = int(np.clip(np.searchsorted(stamps, stamp_ns), 1, len(stamps) - 1))
    T_before, T_after = trial.truth.T_world_body[row - 1 : row + 1]
    share = (stamp_ns - stamps[row - 1]) / (stamps[row] - stamps[row - 1])
    return np.asarray(T_before @ se3.exp(share * se3.log(se3.inverse(T_before) @ T_after)))


def sight(trial: AnalyticTrial, stamp_ns: int) -> StereoTracks:
    """What the rig sees of the points between 0.8 and 5 m."""
    in_camera = se3.apply(se3.inverse(true_pose(trial, stamp_ns) @ RIG.T_body_camera), POINTS)
    ahead = np.flatnonzero((in_camera[:, 2] > 0.8) & (in_camera[:, 2] < 5.0))
    left, disparity = RIG.pixels(in_camera[ahead])
    inside = ((left > 0.0) & (left < [640.0, 480.0])).all(axis=1)
    left, disparity, ids = left[inside][:60], disparity[inside][:60], ahead[inside][:60]
    random = np.random.default_rng(stamp_ns)
    left = left + SEEN_PX * random.standard_normal(left.shape)
    disparity = disparity + SEEN_PX * random.standard_normal(len(ids))
    return StereoTracks(stamp_ns, ids, left, left - np.column_stack((disparity, np.zeros(len(ids)))))


def events(trial: AnalyticTrial) -> list[Measurement]:
    """Everything in time order; frames lie between joint samples."""
    last_ns = int(trial.truth.stamps_ns[-1])
    frames = [sight(trial, stamp_ns) for stamp_ns in range(3_000_000, last_ns, FRAME_NS)]
    return sorted([*trial.measurements, *frames], key=lambda one: one.stamp_ns)


def combined(config: BridgeConfig | None = None, legs: FilterConfig | None = None) -> CombinedOdometry:
    smoother = SmootherConfig.parse({"noise": {"track_px": SEEN_PX, "disparity_px": SEEN_PX}}, "test")
    return CombinedOdometry(
        LegOdometryFilter(DAISY, legs, remembers_frames=True),
        SlidingWindowSmoother(RIG, smoother, uses_imu=False),
        None,
        config,
    )


def play(odometry: CombinedOdometry, stream: Iterable[Measurement]) -> tuple[list[StateEstimate], list[StateEstimate]]:
    by_legs, by_eyes = [], []
    for measurement in stream:
        estimate = odometry.push(measurement)
        if estimate is not None:
            by_legs.append(estimate)
        by_eyes += [other for name, other in odometry.take_others() if name == BY_EYES]
    return by_legs, by_eyes


def miss_m(trial: AnalyticTrial, estimate: StateEstimate) -> float:
    """Distance from the truth, whose heading and place at the start are those of the world."""
    start = trial.truth.T_world_body[0]
    T_start = se3.transform(so3.about_z(float(so3.yaw(start[:3, :3]))), start[:3, 3])
    T_true = se3.inverse(T_start) @ true_pose(trial, estimate.stamp_ns)
    return float(np.linalg.norm(estimate.nav.T_world_body[:3, 3] - T_true[:3, 3]))


def silent(stream: Iterable[Measurement], kind: type, start_s: float, end_s: float) -> list[Measurement]:
    """Without samples of a kind for a while."""
    return [one for one in stream if not (isinstance(one, kind) and start_s <= one.stamp_ns * 1e-9 < end_s)]


@pytest.fixture(scope="module")
def stream(trial: AnalyticTrial) -> list[Measurement]:
    return events(trial)


def test_two_trajectories_come_out_that_agree(trial: AnalyticTrial, stream: list[Measurement]) -> None:
    odometry = combined()
    assert isinstance(odometry, Several)
    assert (odometry.name, odometry.other_names) == (BY_LEGS, (BY_EYES,))
    by_legs, by_eyes = play(odometry, stream)
    assert set(np.diff([one.stamp_ns for one in by_legs])) == {10_000_000}
    assert set(np.diff([one.stamp_ns for one in by_eyes])) == {FRAME_NS}
    assert miss_m(trial, by_legs[-1]) < 0.01
    assert miss_m(trial, by_eyes[-1]) < 0.01
    assert odometry.counts["feedback_taken"] > 3
    assert odometry.counts.get("feedback_refused", 0) <= 1
    apart = by_legs[-1].nav.T_world_body[:3, 3] - by_eyes[-1].nav.T_world_body[:3, 3]
    assert np.linalg.norm(apart) < 0.02


@pytest.mark.parametrize("latency_s", [0.0, 0.05, 0.2])
def test_a_late_result_is_taken_at_the_frame_it_is_of(
    trial: AnalyticTrial, stream: list[Measurement], latency_s: float
) -> None:
    odometry = combined(BridgeConfig(vision_latency_s=latency_s))
    by_legs, _ = play(odometry, stream)
    assert miss_m(trial, by_legs[-1]) < 0.01
    assert odometry.counts["feedback_taken"] > 3
    assert ("frame_while_busy" in odometry.counts) == (latency_s > FRAME_NS * 1e-9)


def test_feedback_teaches_the_filter_what_only_eyes_can_see(trial: AnalyticTrial, stream: list[Measurement]) -> None:
    """A start on the move with legs that may turn anyhow: only eyes know how far the gyroscope is off."""
    unsure = FilterConfig(robust=RobustConfig(slip_turn_per_m=0.5))
    moving = [one for one in stream if one.stamp_ns >= 2_000_000_000]
    wrong = {}
    for policy in ("off", "decorrelated"):
        by_legs, _ = play(combined(BridgeConfig.parse({"feedback": policy}, "test"), unsure), moving)
        wrong[policy] = (
            by_legs[-1].nav.gyroscope_bias - trial.gyroscope_bias[-1] @ DAISY.description.imu.T_body_imu[:3, :3].T
        )
    assert np.linalg.norm(wrong["decorrelated"]) < 0.5 * np.linalg.norm(wrong["off"])


@pytest.mark.parametrize("policy", ["paper", "ci"])
def test_other_policies_feed_back_too(trial: AnalyticTrial, stream: list[Measurement], policy: str) -> None:
    odometry = combined(BridgeConfig.parse({"feedback": policy}, "test"))
    by_legs, _ = play(odometry, stream)
    assert miss_m(trial, by_legs[-1]) < 0.02
    assert odometry.counts["feedback_taken"] > 3


def test_in_the_dark_the_legs_carry_on_and_the_first_frame_that_sees_is_tied_to_them(
    trial: AnalyticTrial, stream: list[Measurement]
) -> None:
    nothing = np.zeros((0, 2))

    def dark(one: Measurement) -> Measurement:
        is_dark = isinstance(one, StereoTracks) and 2.5 <= one.stamp_ns * 1e-9 < 3.5
        return StereoTracks(one.stamp_ns, np.zeros(0, dtype=np.int64), nothing, nothing) if is_dark else one

    odometry = combined()
    by_legs, by_eyes = play(odometry, [dark(one) for one in stream])
    told = [event.kind for event in odometry.take_events()]
    assert told.count("vision_lost") == told.count("vision_recovered") == 1
    assert max(miss_m(trial, one) for one in by_legs) < 0.03
    assert max(miss_m(trial, one) for one in by_eyes) < 0.03
    assert odometry.counts["smoother_frames_without_vision"] > 10
    in_the_dark = [one for one in by_eyes if 3.0 <= one.stamp_ns * 1e-9 < 3.5]
    felt = {one.stamp_ns: one.nav.velocity_world for one in by_legs}
    for one in in_the_dark:
        before_ns = max(stamp_ns for stamp_ns in felt if stamp_ns <= one.stamp_ns)
        np.testing.assert_allclose(one.nav.velocity_world, felt[before_ns], err_msg="legs say how fast it goes")


@pytest.mark.parametrize("kind", [JointSample, ImuSample])
def test_while_legs_say_nothing_the_eyes_hold(trial: AnalyticTrial, stream: list[Measurement], kind: type) -> None:
    odometry, alone = combined(), LegOdometryFilter(DAISY)
    halting = silent(stream, kind, 2.5, 3.5)
    by_legs, by_eyes = play(odometry, halting)
    seeing_nothing = [one for one in halting if not isinstance(one, StereoTracks)]
    blind = [one for one in map(alone.push, seeing_nothing) if one is not None]
    assert max(miss_m(trial, by_eyes[-1]), miss_m(trial, by_legs[-1])) < max(0.005, 0.6 * miss_m(trial, blind[-1]))


def test_frames_before_the_filter_has_started_are_counted(stream: list[Measurement]) -> None:
    odometry = combined()
    odometry.push(next(one for one in stream if isinstance(one, StereoTracks)))
    assert odometry.counts == {"frame_before_start": 1}
