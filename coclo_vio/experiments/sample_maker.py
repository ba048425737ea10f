# SPDX-License-Identifier: BSD-3-Clause
"""Makes the recording that the package ships: ``python -m coclo_vio.experiments.sample_maker FILE``.

The same as ``coclo-vio simulate stairs --seed 1 --duration 60 --image-encoding jpeg --set camera.jpeg_quality=40 --set
trial.frame_rate_hz=7.5``; a test holds the shipped file to that.
"""

import shutil
import sys
import tempfile
from pathlib import Path

from coclo_vio.datasets.sample import DURATION_S
from coclo_vio.simulation.simulated_recording import simulate_recording, simulation_config

SEED = 1
FRAME_RATE_HZ = 7.5
JPEG_QUALITY = 40


def make_sample(path: Path, *, images: bool = True, until_s: float = DURATION_S) -> Path:
    """Simulate the recording and write it to ``path``, over what is there, without its truth; returns ``path``.

    Args:
        path: of the recording, ending in ``.mcap``.
        images: whether the cameras record.
        until_s: cut the trial short after so many seconds. Up to there the robot moves as in the whole recording and
            the images are the same; the noise of joints and IMUs differs, for it is drawn by the recording's length.

    Raises:
        DatasetError: it cannot be written.
        SimulationError: what draws off screen is missing.
    """
    settings = {
        "trial": {"frame_rate_hz": FRAME_RATE_HZ},
        "camera": {"encoding": "jpeg", "jpeg_quality": JPEG_QUALITY},
    }
    config = simulation_config("stairs", settings)
    with tempfile.TemporaryDirectory() as scratch:
        made = Path(scratch) / path.name
        simulate_recording(made, "stairs", config, SEED, until_s=until_s, images=images)
        shutil.move(made, path)
    return path


if __name__ == "__main__":
    make_sample(Path(sys.argv[1]))
