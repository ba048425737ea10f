# SPDX-License-Identifier: BSD-3-Clause
"""Frames that the filter remembers, and what is said of them from outside: taken, refused, and in the end believed."""

from dataclasses import replace

import numpy as np
import pytest

from coclo_vio.filter.config import FilterConfig
from coclo_vio.filter.evidence_gate import EvidenceGate, GateConfig, Outcome
from coclo_vio.filter.odometry import LegOdometryFilter
from coclo_vio.filter.remembered_poses import _as_seen, _pair, placed
from coclo_vio.filter.square_root_filter import SquareRootFilter
from coclo_vio.filter.state import POSITION, RATE, ROTATION, VELOCITY, State, StateLayout
from coclo_vio.geometry import se3, so3
from coclo_vio.robot.model import RobotModel
from coclo_vio.simulation.analytic import AnalyticTrial
from coclo_vio.values.arrays import Array
from coclo_vio.values.errors import FilterError
from coclo_vio.values.keyframes import PoseEvidence

LAYOUT = StateLayout(2, has_contacts=False, has_frame=True)
STEP = 1e-6


def random_filter(seed: int, sigma: float = 0.01) -> SquareRootFilter:
    """A filter whose errors all hang together; the cameras are turned and stretch a little."""
    random = np.random.default_rng(seed)
    vector = random.normal(size=LAYOUT.dimension)
    vector[LAYOUT.camera] = [0.01, -0.02, 0.015, 0.03]
    rotations = [so3.exp(random.normal(size=3)) for _ in range(4)]
    mean = State(LAYOUT, rotations[0], vector, *rotations[1:])
    mean._clear_rotations(vector)
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
def test_errors_of_a_pair_are_those_of_anchor_poses_and_eyes(seed: int) -> None:
    core = random_filter(seed)
    np.testing.assert_allclose(_pair(core.mean)[2], derivative(core), atol=2e-4)


def test_known_cameras_see_poses_as_they_are() -> None:
    T = se3.exp(np.array([0.1, 0.2, -0.3, 1.0, 2.0, 3.0]))
    seen, of_pose, _ = _as_seen(T, np.zeros(4))
    np.testing.assert_allclose(seen, T, atol=1e-15)
    np.testing.assert_allclose(of_pose, np.eye(6), atol=1e-15)


def test_what_eyes_see_is_placed_where_the_filter_has_it() -> None:
    core = random_filter(4)
    _, T_anchor_frame, _ = _pair(core.mean)
    T_world_frame, covariance = placed(core, T_anchor_frame, 1e-18 * np.eye(6))
    expected = se3.transform(core.mean.frame_rotation, core.mean.vector[LAYOUT.frame_position])
    np.testing.assert_allclose(T_world_frame, expected, atol=1e-12)
    assert np.linalg.eigvalsh(covariance)[0] > 0.0


def test_a_frame_between_samples_is_where_the_body_goes_by_then() -> None:
    """The pose, and how its errors hang together with all others, against finite differences."""
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
    marked = se3.transform(core.mean.frame_rotation, core.mean.vector[LAYOUT.frame_position])
    np.testing.assert_allclose(marked, before, atol=1e-12)
    to_frame = core.mean.frame_rotation.T
    local = np.zeros((6, LAYOUT.dimension))
    local[:3, LAYOUT.frame_rotation] = local[3:, LAYOUT.frame_position] = to_frame
    local[3:, LAYOUT.frame_rotation] = -to_frame @ so3.hat(core.mean.vector[LAYOUT.frame_position])
    now = local @ core.factor
    np.testing.assert_allclose(now @ now.T, rows @ rows.T, rtol=5e-3, atol=2e-8)
    np.testing.assert_allclose(core.factor[ROTATION] @ now.T, across, rtol=5e-3, atol=2e-8)


@pytest.mark.parametrize("away_m", [0.0, 20.0])
def test_an_unsure_turn_leaves_the_frame_where_it_is(away_m: float) -> None:
    """A body that may have turned by anything since the last sample has not moved for that, however far it is away."""
    core = random_filter(11, sigma=1e-3)
    core.mean.vector[POSITION] = (away_m, 0.0, 0.0)

    def spread() -> Array:
        at, R = core.mean.vector[LAYOUT.frame_position], core.mean.frame_rotation
        rows = (R.T @ (core.factor[LAYOUT.frame_position] - so3.hat(at) @ core.factor[LAYOUT.frame_rotation])).T
        return np.asarray(rows.T @ rows)

    core.mark_frame(0.0)
    before = spread()
    core.mark_frame(0.0, noise=(0.1, 0.0))
    np.testing.assert_allclose(spread(), before, atol=1e-9)
    assert np.sqrt(core.variance(LAYOUT.frame_rotation)).min() > 0.09


def test_a_filter_that_gives_in_makes_good_what_it_refused() -> None:
    core = random_filter(12, sigma=1e-3)
    gate = EvidenceGate(GateConfig(patience=1))
    step = of_pair(core, np.array([0.0, 0.0, 0.0, 0.1, 0.0, 0.0]), 1e-3)
    whole = of_pair(core, np.array([0.0, 0.0, 0.0, 0.3, 0.0, 0.0]), 1e-3)
    assert [gate.take(core, step, whole).outcome for _ in range(2)] == [Outcome.REFUSED, Outcome.GAVE_IN]
    assert se3.log(se3.inverse(step.T_world_end) @ _pair(core.mean)[1])[3] == pytest.approx(0.3, abs=0.02)


