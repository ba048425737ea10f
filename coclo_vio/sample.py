# SPDX-License-Identifier: BSD-3-Clause
"""The recording that the package ships: the first fifteen seconds of the stairs trial, as a bag.

A Daisy stands, walks up to the stairs and sets its first feet on them. ``python -m coclo_vio.sample FILE`` makes it
anew, as ``coclo-vio simulate stairs --seed 1 --duration 15 --image-encoding jpeg --set camera.jpeg_quality=75`` does; a
test holds the shipped file to that.
"""

import shutil
import sys
import tempfile
from importlib import resources
from pathlib import Path

SEED = 1
DURATION_S = 15.0
JPEG_QUALITY = 75


def sample_path() -> Path:
    """The shipped bag."""
    return Path(str(resources.files("coclo_vio") / "sample_data" / "daisy_stairs.mcap"))


def make_sample(path: Path, *, images: bool = True) -> Path:
    """Simulate the recording and write it to ``path``, over what is there, without its truth; returns ``path``.

    Raises:
        DatasetError: it cannot be written.
        SimulationError: what draws off screen is missing.
    """
    from coclo_vio.simulated_recording import simulate_recording, simulation_config  # noqa: PLC0415 -- an extra

    config = simulation_config("stairs", {"camera": {"encoding": "jpeg", "jpeg_quality": JPEG_QUALITY}})
    with tempfile.TemporaryDirectory() as scratch:
        made = Path(scratch) / path.name
        simulate_recording(made, "stairs", config, SEED, until_s=DURATION_S, images=images)
        shutil.move(made, path)
    return path


if __name__ == "__main__":
    make_sample(Path(sys.argv[1]))
