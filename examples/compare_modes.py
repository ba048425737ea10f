# SPDX-License-Identifier: BSD-3-Clause
"""Rank modes against ground truth: ``python examples/compare_modes.py [RECORDING [MODE,MODE... [FOLDER]]]``.

Without arguments: leg odometry, visual odometry and both combined on the bundled recording (up to two minutes).
An earlier comparison in the folder is replaced.
"""

import sys
from pathlib import Path

import coclo_vio as cv


def main(path: str | Path | None = None, modes: str = "coclo,vins,combined", folder: str = "out/compare_modes") -> None:
    recording = cv.open(path or cv.sample_path())
    comparison = cv.compare([recording], modes.split(","), output=folder, existing="overwrite")
    for name, compared in comparison.recordings.items():
        for trajectory, evaluation in compared.metrics.items():
            anees = "-" if evaluation.anees_pose is None else f"{evaluation.anees_pose:.2f}"
            print(f"{name}, {trajectory}: ATE {1e3 * evaluation.ate_m:.1f} mm, ANEES {anees}")
        for ranking in compared.rankings:
            print(ranking.sentence)
        for trajectory, reason in compared.failures.items():
            print(f"{trajectory} has no result: {reason}")
    print(f"report: {Path(folder) / 'report.html'}")


if __name__ == "__main__":
    main(*sys.argv[1:])
