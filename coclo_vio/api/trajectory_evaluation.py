# SPDX-License-Identifier: BSD-3-Clause
"""Any trajectory against any ground truth."""

from pathlib import Path

from coclo_vio.api.run import load_ground_truth
from coclo_vio.evaluation.evaluate import EvaluationConfig
from coclo_vio.evaluation.evaluate import evaluate as evaluate_trajectory
from coclo_vio.evaluation.evaluation import Evaluation
from coclo_vio.runs.modes.registry import modes
from coclo_vio.values.trajectory import GroundTruth, Trajectory, read_tum


def evaluate(
    estimate: str | Path | Trajectory,
    ground_truth: str | Path | GroundTruth,
    *,
    config: EvaluationConfig | None = None,
) -> Evaluation:
    """Measure a trajectory of any program against ground truth.

    Args:
        estimate: TUM file or trajectory.
        ground_truth: TUM, EuRoC or mocap CSV file, or what ``load_ground_truth`` gives.
        config: clock, alignment and gaps; the defaults if None.

    Raises:
        DatasetError: a file cannot be read.
        EvaluationError: the two cannot be compared.
    """
    modes()  # whoever shows the result asks for the kinds of its trajectories
    trajectory = estimate if isinstance(estimate, Trajectory) else read_tum(Path(estimate))
    truth = ground_truth if isinstance(ground_truth, GroundTruth) else load_ground_truth(ground_truth)
    return evaluate_trajectory(trajectory, truth, config or EvaluationConfig())
