# SPDX-License-Identifier: BSD-3-Clause
"""The whole evaluation: contract of its JSON, invariances, and what happens at the edges."""

import json
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from coclo_vio.evaluation.clock import ClockConfig
from coclo_vio.evaluation.evaluate import EvaluationConfig, evaluate
from coclo_vio.evaluation.evaluation import Evaluation
from coclo_vio.evaluation.evaluation_record import EvaluationRecord
from coclo_vio.geometry import se3, so3
from coclo_vio.values.errors import ConfigError, EvaluationError
from coclo_vio.values.trajectory import GroundTruth, Trajectory

NS = 1_000_000_000
IN_STEP = EvaluationConfig(clock=ClockConfig(offset_s=0.0))
KEYS = {
    "ate_m", "rpe_1m_percent", "drift_percent", "paper_drift_percent", "velocity_rmse_mps", "yaw_drift_deg",
    "path_length_m", "path_length_ratio", "coverage", "anees_pose", "realtime_factor", "ate_planar_m",
    "clock_offset_s", "clock_rate_hz", "clock_is_estimated", "alignment", "gaps",
}  # fmt: skip


def vicon(trajectory: Trajectory) -> GroundTruth:
    return GroundTruth(trajectory, True, "vicon")


def drifting(truth: Trajectory, seed: int) -> Trajectory:
    """The truth with 2 % of scale, a slow turn and a velocity, as an estimator would give it."""
    rng = np.random.default_rng(seed)
    turn = np.array([so3.about_z(0.002 * second) for second in truth.times_s])
    positions = 1.02 * truth.positions + np.cumsum(rng.normal(0.0, 1e-4, (len(truth), 3)), axis=0)
    velocity = np.gradient(positions, truth.times_s, axis=0)
    covariance = np.tile(1e-3 * np.eye(6), (len(truth), 1, 1))
    return Trajectory(truth.stamps_ns, se3.transform(turn @ truth.rotations, positions), velocity, covariance)


def written(evaluation: Evaluation) -> dict[str, object]:
    """The evaluation as it is written to ``compare.json``."""
    return EvaluationRecord.of(evaluation).to_json()


def numbers(values: dict[str, object]) -> dict[str, float]:
    return {key: value for key, value in values.items() if isinstance(value, float) and not key.startswith("clock")}


def test_a_perfect_estimate_has_no_error(walk):
    truth = walk(np.arange(0.0, 25.0, 0.01))
    result = evaluate(truth, vicon(truth), realtime_factor=12.5)
    values = written(result)
    assert values.keys() >= KEYS
    assert json.loads(json.dumps(values, allow_nan=False)) == values
    for key in ("ate_m", "ate_planar_m", "rpe_1m_percent", "drift_percent", "paper_drift_percent", "yaw_drift_deg"):
        assert values[key] == pytest.approx(0.0, abs=1e-6), key
    assert result.path_length_ratio == pytest.approx(1.0)
    assert result.coverage == 1.0
    assert result.realtime_factor == 12.5
    assert result.anees_pose is None
    assert result.velocity_source == "positions"
    assert result.velocity_rmse_mps == pytest.approx(0.0, abs=1e-6)
    assert result.start_tilt_deg == pytest.approx(0.0, abs=1e-6)


def test_scale_error_by_hand(line):
    velocity = np.tile([1.01, 0.0, 0.0], (1001, 1))
    result = evaluate(replace(line(10.0, scale=1.01), velocity_world=velocity), vicon(line(10.0)), IN_STEP)
    assert result.rpe_1m_percent == pytest.approx(1.0, abs=1e-6)
    assert result.path_length_ratio == pytest.approx(1.01)
    assert result.path_length_m == pytest.approx(10.0)
    # tied at the mean of the first second, half a metre along: 0.095 m of 10 m are left at the end
    assert result.drift_percent == pytest.approx(0.95, abs=1e-6)
    assert result.velocity_rmse_mps == pytest.approx(0.01, abs=1e-9)
    assert result.ate_m == pytest.approx(0.01 * np.sqrt(10.0**2 / 12.0), rel=2e-3)


def test_drift_over_segments_is_recorded_where_the_path_is_as_long(line):
    config = IN_STEP.model_copy(update={"segment_lengths_m": (2.5, 10.0, 100.0)})
    values = written(evaluate(line(20.0, scale=1.01), vicon(line(20.0)), config))
    assert {key for key in values if key.startswith("drift_")} == {
        *("drift_percent", "drift_2.5m_percent", "drift_10m_percent"),
    }
    assert values["drift_10m_percent"] == pytest.approx(1.0, abs=1e-6)
    assert "segment_drift_percent" not in values
    assert "drift_100m_percent" in written(evaluate(line(120.0, 100.0), vicon(line(120.0, 100.0)), IN_STEP))


