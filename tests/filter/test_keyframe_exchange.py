# SPDX-License-Identifier: BSD-3-Clause
"""The exchange of keyframes: relative motion, late evidence, the order of calls, and the cameras' calibration."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np
import pytest

from coclo_vio.filter.config import FilterConfig, GateConfig, InitialConfig, RobustConfig
from coclo_vio.filter.evidence_gate import GateOutcome
from coclo_vio.filter.keyframe_exchange import FramePair, HeldFrame, Keyframe, MarkedFrame
from coclo_vio.filter.odometry import LegOdometryFilter
from coclo_vio.filter.state_blocks import held_frame_block
from coclo_vio.geometry import se3
from coclo_vio.robot.model import RobotModel
from coclo_vio.simulation.analytic import AnalyticTrial
from coclo_vio.values.errors import FilterError
from coclo_vio.values.estimates import StateEstimate
from coclo_vio.values.keyframes import OdometryDelta, PoseEvidence, relative_motion
from coclo_vio.values.measurements import Measurement
from coclo_vio.values.units import NS_PER_S

EXACT_CAMERAS = InitialConfig(camera_rotation_sigma_rad=0.0, stereo_scale_sigma=0.0)
NOMINAL = RobustConfig(estimates_leg_scale=False, estimates_leg_compliance=False, step_deflection_s=0.0)
PROFILES = [
    FilterConfig(robust=NOMINAL, initial=EXACT_CAMERAS),
    FilterConfig(profile="paper", initial=EXACT_CAMERAS),
]
FRAME_NS = 4_000_000  # from a joint sample to a frame


@pytest.fixture(params=PROFILES, ids=["robust", "paper"])
def config(request: pytest.FixtureRequest) -> FilterConfig:
    assert isinstance(request.param, FilterConfig)
    return request.param


def started(
    robot: RobotModel, measurements: Sequence[Measurement], config: FilterConfig | None = None
) -> tuple[LegOdometryFilter, StateEstimate]:
    """A filter that remembers frames after the measurements, and its last estimate."""
    odometry = LegOdometryFilter(robot, config, remembers_frames=True)
    return odometry, pushed(odometry, measurements)[-1]


def pushed(odometry: LegOdometryFilter, measurements: Sequence[Measurement]) -> list[StateEstimate]:
    return [estimate for estimate in map(odometry.push, measurements) if estimate is not None]


@dataclass
class KeyframedWalk:
    """A walk with a keyframe at every so many estimates."""

    keyframe: Keyframe | None = None
    motions: list[OdometryDelta] = field(default_factory=list)
    at_keyframes: list[StateEstimate] = field(default_factory=list)


def keyframed(
    robot: RobotModel, measurements: Sequence[Measurement], every: int, config: FilterConfig
) -> KeyframedWalk:
    odometry, walk, count = LegOdometryFilter(robot, config, remembers_frames=True), KeyframedWalk(), 0
    for measurement in measurements:
        estimate = odometry.push(measurement)
        if estimate is None:
            continue
        if walk.keyframe is None:
            walk.keyframe = odometry.mark_frame(estimate.stamp_ns).anchor()
            walk.at_keyframes.append(estimate)
        elif count % every == 0:
            pair = walk.keyframe.mark_frame(estimate.stamp_ns)
            walk.motions.append(relative_motion(pair.poses(), floor_m=0.0))
            walk.keyframe = pair.keep()
            walk.at_keyframes.append(estimate)
        count += 1
    return walk


def test_motion_from_a_keyframe_to_its_own_stamp_is_certain_and_the_identity(
    daisy: RobotModel, noisy_walk: AnalyticTrial, config: FilterConfig
) -> None:
    odometry, last = started(daisy, noisy_walk.measurements[:900], config)
    keyframe = odometry.mark_frame(last.stamp_ns).anchor()
    delta = relative_motion(keyframe.mark_frame(last.stamp_ns).poses(), floor_m=0.0)
    assert delta.start_ns == delta.end_ns == last.stamp_ns
    np.testing.assert_allclose(delta.T_start_end, np.eye(4), atol=1e-12)
    np.testing.assert_allclose(delta.covariance, 0.0, atol=1e-16)


def test_relative_motion_leads_from_the_keyframe_to_the_present(daisy: RobotModel, noisy_walk: AnalyticTrial) -> None:
    """Its uncertainty grows with time."""
    odometry, at_keyframe = started(daisy, noisy_walk.measurements[:400], PROFILES[0])
    keyframe = odometry.mark_frame(at_keyframe.stamp_ns).anchor()
    sigmas_m: list[float] = []
    for first in range(400, 1200, 200):
        now = pushed(odometry, noisy_walk.measurements[first : first + 200])[-1]
        delta = relative_motion(keyframe.mark_frame(now.stamp_ns).poses(), floor_m=0.0)
        assert np.linalg.eigvalsh(delta.covariance)[0] > 0.0
        sigmas_m.append(float(np.sqrt(np.trace(delta.covariance[3:, 3:]))))
    assert (delta.start_ns, delta.end_ns) == (at_keyframe.stamp_ns, now.stamp_ns)
    difference = se3.log(se3.inverse(at_keyframe.nav.T_world_body @ delta.T_start_end) @ now.nav.T_world_body)
    assert np.abs(difference).max() < 5e-3  # the keyframe itself was corrected since
    assert sigmas_m[-1] > sigmas_m[0]


def test_chained_motions_are_the_walk(daisy: RobotModel, noisy_walk: AnalyticTrial, config: FilterConfig) -> None:
    walk = keyframed(daisy, noisy_walk.measurements, 50, config)
    chained = walk.at_keyframes[0].nav.T_world_body
    for delta in walk.motions:
        chained = chained @ delta.T_start_end
    last = walk.at_keyframes[-1].nav.T_world_body
    assert np.linalg.norm(last[:3, 3]) > 0.3
    assert np.abs(se3.log(se3.inverse(chained) @ last)).max() < 0.02


@pytest.mark.long
def test_remembering_frames_changes_no_estimate(
    daisy: RobotModel, noisy_walk: AnalyticTrial, config: FilterConfig
) -> None:
    """Against the same filter without any frame, whose state has as many errors."""
    plain = LegOdometryFilter(daisy, config, remembers_frames=True)
    by_stamp = {estimate.stamp_ns: estimate for estimate in pushed(plain, noisy_walk.measurements)}
    for estimate in keyframed(daisy, noisy_walk.measurements, 40, config).at_keyframes:
        expected = by_stamp[estimate.stamp_ns]
        np.testing.assert_allclose(estimate.nav.T_world_body, expected.nav.T_world_body, atol=1e-8)


def test_late_evidence_on_the_keyframe_corrects_the_present(
    daisy: RobotModel, noisy_walk: AnalyticTrial, config: FilterConfig
) -> None:
    no_slip = config.robust.model_copy(update={"slip_share": 0.0, "slip_turn_per_m": 0.0})
    open_gate = GateConfig(probability=1.0 - 1e-15)
    config = config.model_copy(update={"robust": no_slip, "feedback_gate": open_gate})
    odometry, at_anchor = started(daisy, noisy_walk.measurements[:330], config)
    keyframe = odometry.mark_frame(at_anchor.stamp_ns).anchor()
    at_keyframe = pushed(odometry, noisy_walk.measurements[330:600])[-1]
    keyframe = keyframe.mark_frame(at_keyframe.stamp_ns).keep()
    before = pushed(odometry, noisy_walk.measurements[600:900])[-1]
    pair = keyframe.mark_frame(before.stamp_ns)
    poses, shift = pair.poses(), np.array([0.004, -0.003, 0.002])
    information = np.zeros((12, 12))
    information[:6, :6] = np.diag([1e2] * 3 + [1e10] * 3)
    T_measured = poses.T_world_start.copy()
    T_measured[:3, 3] += shift
    evidence = PoseEvidence(poses.start_ns, poses.end_ns, T_measured, poses.T_world_end, information, np.zeros(12))
    result = pair.correct(evidence)
    assert result.outcome is GateOutcome.ACCEPTED
    assert result.innovation_squared > 0.0
    motions = [relative_motion(each, floor_m=0.0).T_start_end for each in (poses, pair.poses())]
    np.testing.assert_allclose(motions[1][:3, 3], motions[0][:3, 3], atol=2e-3)
    after = pushed(odometry, noisy_walk.measurements[900:910])[0]
    predicted = before.nav.velocity_world * (after.stamp_ns - before.stamp_ns) / NS_PER_S
    moved = after.nav.T_world_body[:3, 3] - before.nav.T_world_body[:3, 3] - predicted
    np.testing.assert_allclose(moved, shift, atol=2e-3)
    assert after.covariance[3:6, 3:6].trace() < before.covariance[3:6, 3:6].trace()


def test_the_anchor_is_where_poses_are_counted_from(daisy: RobotModel, noisy_walk: AnalyticTrial) -> None:
    odometry, last = started(daisy, noisy_walk.measurements[:600])
    stamp_ns = last.stamp_ns + FRAME_NS
    mark = odometry.mark_frame(stamp_ns)
    T_world_anchor = mark.T_world_body
    keyframe = mark.anchor()
    later = pushed(odometry, noisy_walk.measurements[600:900])[-1]
    pair = keyframe.mark_frame(later.stamp_ns)
    poses = pair.poses()
    assert (poses.start_ns, poses.end_ns) == (pair.keyframe_ns, pair.stamp_ns) == (stamp_ns, later.stamp_ns)
    np.testing.assert_allclose(poses.T_world_start, np.eye(4), atol=1e-12)
    np.testing.assert_allclose(pair.T_world_body, later.nav.T_world_body, atol=1e-12)
    np.testing.assert_allclose(T_world_anchor @ poses.T_world_end, pair.T_world_body, atol=5e-3)  # corrected since
    T_world_body, covariance = keyframe.in_world(poses.T_world_end, 1e-6 * np.eye(6))
    np.testing.assert_allclose(T_world_body, pair.T_world_body, atol=1e-12)
    assert np.linalg.eigvalsh(covariance)[0] > 0.0


def evidence_on(pair: FramePair) -> PoseEvidence:
    poses = pair.poses()
    return PoseEvidence(poses.start_ns, poses.end_ns, poses.T_world_start, poses.T_world_end, np.eye(12), np.zeros(12))


@dataclass
class Handles:
    """Objects of an exchange in the order of the calls: those of the first four are void at the end."""

    first_mark: MarkedFrame
    anchor_mark: MarkedFrame
    first_keyframe: Keyframe
    kept_pair: FramePair
    keyframe: Keyframe
    pair: FramePair


@pytest.fixture
def handles(daisy: RobotModel, noisy_walk: AnalyticTrial) -> Handles:
    odometry, last = started(daisy, noisy_walk.measurements[:600])
    first_mark = odometry.mark_frame(last.stamp_ns)
    anchor_mark = odometry.mark_frame(last.stamp_ns + 1)
    first_keyframe = anchor_mark.anchor()
    kept_pair = first_keyframe.mark_frame(last.stamp_ns + 2)
    keyframe = kept_pair.keep()
    return Handles(first_mark, anchor_mark, first_keyframe, kept_pair, keyframe, keyframe.mark_frame(last.stamp_ns + 3))


VOID_CALLS: dict[str, Callable[[Handles], object]] = {
    "pose of a mark after a later mark": lambda handles: handles.first_mark.T_world_body,
    "anchoring a mark after a later mark": lambda handles: handles.first_mark.anchor(),
    "pose of a mark after it was anchored": lambda handles: handles.anchor_mark.T_world_body,
    "anchoring a mark twice": lambda handles: handles.anchor_mark.anchor(),
    "frame of a keyframe after a later keyframe": lambda handles: handles.first_keyframe.mark_frame(9),
    "world of a keyframe after a later keyframe": lambda handles: handles.first_keyframe.in_world(np.eye(4), np.eye(6)),
    "pose of a pair after it was kept": lambda handles: handles.kept_pair.T_world_body,
    "poses of a pair after it was kept": lambda handles: handles.kept_pair.poses(),
    "evidence on a pair after it was kept": lambda handles: handles.kept_pair.correct(evidence_on(handles.pair)),
    "keeping a pair twice": lambda handles: handles.kept_pair.keep(),
}


@pytest.mark.parametrize("call", VOID_CALLS.values(), ids=VOID_CALLS)
def test_an_object_that_a_later_call_replaced_is_void(call: Callable[[Handles], object], handles: Handles) -> None:
    before = handles.pair.poses()
    with pytest.raises(FilterError, match=r"of \d+ ns is void: .* go on with the object"):
        call(handles)
    np.testing.assert_array_equal(handles.pair.poses().covariance, before.covariance)


def test_an_earlier_pair_is_void_after_a_later_frame_of_its_keyframe(handles: Handles) -> None:
    later = handles.keyframe.mark_frame(handles.pair.stamp_ns + 1)
    with pytest.raises(FilterError, match=r"FramePair of .* is void"):
        handles.pair.poses()
    assert later.poses().end_ns == later.stamp_ns


def test_a_new_first_frame_makes_every_earlier_object_void(daisy: RobotModel, noisy_walk: AnalyticTrial) -> None:
    odometry, last = started(daisy, noisy_walk.measurements[:600])
    keyframe = odometry.mark_frame(last.stamp_ns).anchor()
    pair = keyframe.mark_frame(last.stamp_ns + 1)
    odometry.mark_frame(last.stamp_ns + 2)
    with pytest.raises(FilterError, match=r"Keyframe of .* is void"):
        keyframe.mark_frame(last.stamp_ns + 3)
    with pytest.raises(FilterError, match=r"FramePair of .* is void"):
        pair.keep()


def test_evidence_has_to_be_on_the_stamps_of_the_pair(handles: Handles) -> None:
    stranger = PoseEvidence(1, 2, np.eye(4), np.eye(4), np.eye(12), np.zeros(12))
    before = handles.pair.poses()
    with pytest.raises(FilterError, match=r"evidence on \(1, 2\) ns does not belong to the pair"):
        handles.pair.correct(stranger)
    np.testing.assert_array_equal(handles.pair.poses().covariance, before.covariance)
    assert handles.pair.correct(evidence_on(handles.pair)).outcome is GateOutcome.ACCEPTED


def test_inflation_multiplies_the_sigmas_of_the_poses_before_the_gate(
    daisy: RobotModel, noisy_walk: AnalyticTrial
) -> None:
    odometry, last = started(daisy, noisy_walk.measurements[:600])
    keyframe = odometry.mark_frame(last.stamp_ns).anchor()
    now = pushed(odometry, noisy_walk.measurements[600:900])[-1]
    pair = keyframe.mark_frame(now.stamp_ns)
    before = pair.poses()
    no_information = PoseEvidence(
        before.start_ns, before.end_ns, before.T_world_start, before.T_world_end, 1e-12 * np.eye(12), np.zeros(12)
    )
    assert pair.correct(no_information, inflation=2.0).outcome is GateOutcome.ACCEPTED
    yaw_sigmas = [np.sqrt(poses.covariance[8, 8]) for poses in (before, pair.poses())]
    assert yaw_sigmas[1] > 1.5 * yaw_sigmas[0]


def test_without_a_start_or_frames_the_error_gives_the_next_step(daisy: RobotModel, noisy_walk: AnalyticTrial) -> None:
    for call in (LegOdometryFilter.mark_frame, LegOdometryFilter.camera_calibration):
        with pytest.raises(FilterError, match=r"not started.*push measurements first"):
            call(LegOdometryFilter(daisy, remembers_frames=True), 0)
        plain = LegOdometryFilter(daisy)
        pushed(plain, noisy_walk.measurements[:600])
        with pytest.raises(FilterError, match="remembers_frames=True"):
            call(plain, 0)


def test_calibration_starts_with_the_prior(daisy: RobotModel, noisy_walk: AnalyticTrial) -> None:
    initial = InitialConfig(camera_rotation_sigma_rad=0.003, stereo_scale_sigma=0.02)
    odometry, last = started(daisy, noisy_walk.measurements[:900], FilterConfig(initial=initial))
    calibration = odometry.camera_calibration(last.stamp_ns)
    assert calibration.stamp_ns == last.stamp_ns
    np.testing.assert_allclose(calibration.rotation_body, 0.0, atol=1e-15)
    assert calibration.stereo_scale == pytest.approx(1.0, abs=1e-15)
    np.testing.assert_allclose(calibration.rotation_sigma, 0.003, rtol=1e-9)
    assert calibration.stereo_scale_sigma == pytest.approx(0.02, rel=1e-9)


def test_calibration_is_that_of_the_state_and_acts_as_documented(daisy: RobotModel, noisy_walk: AnalyticTrial) -> None:
    """A motion T of the body is measured as E T E^-1, its translation scaled."""
    rotation, stretch = np.array([0.01, -0.02, 0.015]), 0.03
    odometry, last = started(daisy, noisy_walk.measurements[:600], PROFILES[0])
    keyframe = odometry.mark_frame(last.stamp_ns).anchor()
    now = pushed(odometry, noisy_walk.measurements[600:900])[-1]
    pair = keyframe.mark_frame(now.stamp_ns)
    T_true = pair.poses().T_world_end
    core = odometry._core
    assert core is not None
    core.mean.vector[core.mean.layout.at("camera")] = (*rotation, stretch)
    calibration = odometry.camera_calibration(now.stamp_ns)
    np.testing.assert_array_equal(calibration.rotation_body, rotation)
    assert calibration.stereo_scale == pytest.approx(1.03)
    E = se3.exp(np.concatenate((calibration.rotation_body, np.zeros(3))))
    T_measured = E @ T_true @ se3.inverse(E)
    T_measured[:3, 3] *= calibration.stereo_scale
    assert np.linalg.norm(T_measured[:3, 3] - T_true[:3, 3]) > 1e-4
    np.testing.assert_allclose(pair.poses().T_world_end, T_measured, atol=1e-12)


def test_evidence_reduces_the_sigmas_of_the_calibration(daisy: RobotModel, noisy_walk: AnalyticTrial) -> None:
    odometry, last = started(daisy, noisy_walk.measurements[:600])
    keyframe = odometry.mark_frame(last.stamp_ns).anchor()
    now = pushed(odometry, noisy_walk.measurements[600:])[-1]
    pair = keyframe.mark_frame(now.stamp_ns)
    poses, before = pair.poses(), odometry.camera_calibration(now.stamp_ns)
    evidence = PoseEvidence(
        poses.start_ns, poses.end_ns, poses.T_world_start, poses.T_world_end, 1e8 * np.eye(12), np.zeros(12)
    )
    assert pair.correct(evidence).outcome is GateOutcome.ACCEPTED
    after = odometry.camera_calibration(now.stamp_ns)
    assert after.stereo_scale_sigma < 0.99 * before.stereo_scale_sigma
    assert (after.rotation_sigma <= before.rotation_sigma * (1.0 + 1e-9)).all()


def test_a_frame_that_waits_has_the_pose_of_its_own_time_and_changes_nothing_else(
    daisy: RobotModel, noisy_walk: AnalyticTrial
) -> None:
    """A frame that was held, paired later with the next keyframe, against the same frame marked at its stamp."""
    config = PROFILES[0]
    before, later = noisy_walk.measurements[:600], noisy_walk.measurements[600:640]
    poses = []
    for holds in (False, True):
        extra = (held_frame_block(),) if holds else ()
        odometry = LegOdometryFilter(daisy, config, remembers_frames=True, extra_blocks=extra)
        last = pushed(odometry, before)[-1]
        keyframe = odometry.mark_frame(last.stamp_ns).anchor()
        assert keyframe.can_hold == holds
        stamp_ns = last.stamp_ns + FRAME_NS
        held = keyframe.hold_frame(stamp_ns) if holds else keyframe.mark_frame(stamp_ns)
        states = pushed(odometry, later)
        pair = keyframe.mark_held(held) if isinstance(held, HeldFrame) else held
        poses.append((pair.poses(), states[-1]))
        if isinstance(held, HeldFrame):
            with pytest.raises(FilterError, match="the HeldFrame of "):
                keyframe.mark_held(held)
    (one, its_state), (other, other_state) = poses
    assert (one.start_ns, one.end_ns) == (other.start_ns, other.end_ns)
    np.testing.assert_allclose(one.T_world_end, other.T_world_end, atol=1e-9)
    np.testing.assert_allclose(one.covariance, other.covariance, atol=1e-12)
    np.testing.assert_allclose(its_state.covariance, other_state.covariance, atol=1e-12)
    np.testing.assert_allclose(its_state.nav.T_world_body, other_state.nav.T_world_body, atol=1e-12)
