# SPDX-License-Identifier: BSD-3-Clause
"""Trajectories of a run folder and TUM files against ground truth."""

from pathlib import Path

import numpy as np
import pytest
from stand_in_modes import FAILURE

from coclo_vio.evaluation.evaluate import EvaluationConfig
from coclo_vio.runs import run_folder
from coclo_vio.runs.evaluating import evaluate_run, evaluate_tum
from coclo_vio.runs.run_config import resolve
from coclo_vio.runs.running import run_modes
from coclo_vio.values.errors import DatasetError, EvaluationError
from coclo_vio.values.trajectory import GroundTruth, Trajectory, write_tum

CONFIG = resolve("daisy")

pytestmark = pytest.mark.usefixtures("stand_ins")


@pytest.fixture(scope="module")
def naive_run(leg_log: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The walk through the mode naive; nothing in it is changed."""
    folder = tmp_path_factory.mktemp("naive")
    run_modes(leg_log, ["naive"], CONFIG, folder)
    return folder


def truth_of(folder: Path) -> GroundTruth:
    truth = run_folder.read_ground_truth(folder, run_folder.read_record(folder))
    assert truth is not None
    return truth


def test_a_body_at_rest_that_is_estimated_at_rest_has_no_error(film: Path, tmp_path: Path) -> None:
    run_modes(film, ["resting"], resolve(), tmp_path)
    evaluations, failures = evaluate_run(tmp_path, EvaluationConfig())
    assert failures == {}
    assert evaluations["resting"].ate_m == pytest.approx(0.0, abs=1e-9)


def test_a_trajectory_of_cameras_is_evaluated_over_their_time_and_aligned_without_gravity(
    film: Path, tmp_path: Path
) -> None:
    """The ground truth goes on for two seconds after the images; the mode has read no IMU."""
    run_modes(film, ["resting"], resolve(), tmp_path)
    evaluations, _ = evaluate_run(tmp_path, EvaluationConfig())
    assert evaluations["resting"].coverage == pytest.approx(1.0)
    assert evaluations["resting"].alignment == "se3"


def test_a_trajectory_of_legs_is_aligned_in_yaw_and_position(naive_run: Path) -> None:
    evaluations, _ = evaluate_run(naive_run, EvaluationConfig())
    assert evaluations["naive"].alignment == "yaw_position"


def test_half_a_run_covers_half_also_where_no_mode_read_the_rest(leg_log: Path, tmp_path: Path) -> None:
    run_modes(leg_log, ["failing"], CONFIG, tmp_path)
    evaluations, failures = evaluate_run(tmp_path, CONFIG.evaluation)
    assert failures == {}
    coverage = evaluations["failing"].coverage
    assert coverage is not None
    assert 0.2 < coverage < 0.5


def test_a_mode_without_any_estimate_has_its_failure_as_the_reason(leg_log: Path, tmp_path: Path) -> None:
    run_modes(leg_log, ["failing_at_once", "naive"], CONFIG, tmp_path)
    evaluations, failures = evaluate_run(tmp_path, CONFIG.evaluation)
    assert set(evaluations) == {"naive"}
    assert failures == {"failing_at_once": FAILURE}


def test_a_mode_that_could_not_start_has_what_it_lacks_as_the_reason(leg_log: Path, tmp_path: Path) -> None:
    run_modes(leg_log, ["naive", "resting"], CONFIG, tmp_path)
    evaluations, failures = evaluate_run(tmp_path, CONFIG.evaluation)
    assert (set(evaluations), set(failures)) == ({"naive"}, {"resting"})
    assert "has no stereo images" in failures["resting"]


def test_a_run_without_ground_truth_asks_for_one(leg_log: Path, tmp_path: Path) -> None:
    (tmp_path / "log").mkdir()
    (tmp_path / "log" / "leg_log.csv").write_bytes((leg_log / "leg_log.csv").read_bytes())
    run_modes(tmp_path / "log", ["naive"], CONFIG, tmp_path / "out")
    with pytest.raises(DatasetError, match=r"no ground truth; give one with .*--vicon FILE"):
        evaluate_run(tmp_path / "out", CONFIG.evaluation)


def test_another_ground_truth_can_be_given(naive_run: Path) -> None:
    own, _ = evaluate_run(naive_run, EvaluationConfig())
    truth = truth_of(naive_run)
    doubled = truth.trajectory.T_world_body.copy()
    doubled[:, :3, 3] *= 2.0
    other = GroundTruth(Trajectory(truth.trajectory.stamps_ns, doubled), True, "doubled")
    given, _ = evaluate_run(naive_run, EvaluationConfig(), other)
    assert given["naive"].path_length_m == pytest.approx(2.0 * own["naive"].path_length_m, rel=1e-6)


def test_a_tum_file_is_evaluated_under_its_name(naive_run: Path) -> None:
    alone = evaluate_tum(naive_run / "naive.tum", EvaluationConfig(), truth_of(naive_run))
    whole, _ = evaluate_run(naive_run, EvaluationConfig())
    assert alone["naive"].ate_m == pytest.approx(whole["naive"].ate_m, abs=1e-9)
    assert alone["naive"].anees_pose is None


def test_a_tum_file_needs_a_ground_truth_and_to_be_there(naive_run: Path) -> None:
    with pytest.raises(EvaluationError, match="trajectory without ground truth; give one with --vicon FILE"):
        evaluate_tum(naive_run / "naive.tum", EvaluationConfig(), None)
    with pytest.raises(DatasetError, match=r"missing\.tum"):
        evaluate_tum(naive_run / "missing.tum", EvaluationConfig(), None)


def test_the_ground_truth_against_itself_has_no_error(naive_run: Path, tmp_path: Path) -> None:
    truth = truth_of(naive_run)
    write_tum(truth.trajectory, tmp_path / "perfect.tum")
    perfect = evaluate_tum(tmp_path / "perfect.tum", EvaluationConfig(), truth)["perfect"]
    assert perfect.ate_m < 1e-4
    assert perfect.coverage == pytest.approx(1.0)
    assert np.isfinite(perfect.drift_percent)
