# SPDX-License-Identifier: BSD-3-Clause
"""Evidence on remembered poses: accepted, rejected, and accepted with inflated covariance in the end."""

from dataclasses import replace

import numpy as np
import pytest
from state_layouts import layout_of, state_of

from coclo_vio.filter.config import GateConfig
from coclo_vio.filter.evidence_gate import EvidenceGate, GateOutcome
from coclo_vio.filter.remembered_poses import _pair, as_measured, frame_pose, in_world
from coclo_vio.filter.square_root_filter import SquareRootFilter
from coclo_vio.filter.state import POSITION, RATE, ROTATION, VELOCITY, State
from coclo_vio.filter.state_blocks import FRAME
from coclo_vio.geometry import se3, so3
from coclo_vio.values.arrays import Array
from coclo_vio.values.keyframes import PoseEvidence

LAYOUT = layout_of(2, has_frame=True)
FRAME_ROTATION, FRAME_POSITION = LAYOUT.rotation_of(FRAME), LAYOUT.position_of(FRAME)
STEP = 1e-6


def random_filter(seed: int, sigma: float = 0.01) -> SquareRootFilter:
    """A filter with all errors correlated; the cameras have a small mounting and scale error."""
    random = np.random.default_rng(seed)
    mean = state_of(LAYOUT, random)
    mean.vector[LAYOUT.at("camera")] = [0.01, -0.02, 0.015, 0.03]
    core = SquareRootFilter(mean, np.ones(LAYOUT.dimension), is_wide=False)
    core.factor = sigma * np.tril(random.normal(size=core.factor.shape))
    return core


def derivative(core: SquareRootFilter) -> Array:
    """Of a pair of poses about those of the mean, by each error of the filter, (12, L)."""
    before = _pair(core.mean)[:2]
    columns = []
    for error in STEP * np.eye(LAYOUT.dimension):
        after = _pair(core.mean.corrected(error))[:2]
        columns.append(np.concatenate([se3.log(se3.inverse(a) @ b) for a, b in zip(before, after, strict=True)]) / STEP)
    return np.array(columns).T


@pytest.mark.parametrize("seed", range(3))
def test_errors_of_a_pair_are_those_of_anchor_poses_and_cameras(seed: int) -> None:
    core = random_filter(seed)
    np.testing.assert_allclose(_pair(core.mean)[2], derivative(core), atol=2e-4)


def test_exactly_calibrated_cameras_measure_the_true_poses() -> None:
    T = se3.exp(np.array([0.1, 0.2, -0.3, 1.0, 2.0, 3.0]))
    measured, by_pose, _ = as_measured(T, np.zeros(4))
    np.testing.assert_allclose(measured, T, atol=1e-15)
    np.testing.assert_allclose(by_pose, np.eye(6), atol=1e-15)


def test_a_measured_pose_is_returned_to_the_world_of_the_filter() -> None:
    core = random_filter(4)
    _, T_anchor_frame, _ = _pair(core.mean)
    T_world_frame, covariance = in_world(core, T_anchor_frame, 1e-18 * np.eye(6))
    np.testing.assert_allclose(T_world_frame, frame_pose(core.mean), atol=1e-12)
    assert np.linalg.eigvalsh(covariance)[0] > 0.0


def test_a_frame_between_samples_is_predicted_with_constant_velocity() -> None:
    """The pose, and the correlation of its errors with all others, against finite differences."""
    core, dt_s = random_filter(5, sigma=1e-3), 0.04

    def frame_of(state: State) -> Array:
        rotation = state.rotation @ so3.exp(state.vector[RATE] * dt_s)
        return se3.transform(rotation, state.vector[POSITION] + state.vector[VELOCITY] * dt_s)

    before, at = frame_of(core.mean), core.mean
    jacobian = np.array(
        [se3.log(se3.inverse(before) @ frame_of(at.corrected(e))) / STEP for e in STEP * np.eye(LAYOUT.dimension)]
    ).T
    rows = jacobian @ core.factor
    across = core.factor[ROTATION] @ rows.T
    core.mark_frame(dt_s)
    np.testing.assert_allclose(frame_pose(core.mean), before, atol=1e-12)
    to_frame = core.mean.remembered_rotation(FRAME).T
    local = np.zeros((6, LAYOUT.dimension))
    local[:3, FRAME_ROTATION] = local[3:, FRAME_POSITION] = to_frame
    local[3:, FRAME_ROTATION] = -to_frame @ so3.hat(core.mean.vector[FRAME_POSITION])
    now = local @ core.factor
    np.testing.assert_allclose(now @ now.T, rows @ rows.T, rtol=5e-3, atol=2e-8)
    np.testing.assert_allclose(core.factor[ROTATION] @ now.T, across, rtol=5e-3, atol=2e-8)


@pytest.mark.parametrize("away_m", [0.0, 20.0])
def test_noise_of_the_rotation_does_not_move_the_frame(away_m: float) -> None:
    """An uncertain rotation since the last sample adds no uncertainty of the position, far from the origin too."""
    core = random_filter(11, sigma=1e-3)
    core.mean.vector[POSITION] = (away_m, 0.0, 0.0)

    def spread() -> Array:
        at, R = core.mean.vector[FRAME_POSITION], core.mean.remembered_rotation(FRAME)
        rows = (R.T @ (core.factor[FRAME_POSITION] - so3.hat(at) @ core.factor[FRAME_ROTATION])).T
        return np.asarray(rows.T @ rows)

    core.mark_frame(0.0)
    before = spread()
    core.mark_frame(0.0, noise=(0.1, 0.0))
    np.testing.assert_allclose(spread(), before, atol=1e-9)
    assert np.sqrt(core.variance(FRAME_ROTATION)).min() > 0.09


