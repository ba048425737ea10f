# SPDX-License-Identifier: BSD-3-Clause
"""Makes the recording that the package ships: ``python -m coclo_vio.experiments.sample_maker FILE``.

The same as ``coclo-vio simulate stairs --seed 1 --duration 15 --image-encoding jpeg --set camera.jpeg_quality=75``; a
test holds the shipped file to that.
"""

import shutil
import sys
import tempfile
from pathlib import Path

from coclo_vio.datasets.sample import DURATION_S
from coclo_vio.simulation.simulated_recording import simulate_recording, simulation_config

SEED = 1
JPEG_QUALITY = 75


def make_sample(path: Path, *, images: bool = True) -> Path:
    """Simulate the recording and write it to ``path``, over what is there, without its truth; returns ``path``.

    Raises:
        DatasetError: it cannot be written.
        SimulationError: what draws off screen is missing.
    """
    config = simulation_config("stairs", {"camera": {"encoding": "jpeg", "jpeg_quality": JPEG_QUALITY}})
    with tempfile.TemporaryDirectory() as scratch:
        made = Path(scratch) / path.name
        simulate_recording(made, "stairs", config, SEED, until_s=DURATION_S, images=images)
        shutil.move(made, path)
    return path


if __name__ == "__main__":
    make_sample(Path(sys.argv[1]))
