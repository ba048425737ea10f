# SPDX-License-Identifier: BSD-3-Clause
"""Combined odometry on an analytic walk among points whose pixels are known up to noise."""

from collections import Counter
from collections.abc import Iterator
from functools import cache

import numpy as np
import pytest
from stand_ins import NotingFrontend, NotingSmoother, frame
from walk_among_points import (
    DAISY,
    FRAME_NS,
    JOINT_NS,
    between,
    combined,
    error_m,
    in_order,
    outputs_of,
    states,
    stream,
    trial,
    with_late_clock,
    without,
    without_tracks,
)

from coclo_vio.filter.config import FilterConfig, GateConfig, RobustConfig
from coclo_vio.filter.odometry import LegOdometryFilter
from coclo_vio.fusion.combined import CombinedOdometry
from coclo_vio.fusion.config import BridgeConfig
from coclo_vio.fusion.feedback import (
    Feedback,
    NoFeedback,
    register_feedback_policy,
    unregister_feedback_policy,
)
from coclo_vio.fusion.fused_estimates import FusedEstimates
from coclo_vio.geometry import se3
from coclo_vio.values.errors import SmootherError
from coclo_vio.values.estimates import StateEstimate
from coclo_vio.values.keyframes import KeyframeResult, PoseEvidence, PoseMarginal, PosePair
from coclo_vio.values.measurements import ImuSample, JointSample, Measurement, StereoFrame, StereoTracks
from coclo_vio.values.outputs import Calibration, Estimate, Event, Innovation, KeyframeHealth, Output, Picture
from coclo_vio.values.units import NS_PER_S


@cache
def whole_walk() -> tuple[CombinedOdometry, list[Output]]:
    """The whole stream with the default configuration; for tests that only look at it."""
    odometry = combined()
    return odometry, outputs_of(odometry, stream())


def test_two_trajectories_come_out_that_agree() -> None:
    odometry, outputs = whole_walk()
    by_legs, by_vision = states(outputs, "combined_coclo"), states(outputs, "combined_vins")
    assert {output.name for output in outputs if isinstance(output, Estimate)} == {"combined_coclo", "combined_vins"}
    assert set(np.diff([one.stamp_ns for one in by_legs])) == {JOINT_NS}
    assert set(np.diff([one.stamp_ns for one in by_vision])) == {FRAME_NS}
    assert error_m(by_legs[-1]) < 0.01
    assert error_m(by_vision[-1]) < 0.01
    assert odometry.counts["feedback_accepted"] > 3
    assert odometry.counts.get("feedback_rejected", 0) <= 1
    apart = by_legs[-1].nav.T_world_body[:3, 3] - by_vision[-1].nav.T_world_body[:3, 3]
    assert np.linalg.norm(apart) < 0.02


@pytest.mark.parametrize("latency_s", [0.0, 0.2])
def test_a_late_result_corrects_the_frame_that_it_is_of(latency_s: float) -> None:
    odometry = combined(BridgeConfig(vision_latency_s=latency_s))
    by_legs = states(outputs_of(odometry, between(stream(), 0.0, 3.0)), "combined_coclo")
    assert error_m(by_legs[-1]) < 0.01
    assert odometry.counts["feedback_accepted"] > 3
    assert ("frame_while_busy" in odometry.counts) == (latency_s > FRAME_NS / NS_PER_S)


def test_feedback_corrects_what_vision_alone_can_determine() -> None:
    """A start on the move with legs that may slip in yaw: only vision determines the gyroscope's bias."""
    uncertain = FilterConfig(robust=RobustConfig(slip_turn_per_m=0.5))
    moving = between(stream(), 2.0, 9.0)
    true_bias = trial().gyroscope_bias[-1] @ DAISY.description.imu.T_body_imu[:3, :3].T
    errors = {}
    for policy in ("off", "decorrelated"):
        odometry = combined(BridgeConfig.parse({"feedback": policy}, "test"), uncertain)
        errors[policy] = states(outputs_of(odometry, moving), "combined_coclo")[-1].nav.gyroscope_bias - true_bias
    assert np.linalg.norm(errors["decorrelated"]) < 0.5 * np.linalg.norm(errors["off"])