@settings(max_examples=15, deadline=None, derandomize=True)
@given(yaw=st.floats(-3.1, 3.1), x=st.floats(-50, 50), y=st.floats(-50, 50), z=st.floats(-5, 5), seed=st.integers(0, 9))
def test_metrics_do_not_depend_on_where_either_world_lies(yaw, x, y, z, seed):
    rng = np.random.default_rng(seed)
    seconds = np.arange(0.0, 12.0, 0.02)
    heading = np.cumsum(rng.normal(0.0, 0.03, len(seconds)))
    speed = 0.5 * (seconds > 1.2)
    steps = speed[:, None] * np.stack((np.cos(heading), np.sin(heading), 0.1 * np.sin(seconds)), axis=1) * 0.02
    rotations = np.array([so3.about_z(angle) for angle in heading])
    truth = Trajectory(np.rint(seconds * 1e9).astype(np.int64), se3.transform(rotations, np.cumsum(steps, axis=0)))
    estimate = drifting(truth, seed)
    T_new_old = se3.transform(so3.about_z(yaw), np.array([x, y, z]))
    expected = numbers(written(evaluate(estimate, vicon(truth), IN_STEP)))
    assert expected["drift_percent"] > 0.1
    for each, other in ((estimate.moved(T_new_old), truth), (estimate, truth.moved(T_new_old))):
        assert numbers(written(evaluate(each, vicon(other), IN_STEP))) == pytest.approx(expected, abs=1e-6, rel=1e-6)


@settings(max_examples=8, deadline=None, derandomize=True)
@given(offset_ns=st.integers(-(10**12), 10**12))
def test_a_given_clock_offset_changes_nothing(offset_ns):
    seconds = np.arange(0.0, 10.0, 0.05)
    positions = np.stack((np.sin(seconds), np.cos(seconds), 0.1 * seconds), axis=1)
    rotations = np.array([so3.about_z(-second) for second in seconds])
    truth = Trajectory(np.rint(seconds * 1e9).astype(np.int64), se3.transform(rotations, positions))
    estimate = drifting(truth, 1)
    config = EvaluationConfig(clock=ClockConfig(offset_s=-offset_ns * 1e-9))
    result = evaluate(estimate, vicon(truth.restamped(truth.stamps_ns + offset_ns)), config)
    assert numbers(written(result)) == pytest.approx(numbers(written(evaluate(estimate, vicon(truth), IN_STEP))))


def test_estimated_clock_comes_close_to_the_given_one(walk):
    truth = walk(np.arange(0.0, 25.0, 0.01))
    estimate = drifting(truth, 2)
    late = replace(truth, stamps_ns=truth.stamps_ns + 3 * NS)
    result = evaluate(estimate, vicon(late))
    assert written(result)["clock_offset_s"] == pytest.approx(-3.0, abs=1e-3)
    assert result.ate_m == pytest.approx(evaluate(estimate, vicon(truth), IN_STEP).ate_m, abs=1e-3)
    assert any("estimated from angular speed" in note for note in result.notes)


def test_ground_truth_without_stamps_is_noted(walk):
    rows = -1.0 + np.arange(1500) / 57.0
    numbered = GroundTruth(walk(rows, 3).restamped(np.arange(1500) * 10_000_000), False, "mocap.csv")
    estimate = walk(np.arange(0.0, 24.0, 0.01), 3)
    result = evaluate(estimate, numbered, recording_ns=(0, 24 * NS))
    assert written(result)["clock_rate_hz"] == pytest.approx(57.0, abs=0.05)
    assert "no time stamps" in result.notes[0]
    assert result.coverage > 0.999
    assert evaluate(estimate, numbered).coverage == pytest.approx(24.0 / (1499 / 57.0), abs=0.01)
    assert result.ate_m < 0.01


def test_alignments_and_anees(walk):
    truth = walk(np.arange(0.0, 25.0, 0.01))
    estimate = drifting(truth, 4)
    tilted = estimate.moved(se3.exp(np.array([0.05, 0.0, 0.0, 0.0, 0.0, 0.0])))
    free, yaw = (
        evaluate(tilted, vicon(truth), EvaluationConfig(clock=ClockConfig(offset_s=0.0), alignment=kind))
        for kind in ("se3", "yaw_position")
    )
    assert free.ate_m < yaw.ate_m - 0.01
    assert yaw.start_tilt_deg == pytest.approx(np.degrees(0.05), abs=0.05)
    assert any("tilt by" in note for note in yaw.notes)
    assert evaluate(estimate, vicon(truth), IN_STEP).anees_pose > 0.0


def test_an_estimate_that_is_not_gravity_aligned_is_tied_in_attitude(walk):
    truth = walk(np.arange(0.0, 25.0, 0.01))
    estimate = drifting(truth, 4)
    tilted = estimate.moved(se3.transform(so3.exp(np.array([0.8, -0.4, 1.0])), np.array([3.0, 1.0, 2.0])))
    level = evaluate(estimate, vicon(truth), IN_STEP)
    free = evaluate(tilted, vicon(truth), IN_STEP, is_gravity_aligned=False)
    assert evaluate(tilted, vicon(truth), IN_STEP).drift_percent > 10.0
    assert free.drift_percent == pytest.approx(level.drift_percent, abs=0.2)
    assert free.rpe_1m_percent == pytest.approx(level.rpe_1m_percent, abs=1e-6)
    assert free.ate_m <= level.ate_m
    assert free.alignment == "se3"
    assert free.start_tilt_deg == pytest.approx(0.0, abs=0.1)
    assert any(note.startswith("The estimate is not gravity-aligned") for note in free.notes)


