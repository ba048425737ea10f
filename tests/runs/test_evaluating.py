# SPDX-License-Identifier: BSD-3-Clause
"""The trajectories of a run folder against ground truth."""

from pathlib import Path

import pytest
from stand_in_modes import FAILURE

from coclo_vio.evaluation.evaluate import EvaluationConfig, evaluate
from coclo_vio.runs import run_folder
from coclo_vio.runs.evaluating import evaluate_run, evaluation_config
from coclo_vio.runs.run_config import resolve
from coclo_vio.runs.running import run_modes
from coclo_vio.values.config import write_yaml
from coclo_vio.values.errors import ConfigError, DatasetError
from coclo_vio.values.trajectory import GroundTruth, Trajectory, read_tum, write_tum

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


def test_the_trajectory_alone_has_the_same_error_and_no_consistency(naive_run: Path) -> None:
    alone = evaluate(read_tum(naive_run / "naive.tum"), truth_of(naive_run), EvaluationConfig())
    whole, _ = evaluate_run(naive_run, EvaluationConfig())
    assert alone.ate_m == pytest.approx(whole["naive"].ate_m, abs=1e-9)
    assert alone.anees_pose is None
    assert whole["naive"].anees_pose is not None


def test_the_ground_truth_against_itself_has_no_error(naive_run: Path, tmp_path: Path) -> None:
    truth = truth_of(naive_run)
    write_tum(truth.trajectory, tmp_path / "perfect.tum")
    perfect = evaluate(read_tum(tmp_path / "perfect.tum"), truth, EvaluationConfig())
    assert perfect.ate_m < 1e-4
    assert perfect.coverage == pytest.approx(1.0)


def test_a_trajectory_without_any_estimate_is_a_failure_that_gives_the_reason(film: Path, tmp_path: Path) -> None:
    """The mode went through, but no image was left for it."""
    run_modes(film, ["resting"], resolve(settings=["faults.frame_loss=1.0"]), tmp_path)
    evaluations, failures = evaluate_run(tmp_path, EvaluationConfig())
    assert (evaluations, failures) == ({}, {"resting": "it has no estimate"})


def test_the_configuration_of_an_evaluation_is_that_of_the_run_with_settings(tmp_path: Path) -> None:
    assert evaluation_config(None) == evaluation_config(tmp_path / "missing.yaml") == EvaluationConfig()
    file = tmp_path / "config.yaml"
    write_yaml(resolve("daisy", settings=["evaluation.alignment=se3", "evaluation.start_window_s=2"]), file)
    config = evaluation_config(file, ["evaluation.start_window_s=3"])
    assert (config.alignment, config.start_window_s) == ("se3", 3.0)
    with pytest.raises(ConfigError, match=r"config\.yaml: there is no algnment; the keys there are: .*alignment"):
        evaluation_config(file, ["evaluation.algnment=se3"])


def test_a_run_with_a_contact_estimator_of_a_plugin_can_be_evaluated_without_it(
    naive_run: Path, tmp_path: Path
) -> None:
    """Of the configuration only the section ``evaluation`` is read."""
    text = (naive_run / "config.yaml").read_text(encoding="utf-8")
    (tmp_path / "config.yaml").write_text(text.replace("method: hysteresis", "method: of_a_plugin"), encoding="utf-8")
    assert "of_a_plugin" in (tmp_path / "config.yaml").read_text(encoding="utf-8")
    assert evaluation_config(tmp_path / "config.yaml") == CONFIG.evaluation