@pytest.mark.parametrize("policy", ["paper", "ci"])
def test_other_policies_feed_back_too(policy: str) -> None:
    odometry = combined(BridgeConfig.parse({"feedback": policy}, "test"))
    by_legs = states(outputs_of(odometry, between(stream(), 0.0, 3.0)), "combined_coclo")
    assert error_m(by_legs[-1]) < 0.02
    assert odometry.counts["feedback_accepted"] > 3


def test_without_vision_the_legs_carry_on_and_tie_the_first_frame_that_has_landmarks_again() -> None:
    def darkened(one: Measurement) -> Measurement:
        is_dark = isinstance(one, StereoTracks) and 2.5 <= one.stamp_ns / NS_PER_S < 3.5
        return without_tracks(one) if is_dark else one  # type: ignore[arg-type]

    odometry = combined()
    outputs = outputs_of(odometry, [darkened(one) for one in stream()])
    by_legs, by_vision = states(outputs, "combined_coclo"), states(outputs, "combined_vins")
    kinds = [output.kind for output in outputs if isinstance(output, Event)]
    assert kinds.count("vision_lost") == kinds.count("vision_recovered") == 1
    assert max(error_m(one) for one in by_legs) < 0.03
    assert max(error_m(one) for one in by_vision) < 0.03
    assert odometry.counts["smoother_frames_without_vision"] > 10
    in_the_dark = [one for one in by_vision if 3.0 <= one.stamp_ns / NS_PER_S < 3.5]
    velocity = {one.stamp_ns: one.nav.velocity_world for one in by_legs}
    for one in in_the_dark:
        before_ns = max(stamp_ns for stamp_ns in velocity if stamp_ns <= one.stamp_ns)
        np.testing.assert_allclose(one.nav.velocity_world, velocity[before_ns], err_msg="it is the legs' velocity")


@pytest.mark.parametrize("kind", [JointSample, ImuSample])
def test_without_leg_samples_vision_holds_the_pose(kind: type) -> None:
    alone = LegOdometryFilter(DAISY)
    halting = without(stream(), kind, 2.5, 3.5)
    outputs = outputs_of(combined(), halting)
    by_legs, by_vision = states(outputs, "combined_coclo"), states(outputs, "combined_vins")
    of_legs = [one for one in halting if not isinstance(one, StereoTracks)]
    by_legs_alone = [one for one in map(alone.push, of_legs) if one is not None]
    assert max(error_m(by_vision[-1]), error_m(by_legs[-1])) < max(0.005, 0.6 * error_m(by_legs_alone[-1]))


def test_frames_before_the_filter_has_started_are_counted() -> None:
    odometry = combined()
    assert odometry.push(next(one for one in stream() if isinstance(one, StereoTracks))) == []
    assert odometry.counts == {"frame_before_start": 1}


def test_a_frame_that_comes_long_after_its_stamp_is_left_out_and_counted() -> None:
    """The filter does not remember its motion so far back; the estimates are those without the frame."""
    rest = without(between(stream(), 0.0, 2.2), StereoTracks, 0.5, 2.2)
    late = next(one for one in between(stream(), 0.5, 0.8) if isinstance(one, StereoTracks))
    odometry, without_it = combined(), combined()
    outputs = outputs_of(odometry, [*rest, late])
    expected = states(outputs_of(without_it, rest), "combined_coclo")
    assert odometry.counts["frame_late"] == 1
    assert all(_same(one, other) for one, other in zip(states(outputs, "combined_coclo"), expected, strict=True))


def _same(one: StateEstimate, other: StateEstimate) -> bool:
    return one.stamp_ns == other.stamp_ns and (one.nav.T_world_body == other.nav.T_world_body).all()


