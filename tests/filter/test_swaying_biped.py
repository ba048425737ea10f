# SPDX-License-Identifier: BSD-3-Clause
"""A real biped that sways on both flat feet, with motion capture: drift, path and consistency of every estimator."""

from pathlib import Path

import pytest

from coclo_vio.api.comparison import compare

RECORDING = Path(__file__).parents[3] / "shared" / "data" / "icub_sway"


@pytest.mark.skipif(not RECORDING.is_dir(), reason="the recordings in ../shared/data are not on this machine")
def test_a_real_biped_that_sways_is_followed(tmp_path: Path) -> None:
    pass
