# SPDX-License-Identifier: BSD-3-Clause
"""The recording that the package ships: the first fifteen seconds of the stairs trial, as a bag.

A Daisy stands, walks up to the stairs and sets its first feet on them. ``experiments.sample_maker`` makes it.
"""

from importlib import resources
from pathlib import Path

DURATION_S = 15.0
LENGTH_M = 0.6


def sample_path() -> Path:
    """The shipped bag."""
    return Path(str(resources.files("coclo_vio.datasets") / "sample_data" / "daisy_stairs.mcap"))