@pytest.mark.parametrize(("offset_s", "frames", "joint_samples"), [(0.2, 3, 0), (-0.2, 0, 20)])
def test_a_camera_clock_of_its_own_loses_no_frame_and_no_joint_sample(
    offset_s: float, frames: int, joint_samples: int
) -> None:
    """What waits for the other clock comes out at the end; the estimates are those of cameras on the IMU's clock."""
    recorded = between(with_late_clock(stream(), offset_s), 0.0, 1.8)
    expected = outputs_of(combined(), with_late_clock(recorded, -offset_s))
    odometry = combined(time_offset_s=offset_s)
    pushed = [output for one in recorded for output in odometry.push(one)]
    finished = list(odometry.finish())
    assert (len(states(finished, "combined_vins")), len(states(finished, "combined_coclo"))) == (frames, joint_samples)
    assert odometry.counts.get("not_waited_for_clock", 0) == 0
    for name, least in (("combined_coclo", 130), ("combined_vins", 17)):
        got, wanted = states([*pushed, *finished], name), states(expected, name)
        assert len(got) == len(wanted) > least
        assert all(_same(one, other) for one, other in zip(got, wanted, strict=True))
    joints = [one.stamp_ns for one in recorded if isinstance(one, JointSample)]
    by_legs = [one.stamp_ns for one in states([*pushed, *finished], "combined_coclo")]
    assert by_legs == joints[joints.index(by_legs[0]) :]


def test_the_calibration_comes_after_each_accepted_feedback_with_sigmas_that_never_grow() -> None:
    odometry, outputs = whole_walk()
    calibrations = [output for output in outputs if isinstance(output, Calibration)]
    counts = odometry.counts
    assert len(calibrations) == counts["feedback_accepted"] + counts.get("feedback_forced", 0) > 10
    keyframes_ns = [output.stamp_ns for output in outputs if isinstance(output, KeyframeHealth)]
    assert {one.stamp_ns for one in calibrations} <= set(keyframes_ns)
    sigmas = np.array([(*one.rotation_sigma, one.stereo_scale_sigma) for one in calibrations])
    assert (np.diff(sigmas, axis=0) <= 1e-12).all()
    assert (sigmas[-1] < np.array([0.9, 0.9, 0.9, 0.97]) * sigmas[0]).all()  # lengths by stereo are known well before
    assert calibrations[-1].stereo_scale == pytest.approx(1.0, abs=3.0 * calibrations[-1].stereo_scale_sigma)
    assert (np.abs(calibrations[-1].rotation_body) < 3.0 * calibrations[-1].rotation_sigma).all()


# From here on the smoother is a stand-in: each frame is a keyframe, and its result is the policy's own.


class Claiming(NoFeedback):
    """Feeds back that the frame is ``shift`` away from the filter's pose, with sigmas of a millimetre and mrad."""

    shift = np.zeros(6)
    inflation = 1.0

    def feedback_for_filter(self, pair: PosePair, known: PoseMarginal, result: KeyframeResult) -> Feedback | None:
        information = np.zeros((12, 12))
        information[6:, 6:] = 1e6 * np.eye(6)
        T_end = pair.T_world_end @ se3.exp(self.shift)
        evidence = PoseEvidence(pair.start_ns, pair.end_ns, pair.T_world_start, T_end, information, np.zeros(12))
        return Feedback(evidence, self.inflation)


class Outlier(Claiming):
    shift = np.array([0.0, 0.0, 0.0, 2.0, 0.0, 0.0])


class InflatedOutlier(Outlier):
    inflation = 3.0


class Undetermined(NoFeedback):
    def evidence_for_window(self, pair: PosePair, known: PoseMarginal | None) -> PoseEvidence | None:
        raise SmootherError("the covariance is singular")

    def feedback_for_filter(self, pair: PosePair, known: PoseMarginal, result: KeyframeResult) -> Feedback | None:
        raise SmootherError("the marginal is singular")


@pytest.fixture
def _own_policies() -> Iterator[None]:
    own = {"claiming": Claiming, "outlier": Outlier, "inflated": InflatedOutlier, "undetermined": Undetermined}
    for name, policy in own.items():
        register_feedback_policy(name, policy, "of this test")
    yield
    for name in own:
        unregister_feedback_policy(name)


def window_result(stamp_ns: int, before_ns: int | None) -> KeyframeResult:
    marginal = PoseMarginal(stamp_ns, np.eye(4), np.eye(6))
    if before_ns is None:
        return KeyframeResult(marginal, None)
    evidence = PoseEvidence(before_ns, stamp_ns, np.eye(4), np.eye(4), np.eye(12), np.zeros(12))
    return KeyframeResult(marginal, evidence)


