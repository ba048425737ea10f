# SPDX-License-Identifier: BSD-3-Clause
"""A real biped that sways on both flat feet, with motion capture: 0.5 m of path, a quarter of it stamped on arrival."""

from pathlib import Path

import pytest

import coclo_vio as cv

MODES = ("coclo", "inekf", "naive_rolling")
WITHIN_M, WITHIN_PERCENT = 0.008, 2.0


@pytest.mark.long
def test_a_real_biped_that_sways_is_followed(shared_data: Path) -> None:
    folder = shared_data / "icub_sway"
    metrics = cv.compare(cv.open(folder, robot=folder / "icub.yaml"), modes=MODES).metrics["icub_sway"]
    for name in MODES:
        found = metrics[name]
        assert found.drift_percent is not None
        assert found.drift_percent < WITHIN_PERCENT or found.ate_m < WITHIN_M, name
        assert found.path_length_ratio is not None
        assert 0.8 < found.path_length_ratio < 1.2, name
    assert metrics["coclo"].drift_percent < 1.0
    assert metrics["coclo"].anees_pose < 2.0
    assert abs(metrics["coclo"].yaw_drift_deg) < 0.2