def of_pair(core: SquareRootFilter, shift: Array, sigma: float) -> PoseEvidence:
    """The frame is ``shift`` (6,) away from where the filter has it."""
    T_start, T_end, _ = _pair(core.mean)
    information = np.zeros((12, 12))
    information[6:, 6:] = np.eye(6) / sigma**2
    vector = information @ np.concatenate((np.zeros(6), shift))
    return PoseEvidence(0, 1, T_start, T_end, information, vector)


def test_evidence_moves_the_frame_to_where_it_says() -> None:
    core = random_filter(6)
    shift = np.array([1e-4, -2e-4, 1e-4, 1e-3, 2e-3, -1e-3])
    T_before = _pair(core.mean)[1]
    verdict = EvidenceGate(GateConfig()).take(core, of_pair(core, shift, 1e-6))
    assert verdict.outcome is Outcome.TAKEN
    assert verdict.rows == 6
    np.testing.assert_allclose(se3.log(se3.inverse(T_before) @ _pair(core.mean)[1]), shift, atol=2e-5)


def test_a_wild_result_changes_nothing_and_is_counted() -> None:
    core = random_filter(7, sigma=1e-3)
    mean, factor = core.mean, core.factor
    gate = EvidenceGate(GateConfig())
    assert gate.take(core, of_pair(core, np.full(6, 3.0), 1e-3)).outcome is Outcome.REFUSED
    assert core.mean is mean
    assert core.factor is factor
    assert gate.counts == {"feedback_refused": 1}


def test_a_filter_that_is_contradicted_again_and_again_gives_in() -> None:
    core = random_filter(8, sigma=1e-3)
    gate = EvidenceGate(GateConfig(patience=2))
    told = of_pair(core, np.array([0.0, 0.0, 0.0, 0.1, 0.0, 0.0]), 1e-3)
    outcomes = [gate.take(core, told).outcome for _ in range(3)]
    assert outcomes == [Outcome.REFUSED, Outcome.REFUSED, Outcome.GAVE_IN]
    assert se3.log(se3.inverse(told.T_world_end) @ _pair(core.mean)[1])[3] == pytest.approx(0.1, abs=0.01)
    assert gate.take(core, told).outcome is Outcome.TAKEN


def test_refusals_that_are_interrupted_do_not_add_up() -> None:
    core = random_filter(9, sigma=1e-3)
    gate = EvidenceGate(GateConfig(patience=1))
    wild, good = of_pair(core, np.full(6, 3.0), 1e-3), of_pair(core, np.zeros(6), 1.0)
    outcomes = [gate.take(core, one).outcome for one in (wild, good, wild)]
    assert outcomes == [Outcome.REFUSED, Outcome.TAKEN, Outcome.REFUSED]


def test_evidence_of_nothing_is_empty() -> None:
    core = random_filter(10)
    nothing = replace(of_pair(core, np.zeros(6), 1.0), information=np.zeros((12, 12)), vector=np.zeros(12))
    assert EvidenceGate(GateConfig()).take(core, nothing).outcome is Outcome.EMPTY


def test_evidence_has_to_be_of_the_frames_that_are_remembered(daisy: RobotModel, noisy_walk: AnalyticTrial) -> None:
    legs = LegOdometryFilter(daisy, FilterConfig(), remembers_frames=True)
    with pytest.raises(FilterError, match="not started"):
        legs.mark_frame(0)
    last = [estimate for estimate in map(legs.push, noisy_walk.measurements[:600]) if estimate is not None][-1]
    with pytest.raises(FilterError, match="mark_frame"):
        legs.keep_frame()
    legs.mark_frame(last.stamp_ns + 4_000_000)
    legs.anchor_frame()
    pair = legs.frame_pair()
    assert (pair.start_ns, pair.end_ns) == (last.stamp_ns + 4_000_000,) * 2
    np.testing.assert_allclose(pair.T_world_start, np.eye(4), atol=1e-12)
    told = PoseEvidence(1, 2, np.eye(4), np.eye(4), np.eye(12), np.zeros(12))
    with pytest.raises(FilterError, match="go together"):
        legs.take_evidence(told)


def test_a_filter_that_remembers_no_frames_says_so(daisy: RobotModel, noisy_walk: AnalyticTrial) -> None:
    legs = LegOdometryFilter(daisy)
    for measurement in noisy_walk.measurements[:600]:
        legs.push(measurement)
    with pytest.raises(FilterError, match="remembers_frames"):
        legs.mark_frame(0)


def test_remembering_frames_changes_no_estimate(daisy: RobotModel, noisy_walk: AnalyticTrial) -> None:
    plain, seeing = LegOdometryFilter(daisy), LegOdometryFilter(daisy, remembers_frames=True)
    for number, measurement in enumerate(noisy_walk.measurements[:900]):
        plain.push(measurement)
        other = seeing.push(measurement)
        if other is not None and number % 20 == 0:
            seeing.mark_frame(other.stamp_ns + 3_000_000)
            (seeing.anchor_frame if number % 100 == 0 else seeing.keep_frame)()
    np.testing.assert_allclose(plain.expected_pose(3_010_000_000), seeing.expected_pose(3_010_000_000), atol=1e-9)
