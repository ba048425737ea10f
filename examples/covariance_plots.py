# SPDX-License-Identifier: BSD-3-Clause
"""Draw an estimate's errors within three sigma, and its sigmas over time (needs the extra viz).

``python examples/covariance_plots.py [RECORDING [MODE [FOLDER]]]``; without arguments on the bundled recording.
"""

import sys
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

import coclo_vio as cv


def main(path: str | Path | None = None, mode: str = "coclo", folder: str = "out") -> None:
    run = cv.run(path or cv.sample_path(), mode)
    Path(folder).mkdir(parents=True, exist_ok=True)
    run.plot("error_bands").savefig(Path(folder) / "error_bands.png")

    trajectory = run.estimates().trajectory
    assert trajectory.covariance is not None  # (N, 6, 6): right/local errors, rotation first
    sigma = np.sqrt(np.diagonal(trajectory.covariance, axis1=1, axis2=2))
    figure = Figure(figsize=(8.0, 5.0), layout="constrained")
    axes = figure.subplots(2, sharex=True)
    for column, label in enumerate(("roll", "pitch", "yaw")):
        axes[0].plot(trajectory.times_s, np.degrees(sigma[:, column]), label=label)
    for column, label in enumerate("xyz", start=3):
        axes[1].plot(trajectory.times_s, 1e3 * sigma[:, column], label=label)
    axes[0].set_ylabel("sigma of rotation (deg)")
    axes[1].set_ylabel("sigma of position (mm)")
    axes[1].set_xlabel("time (s)")
    for each in axes:
        each.legend(loc="upper left")
    figure.savefig(Path(folder) / "sigmas.png")
    print(f"error_bands.png and sigmas.png in {folder}; largest position sigma {1e3 * sigma[:, 3:].max():.1f} mm")


if __name__ == "__main__":
    main(*sys.argv[1:])
