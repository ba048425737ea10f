# SPDX-License-Identifier: BSD-3-Clause
"""The shipped recording is the one that the generator makes."""

from pathlib import Path

import numpy as np

from coclo_vio.datasets.dataset import guess_robot, open_dataset
from coclo_vio.robot.description import load_robot
from coclo_vio.sample import TRIAL, make_sample, sample_path


def _numbers(path: Path, delimiter: str | None, skipped: int) -> np.ndarray:
    return np.loadtxt(path, delimiter=delimiter, skiprows=skipped)


def test_the_shipped_files_are_what_the_generator_makes(tmp_path: Path) -> None:
    """To 1e-9, as another C library may round sines otherwise; header and stamps to the letter."""
    made = make_sample(tmp_path)
    assert made == tmp_path / "leg_log.csv"
    assert {path.name for path in sample_path().iterdir()} == {path.name for path in tmp_path.iterdir()}
    shipped = sample_path() / "leg_log.csv"
    ours, theirs = (path.read_text(encoding="ascii").splitlines() for path in (made, shipped))
    assert ours[0] == theirs[0]
    assert [line.partition(",")[0] for line in ours] == [line.partition(",")[0] for line in theirs]
    np.testing.assert_allclose(_numbers(shipped, ",", 1), _numbers(made, ",", 1), rtol=1e-9, atol=1e-9)
    truths = [_numbers(folder / "groundtruth.tum", None, 0) for folder in (sample_path(), tmp_path)]
    np.testing.assert_allclose(truths[0], truths[1], rtol=1e-9, atol=1e-9)


def test_it_opens_as_a_recording_of_daisy_with_ground_truth() -> None:
    assert guess_robot(sample_path()) == "daisy"
    dataset = open_dataset(sample_path(), load_robot("daisy"))
    assert sum(1 for _ in dataset.measurements()) == 3 * 1001
    truth = dataset.ground_truth()
    assert truth is not None
    assert truth.has_stamps
    assert truth.trajectory.duration_s == TRIAL.body.duration_s == 10.0
