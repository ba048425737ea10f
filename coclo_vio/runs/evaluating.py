# SPDX-License-Identifier: BSD-3-Clause
"""What is in a run folder, or in a TUM file, against ground truth."""

from pathlib import Path

from coclo_vio.datasets.read_report import STREAM_NAMES
from coclo_vio.evaluation.evaluate import EvaluationConfig, evaluate
from coclo_vio.evaluation.evaluation import Evaluation
from coclo_vio.runs import run_folder
from coclo_vio.values.errors import CocloError, DatasetError, EvaluationError
from coclo_vio.values.measurements import CameraImuSample, ImuSample
from coclo_vio.values.trajectory import GroundTruth, read_tum

_UP = (STREAM_NAMES[ImuSample], STREAM_NAMES[CameraImuSample])


def evaluate_run(
    folder: Path, config: EvaluationConfig, truth: GroundTruth | None = None
) -> tuple[dict[str, Evaluation], dict[str, str]]:
    """Every estimator of a run folder against ground truth.

    Args:
        folder: what ``run_all`` wrote.
        config: how to compare.
        truth: another ground truth than the run's own.

    Returns:
        The evaluations by estimator, and for those that could not be evaluated the reason.

    Raises:
        DatasetError: no run folder, or no ground truth.
    """
    run = run_folder.read_run_json(folder)
    truth = truth or run_folder.read_ground_truth(folder, run)
    if truth is None:
        raise DatasetError(f"{folder} has no ground truth; give one with `coclo-vio evaluate {folder} --vicon FILE`")
    evaluations: dict[str, Evaluation] = {}
    failures: dict[str, str] = {}
    for name, told in run["estimators"].items():
        try:
            estimate = run_folder.read_estimates(folder, name).trajectory
            recording = told.get("recording_ns") or run.get("recording_ns")
            evaluations[name] = evaluate(
                estimate,
                truth,
                config,
                recording_ns=None if recording is None else (recording[0], recording[1]),
                realtime_factor=told.get("realtime_factor"),
                is_gravity_aligned="sensors" not in told or any(sensor in _UP for sensor in told["sensors"]),
            )
        except CocloError as error:
            failures[name] = told.get("failure") or str(error)
    return evaluations, failures


def evaluate_tum(path: Path, config: EvaluationConfig, truth: GroundTruth | None) -> dict[str, Evaluation]:
    """One TUM trajectory against ground truth.

    Raises:
        EvaluationError: no ground truth was given, or the two cannot be compared.
        DatasetError: the file cannot be read.
    """
    estimate = read_tum(path)
    if truth is None:
        raise EvaluationError(f"{path} is a trajectory without ground truth; give one with --vicon FILE")
    return {path.stem: evaluate(estimate, truth, config)}
