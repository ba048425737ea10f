# SPDX-License-Identifier: BSD-3-Clause
"""Measure the trajectory of any program: ``python examples/evaluate_tum.py [ESTIMATE.tum GROUND_TRUTH]``.

Without arguments: the ground truth of the bundled recording against a copy that is 2 % too long and turns by 1 deg.
"""

import sys
import tempfile
from pathlib import Path

import numpy as np

import coclo_vio as cv
from coclo_vio.geometry import so3


def write_example(folder: Path) -> tuple[Path, Path]:
    """Write an estimate with known errors and its ground truth as TUM files."""
    truth = cv.open(cv.sample_path()).ground_truth()
    assert truth is not None
    wrong = truth.trajectory.T_world_body.copy()
    wrong[:, :3, 3] *= 1.02
    wrong[:, :3, :3] = so3.exp(np.outer(np.linspace(0.0, np.radians(1.0), len(wrong)), [0, 0, 1])) @ wrong[:, :3, :3]
    cv.write_tum(cv.Trajectory(truth.trajectory.stamps_ns, wrong), folder / "estimate.tum")
    cv.write_tum(truth.trajectory, folder / "vicon.tum")
    return folder / "estimate.tum", folder / "vicon.tum"


def main(estimate: str | None = None, ground_truth: str | None = None) -> None:
    with tempfile.TemporaryDirectory() as folder:
        files = (estimate, ground_truth) if estimate and ground_truth else write_example(Path(folder))
        result = cv.evaluate(*files)
    print(f"ATE {result.ate_m:.4f} m, heading off by {result.yaw_drift_deg:.2f} deg at the end")
    print(f"path length {result.path_length_estimate_m:.3f} m of {result.path_length_m:.3f} m")
    print(f"clock offset {result.clock.offset_s:+.3f} s; notes: {'; '.join(result.notes)}")


if __name__ == "__main__":
    main(*sys.argv[1:])