def with_images(end_s: float) -> tuple[Measurement, ...]:
    """The walk's leg samples and black images at the frames."""
    return in_order(
        frame(one.stamp_ns) if isinstance(one, StereoTracks) else one for one in between(stream(), 0.0, end_s)
    )


def exchanging(
    policy: str, end_s: float, *, max_rejections: int = 3, pictures_every: int | None = None
) -> tuple[CombinedOdometry, NotingSmoother, list[tuple[Measurement, list[Output]]]]:
    """Combined odometry with a policy and a smoother that makes every frame a keyframe; outputs by measurement."""
    smoother = NotingSmoother(keyframes_every=1, result=window_result)
    config = FilterConfig(feedback_gate=GateConfig(max_rejections=max_rejections))
    odometry = CombinedOdometry(
        LegOdometryFilter(DAISY, config, remembers_frames=True),
        smoother,
        NotingFrontend(),
        BridgeConfig.parse({"feedback": policy}, "test"),
        pictures_every=pictures_every,
    )
    return odometry, smoother, [(one, list(odometry.push(one))) for one in with_images(end_s)]


@pytest.mark.usefixtures("_own_policies")
def test_outputs_of_a_frame_and_of_feedback_are_in_order() -> None:
    odometry, smoother, given = exchanging("claiming", 1.2, pictures_every=2)
    of_frames = [(one, outputs) for one, outputs in given if any(isinstance(each, KeyframeHealth) for each in outputs)]
    kinds = [[type(output) for output in outputs] for _, outputs in of_frames]
    plain = [Event, KeyframeHealth, Estimate]
    assert kinds[0] == [Picture, *plain], "the first frame starts the window, and waits for nothing"
    later = [kind[: kind.index(Innovation)] for kind in kinds[1:]]
    assert later == [plain, [Picture, *plain]] * (len(later) // 2) + [plain] * (len(later) % 2)
    for kind in kinds[1:]:
        of_feedback = [Innovation, Calibration]  # the first one with the pictures
        assert kind[kind.index(Innovation) :] in (of_feedback, [*of_feedback, Estimate])
    pictures = [output for _, outputs in of_frames for output in outputs if isinstance(output, Picture)]
    assert np.diff([picture.stamp_ns for picture in pictures]).tolist() == [2 * FRAME_NS] * (len(pictures) - 1)
    assert len(pictures) >= 5
    assert len(later) == odometry.counts["feedback_accepted"] > 8
    for one, outputs in of_frames[1:]:
        stamps_ns = {each.stamp_ns for each in outputs if isinstance(each, Event | KeyframeHealth | Calibration)}
        assert len(stamps_ns) == 1
        assert 50_000_000 <= one.stamp_ns - stamps_ns.pop() < 60_000_000, "the latency, then the next leg sample"
    assert smoother.start is not None


@pytest.mark.usefixtures("_own_policies")
def test_the_result_of_the_last_keyframe_corrects_the_filter_at_the_end() -> None:
    """No measurement comes after its latency has passed."""
    odometry, _, given = exchanging("claiming", 0.61)
    accepted = odometry.counts["feedback_accepted"]
    assert isinstance(given[-1][0], StereoFrame | JointSample)
    *of_frame, calibration = odometry.finish()
    assert [type(output) for output in of_frame] == [Event, KeyframeHealth, Estimate]
    assert isinstance(calibration, Calibration)
    assert calibration.stamp_ns == max(one.stamp_ns for one, _ in given if isinstance(one, StereoFrame))
    assert odometry.counts["feedback_accepted"] == accepted + 1
    assert list(odometry.finish()) == []


def test_trajectories_are_named_on_request() -> None:
    smoother = NotingSmoother()
    leg_filter = LegOdometryFilter(DAISY, remembers_frames=True)
    odometry = CombinedOdometry(leg_filter, smoother, NotingFrontend(), outputs=FusedEstimates("legs", "vision"))
    outputs = [output for one in with_images(0.7) for output in odometry.push(one)]
    assert {output.name for output in outputs if isinstance(output, Estimate)} == {"legs", "vision"}


@pytest.mark.usefixtures("_own_policies")
def test_evidence_that_does_not_fit_is_rejected_and_forced_after_rejections_in_a_row() -> None:
    odometry, _, given = exchanging("outlier", 1.2)
    outputs = [output for _, of_one in given for output in of_one]
    events = [output for output in outputs if isinstance(output, Event) and output.kind != "vision_lost"]
    cycle = ["feedback_rejected"] * 3 + ["feedback_forced"]
    kinds = [event.kind for event in events]
    assert kinds[:4] == cycle
    assert set(kinds) == set(cycle)
    assert Counter(kinds) == {kind: odometry.counts[kind] for kind in set(cycle)}
    for event in events[:3]:
        assert event.detail.startswith("the evidence of vision has a squared innovation of ")
        assert event.detail.endswith(" where 6 is expected; it was rejected")
    assert events[3].detail.endswith("the filter's covariance was inflated and the evidence accepted")
    accepted = odometry.counts["feedback_forced"] + odometry.counts.get("feedback_accepted", 0)
    assert sum(isinstance(output, Calibration) for output in outputs) == accepted


@pytest.mark.usefixtures("_own_policies")
def test_rejected_evidence_leaves_the_filter_as_it_was() -> None:
    """Estimates and covariances to the last bit: those of a run without feedback."""
    runs = {}
    for policy in ("outlier", "off"):
        odometry, _, given = exchanging(policy, 1.2, max_rejections=1000)
        runs[policy] = odometry, states([output for _, of_one in given for output in of_one], "combined_coclo")
    assert runs["outlier"][0].counts["feedback_rejected"] > 8
    assert len(runs["off"][1]) > 70
    for one, other in zip(runs["outlier"][1], runs["off"][1], strict=True):
        np.testing.assert_array_equal(one.nav.T_world_body, other.nav.T_world_body)
        np.testing.assert_array_equal(one.covariance, other.covariance)


@pytest.mark.usefixtures("_own_policies")
def test_inflation_comes_before_the_gate() -> None:
    """Rejected evidence moves nothing, but its inflation of the filter's sigmas stays."""
    sigmas_m = {}
    for policy in ("inflated", "off"):
        _, _, given = exchanging(policy, 0.54, max_rejections=1000)
        last = states([output for _, of_one in given for output in of_one], "combined_coclo")[-1]
        sigmas_m[policy] = np.sqrt(np.diag(last.covariance)[3:6])
    np.testing.assert_array_less(1.5 * sigmas_m["off"], sigmas_m["inflated"])
    np.testing.assert_array_less(sigmas_m["inflated"], 3.0 * sigmas_m["off"] + 1e-12)


@pytest.mark.usefixtures("_own_policies")
def test_evidence_that_cannot_be_determined_is_an_event_and_the_relative_motion_ties_alone() -> None:
    odometry, smoother, given = exchanging("undetermined", 0.9)
    outputs = [*(output for _, of_one in given for output in of_one), *odometry.finish()]
    events = [output for output in outputs if isinstance(output, Event)]
    details = Counter(event.detail for event in events if event.kind == "evidence_unavailable")
    frames = smoother.frames - 1  # the first one is no pair
    assert details == {"the covariance is singular": frames, "the marginal is singular": frames}
    assert frames > 4
    assert smoother.evidence == [None] * smoother.frames
    assert [one is None for one in smoother.odometry] == [True] + [False] * frames
    assert not any(name.startswith("feedback") for name in odometry.counts)


@pytest.mark.usefixtures("_own_policies")
def test_the_motion_between_frames_is_the_filters() -> None:
    _, smoother, given = exchanging("off", 2.0)
    deltas = [one for one in smoother.odometry if one is not None]
    assert [one.end_ns - one.start_ns for one in deltas] == [FRAME_NS] * len(deltas)
    by_legs = states([output for _, of_one in given for output in of_one], "combined_coclo")
    travelled_m = sum(one.T_start_end[0, 3] for one in deltas)
    assert travelled_m == pytest.approx(by_legs[-1].nav.T_world_body[0, 3], abs=0.02)
    assert travelled_m > 0.08