def test_mounting_of_the_markers_can_be_taken_out(walk):
    truth = walk(np.arange(0.0, 25.0, 0.01))
    mounted = se3.transform(so3.exp(np.array([0.0, 0.05, 0.0])), np.zeros(3))
    tracked = replace(truth, T_world_body=truth.T_world_body @ mounted)
    given_ = evaluate(truth, vicon(tracked), IN_STEP)
    levelled = evaluate(truth, vicon(tracked), IN_STEP.model_copy(update={"body_rotation": "start"}))
    assert given_.rpe_1m_percent == pytest.approx(5.0, abs=0.5)
    assert levelled.rpe_1m_percent == pytest.approx(0.0, abs=1e-3)
    assert levelled.ate_m == given_.ate_m
    by_all = evaluate(truth, vicon(tracked), IN_STEP.model_copy(update={"body_rotation": "mean"}))
    assert by_all.rpe_1m_percent == pytest.approx(0.0, abs=0.01)
    assert by_all.drift_percent == pytest.approx(given_.drift_percent, abs=0.01)


def test_times_of_rows_without_stamps_have_a_noise_by_the_attitude_that_the_clock_leaves_unexplained(walk):
    """Rows whose interval jitters slowly by 30 ms: NEES of an exact estimate counts them, for numbered rows only."""
    truth = walk(np.arange(0.0, 25.0, 0.01))
    certain = replace(truth, covariance=np.tile(1e-6 * np.eye(6), (len(truth), 1, 1)))
    even_s = np.arange(0.0, 24.9, 1.0 / 57.0)
    jittered = walk(even_s + 0.03 * np.sin(0.9 * even_s))
    numbered = GroundTruth(jittered.restamped(np.arange(len(jittered)) * 10_000_000), False, "rows")
    result = evaluate(certain, numbered)
    stamped = evaluate(certain, vicon(jittered.restamped(np.round(even_s * 1e9).astype(np.int64))), IN_STEP)
    assert result.clock.residual_deg > 0.2
    assert stamped.anees_pose > 10.0 * result.anees_pose
    assert result.anees_pose < 3.0


def test_holes_are_counted_and_not_bridged(walk):
    truth = walk(np.arange(0.0, 25.0, 0.01))
    holed = truth.select((truth.times_s < 10.0) | (truth.times_s > 12.0))
    result = evaluate(truth, vicon(holed), IN_STEP)
    assert (result.gaps.ground_truth_holes, result.gaps.estimate_holes) == (1, 0)
    assert result.gaps.poses_in_holes == pytest.approx(200, abs=1)
    assert result.ate_m == pytest.approx(0.0, abs=1e-9)
    result = evaluate(holed, vicon(truth), IN_STEP)
    assert (result.gaps.ground_truth_holes, result.gaps.estimate_holes) == (0, 1)
    assert result.coverage == pytest.approx(23.0 / 25.0, abs=0.01)


def test_one_pose_is_an_error(walk, line):
    one = line(1.0).select(np.array([3]))
    with pytest.raises(EvaluationError, match="the estimate has 1"):
        evaluate(one, vicon(line(1.0)))
    with pytest.raises(EvaluationError, match="vicon has 1"):
        evaluate(line(1.0), vicon(one))


def test_two_poses_give_numbers_or_nothing(line):
    two = line(1.0).select(np.array([3, 7]))
    values = written(evaluate(two, vicon(line(1.0))))
    assert values["rpe_1m_percent"] is None
    assert values["velocity_rmse_mps"] is None
    assert values["ate_m"] == pytest.approx(0.0, abs=1e-12)
    assert json.dumps(values, allow_nan=False)


def test_no_overlap_is_an_error(line):
    late = line(1.0).restamped(line(1.0).stamps_ns + 3600 * NS)
    with pytest.raises(EvaluationError, match="clock offset"):
        evaluate(late, vicon(line(1.0)))


def test_a_robot_that_stands_has_no_relative_errors(line):
    values = written(evaluate(line(0.0), vicon(line(0.0))))
    for key in ("rpe_1m_percent", "drift_percent", "paper_drift_percent", "path_length_ratio", "anees_pose"):
        assert values[key] is None, key
    assert values["ate_m"] == 0.0
    assert values["clock_is_estimated"] is False
    assert any("hardly turns" in note for note in values["notes"])


def test_unknown_values_and_keys_of_the_configuration_are_refused():
    with pytest.raises(ConfigError, match="alignment"):
        EvaluationConfig.parse({"alignment": "sim3"}, "run.yaml")
    with pytest.raises(ConfigError, match="window_s"):
        EvaluationConfig.parse({"clock": {"windows_s": 1.0}}, "run.yaml")
