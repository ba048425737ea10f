# SPDX-License-Identifier: BSD-3-Clause
"""A run folder as a rosbag: its estimators' odometry beside the ground truth, for Foxglove and RViz."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from coclo_vio.datasets.csv_table import CsvTable
from coclo_vio.datasets.rosbag.writing.result_writer import EstimatedTrajectory, write_result_bag
from coclo_vio.evaluation.evaluation import Evaluation
from coclo_vio.geometry import se3
from coclo_vio.runs.run_folder import read_estimates
from coclo_vio.values.arrays import Array

_ANGULAR_VELOCITY = tuple(f"angular_velocity_body_{axis}" for axis in "xyz")


def write_run_bag(path: Path, folder: Path, names: Sequence[str], evaluations: Mapping[str, Evaluation]) -> Path:
    """Write estimators of a run folder as a bag; ``map`` is the ground truth's world where there was an evaluation.

    Args:
        path: the bag, see ``write_result_bag``.
        folder: the run folder.
        names: its estimators; the first has the frames ``odom`` and ``base_link``.
        evaluations: by estimator.

    Returns:
        ``path``.

    Raises:
        DatasetError: a file of the run folder is missing or malformed, or the bag cannot be written.
    """
    tracks = []
    for name in names:
        trajectory = read_estimates(folder, name).trajectory
        tie = np.eye(4)
        if name in evaluations:
            tied = evaluations[name].estimate
            row = int(np.searchsorted(trajectory.stamps_ns, tied.stamps_ns[0]))
            tie = tied.T_world_body[0] @ se3.inverse(trajectory.T_world_body[row])
        tracks.append(EstimatedTrajectory(name, trajectory, _angular_velocity(folder / f"{name}_state.csv"), tie))
    reference = next((evaluations[name].reference for name in names if name in evaluations), None)
    if reference is not None:  # a tracker's clock, moved to the recording's, may begin before zero
        reference = reference.select(reference.stamps_ns >= 0)
    return write_result_bag(path, tracks, reference)


def _angular_velocity(path: Path) -> Array | None:
    """The column of angular velocity (N, 3) of a state file, rad/s, body axes; None where there is no file."""
    if not path.is_file():
        return None
    table = CsvTable.open(path)
    columns = [table.header.index(name) for name in _ANGULAR_VELOCITY]
    return np.array([row.numbers(columns) for row in table.rows()])