def test_a_forced_correction_uses_the_fallback() -> None:
    core = random_filter(12, sigma=1e-3)
    gate = EvidenceGate(GateConfig(max_rejections=1))
    step = of_pair(core, np.array([0.0, 0.0, 0.0, 0.1, 0.0, 0.0]), 1e-3)
    fallback = of_pair(core, np.array([0.0, 0.0, 0.0, 0.3, 0.0, 0.0]), 1e-3)
    assert [gate.correct(core, step, fallback).outcome for _ in range(2)] == [GateOutcome.REJECTED, GateOutcome.FORCED]
    assert se3.log(se3.inverse(step.T_world_end) @ _pair(core.mean)[1])[3] == pytest.approx(0.3, abs=0.02)


def test_evidence_with_which_no_other_sensor_agrees_is_never_forced() -> None:
    core = random_filter(13, sigma=1e-3)
    gate = EvidenceGate(GateConfig(max_rejections=1))
    step = of_pair(core, np.array([0.0, 0.0, 0.0, 0.1, 0.0, 0.0]), 1e-3)
    before = core.mean.vector.copy()
    assert {gate.correct(core, step, may_force=False).outcome for _ in range(5)} == {GateOutcome.REJECTED}
    np.testing.assert_array_equal(core.mean.vector, before)
    assert gate.correct(core, step).outcome is GateOutcome.FORCED, "once another one agrees"


def test_a_forced_correction_does_not_widen_the_constants() -> None:
    """A jump of the pose says nothing against scales, biases and mountings, which would take it up otherwise."""
    core = random_filter(14, sigma=1e-3)
    gate = EvidenceGate(GateConfig(max_rejections=1))
    constants = LAYOUT.at("camera")
    before = core.variance(constants)
    outcomes = [gate.correct(core, of_pair(core, np.full(6, 0.1), 1e-3)).outcome for _ in range(2)]
    assert outcomes[-1] is GateOutcome.FORCED
    assert (core.variance(constants) <= before * (1.0 + 1e-9)).all()


def of_pair(core: SquareRootFilter, shift: Array, sigma: float) -> PoseEvidence:
    """Evidence that the frame is ``shift`` (6,) away from its estimate."""
    T_start, T_end, _ = _pair(core.mean)
    information = np.zeros((12, 12))
    information[6:, 6:] = np.eye(6) / sigma**2
    vector = information @ np.concatenate((np.zeros(6), shift))
    return PoseEvidence(0, 1, T_start, T_end, information, vector)


def test_accepted_evidence_moves_the_frame() -> None:
    core = random_filter(6)
    shift = np.array([1e-4, -2e-4, 1e-4, 1e-3, 2e-3, -1e-3])
    T_before = _pair(core.mean)[1]
    result = EvidenceGate(GateConfig()).correct(core, of_pair(core, shift, 1e-6))
    assert result.outcome is GateOutcome.ACCEPTED
    assert result.rows == 6
    np.testing.assert_allclose(se3.log(se3.inverse(T_before) @ _pair(core.mean)[1]), shift, atol=2e-5)


def test_an_outlier_changes_nothing_and_is_counted() -> None:
    core = random_filter(7, sigma=1e-3)
    mean, factor = core.mean, core.factor
    gate = EvidenceGate(GateConfig())
    assert gate.correct(core, of_pair(core, np.full(6, 3.0), 1e-3)).outcome is GateOutcome.REJECTED
    assert core.mean is mean
    assert core.factor is factor
    assert gate.counts == {"feedback_rejected": 1}


def test_consistent_evidence_is_forced_after_rejections_in_a_row() -> None:
    core = random_filter(8, sigma=1e-3)
    gate = EvidenceGate(GateConfig(max_rejections=2))
    evidence = of_pair(core, np.array([0.0, 0.0, 0.0, 0.1, 0.0, 0.0]), 1e-3)
    outcomes = [gate.correct(core, evidence).outcome for _ in range(3)]
    assert outcomes == [GateOutcome.REJECTED, GateOutcome.REJECTED, GateOutcome.FORCED]
    assert se3.log(se3.inverse(evidence.T_world_end) @ _pair(core.mean)[1])[3] == pytest.approx(0.1, abs=0.01)
    assert gate.correct(core, evidence).outcome is GateOutcome.ACCEPTED


def test_an_acceptance_resets_the_count_of_rejections() -> None:
    core = random_filter(9, sigma=1e-3)
    gate = EvidenceGate(GateConfig(max_rejections=1))
    outlier, good = of_pair(core, np.full(6, 3.0), 1e-3), of_pair(core, np.zeros(6), 1.0)
    outcomes = [gate.correct(core, evidence).outcome for evidence in (outlier, good, outlier)]
    assert outcomes == [GateOutcome.REJECTED, GateOutcome.ACCEPTED, GateOutcome.REJECTED]


def test_evidence_without_information_is_empty() -> None:
    core = random_filter(10)
    nothing = replace(of_pair(core, np.zeros(6), 1.0), information=np.zeros((12, 12)), vector=np.zeros(12))
    assert EvidenceGate(GateConfig()).correct(core, nothing).outcome is GateOutcome.EMPTY
