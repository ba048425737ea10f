# SPDX-License-Identifier: BSD-3-Clause
"""The filter on a real robot: a Go1 trotting round a square, against motion capture without time stamps.

The figures of the issue: coverage, length of the path, planar ATE. Nothing is fitted to the motion capture; naive leg
odometry on the same feet shows what the filter adds.
"""

from pathlib import Path

import pytest

from coclo_vio.evaluation.evaluation import Evaluation
from coclo_vio.runs.evaluating import evaluate_run
from coclo_vio.runs.run_config import resolve
from coclo_vio.runs.running import run_modes

pytestmark = pytest.mark.slow  # three modes over the whole log


@pytest.fixture(scope="module")
def evaluations(shared_data: Path, tmp_path_factory: pytest.TempPathFactory) -> dict[str, Evaluation]:
    folder = tmp_path_factory.mktemp("go1")
    config = resolve("go1")
    run_modes(shared_data / "go1_mocap", ["naive", "coclo", "coclo_paper"], config, folder)
    found, failures = evaluate_run(folder, config.evaluation)
    assert not failures
    return found


def test_the_filter_covers_the_whole_recording(evaluations: dict[str, Evaluation]) -> None:
    coverage = evaluations["coclo"].coverage
    assert coverage is not None
    assert coverage >= 0.98


def test_the_path_is_as_long_as_the_robots(evaluations: dict[str, Evaluation]) -> None:
    ratio = evaluations["coclo"].path_length_ratio
    assert ratio is not None
    assert 0.95 <= ratio <= 1.05


def test_the_filter_stays_on_the_robots_path(evaluations: dict[str, Evaluation]) -> None:
    assert evaluations["coclo"].ate_planar_m <= 0.15


def test_the_filter_is_better_than_naive_leg_odometry_and_the_papers_profile(
    evaluations: dict[str, Evaluation],
) -> None:
    assert evaluations["coclo"].ate_planar_m < 0.6 * evaluations["naive"].ate_planar_m
    assert evaluations["coclo"].ate_planar_m < evaluations["coclo_paper"].ate_planar_m


def test_height_does_not_jump(evaluations: dict[str, Evaluation]) -> None:
    """Shocks taken for gravity once tilted the body and threw its height about by 0.1 m from sample to sample."""
    height = evaluations["coclo"].estimate.positions[:, 2]
    assert abs(height[1:] - height[:-1]).max() < 0.01


def test_the_rate_of_the_motion_capture_is_the_one_found_independently(evaluations: dict[str, Evaluation]) -> None:
    """57.8 Hz from 1.634 s before the log, found independently by a fit of yaw."""
    clock = evaluations["coclo"].clock
    assert clock.rate_hz == pytest.approx(57.8, abs=0.3)
