# SPDX-License-Identifier: BSD-3-Clause
"""The recording that the package ships: the first minute of the stairs trial, as a bag.

A Daisy stands, walks up to the stairs and climbs: 2.5 m, three of the five risers behind the middle of its body at the
end. ``experiments.sample_maker`` makes it; docs/simulation.md has how image size, rate and quality were chosen.
"""

from importlib import resources
from pathlib import Path

DURATION_S = 60.0
LENGTH_M = 2.5


def sample_path() -> Path:
    """The shipped bag."""
    return Path(str(resources.files("coclo_vio.datasets") / "sample_data" / "daisy_stairs.mcap"))
