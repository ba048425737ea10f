# SPDX-License-Identifier: BSD-3-Clause
"""What legged odometry has to keep on every machine: a short trot through the benchmark; real logs where they are."""

from collections.abc import Mapping
from pathlib import Path

import pytest

from coclo_vio.experiments.legged.legged_job import LeggedJob, recorded, run_legged_job
from coclo_vio.experiments.legged.legged_record import LeggedFigures, LeggedJobRecord
from coclo_vio.experiments.legged.legged_recording import LeggedRecording, LeggedRecordings, recordings_of
from coclo_vio.experiments.legged.smoother_mode import GTSAM_SMOOTHER
from coclo_vio.experiments.results.provenance import Provenance

pytestmark = pytest.mark.long

ORIGIN = Provenance(commit="abc1234", date="2026-01-02", machine="one", versions={}, command="a command")
SHORT = LeggedRecording(
    *("trot", "go1 flat 2 m", "go1", "flat", 11),
    trial={
        "stand_s": 1.0,
        "end_s": 0.5,
        "gait": {"distance_m": 2.0, "acceleration_mps2": 2.0},
        "joints": {"rate_hz": 250.0},  # half as many samples take half the time
        "imu": {"rate_hz": 250.0, "low_pass_hz": 100.0},
    },
)


def run(recording: LeggedRecording, estimators: tuple[str, ...], folder: Path) -> Mapping[str, LeggedJobRecord]:
    places = LeggedRecordings(folder)
    found = recorded(recording, places)
    return {name: run_legged_job(LeggedJob(recording, name), found, places, ORIGIN) for name in estimators}


def figures_of(record: LeggedJobRecord) -> LeggedFigures:
    (trajectory,) = record.trajectories.values()
    assert trajectory.failure is None
    assert trajectory.figures is not None
    return trajectory.figures


@pytest.fixture(scope="module")
def trot(tmp_path_factory: pytest.TempPathFactory) -> Mapping[str, LeggedJobRecord]:
    """Two metres of a Go1, which last 5.5 s, through two estimators."""
    return run(SHORT, ("coclo", "inekf"), tmp_path_factory.mktemp("legged"))


def test_a_short_trot_keeps_its_bounds(trot: Mapping[str, LeggedJobRecord]) -> None:
    ours, theirs = figures_of(trot["coclo"]), figures_of(trot["inekf"])
    assert ours.drift_percent is not None
    assert ours.anees_pose is not None
    assert ours.drift_percent < 9.0
    assert 0.1 < ours.anees_pose < 4.0
    assert theirs.drift_percent is not None
    assert theirs.anees_pose is not None
    assert theirs.drift_percent < 9.0
    assert theirs.anees_pose < 70.0


def test_the_covariance_of_coclo_covers_a_short_trot_better_than_that_of_inekf(
    trot: Mapping[str, LeggedJobRecord],
) -> None:
    ours, theirs = figures_of(trot["coclo"]), figures_of(trot["inekf"])
    assert (ours.anees_pose or 0.0) < 0.3 * (theirs.anees_pose or 0.0)


@pytest.mark.slow
def test_the_smoother_of_gtsam_follows_a_trot_without_claiming_a_covariance(tmp_path: Path) -> None:
    found = figures_of(run(SHORT, (GTSAM_SMOOTHER,), tmp_path)[GTSAM_SMOOTHER])
    assert found.drift_percent is not None
    assert found.drift_percent < 10.0
    assert found.anees_pose is None
    assert found.anees_1m is None
    assert found.coverage is not None
    assert found.coverage > 0.6


def test_a_job_has_its_cost_and_the_strength_of_impacts(trot: Mapping[str, LeggedJobRecord]) -> None:
    record = trot["inekf"]
    assert record.impacts is not None
    assert 1.0 < record.impacts.std_mps2 < record.impacts.peak_mps2 < 78.5
    assert record.cpu_ms_per_joint_sample is not None
    assert 0.05 < record.cpu_ms_per_joint_sample < 20.0
    assert record.not_recorded is None


@pytest.mark.slow
def test_the_real_logs_keep_their_bounds(shared_data: Path, tmp_path: Path) -> None:
    logs = {log.group: log for log in recordings_of([], data=shared_data)}
    go1 = run(logs["go1_mocap"], ("coclo", "inekf"), tmp_path)
    ours, theirs = figures_of(go1["coclo"]), figures_of(go1["inekf"])
    assert ours.ate_planar_m is not None
    assert theirs.ate_planar_m is not None
    assert ours.ate_planar_m < 0.2
    assert ours.ate_planar_m < theirs.ate_planar_m < 0.35
    icub = figures_of(run(logs["icub_sway"], ("coclo",), tmp_path)["coclo"])
    assert icub.drift_percent is not None
    assert icub.anees_pose is not None
    assert icub.drift_percent < 1.0
    assert icub.anees_pose < 2.0
