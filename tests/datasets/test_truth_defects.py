# SPDX-License-Identifier: BSD-3-Clause
import numpy as np
import pytest

from coclo_vio.datasets.columns import ColumnNames
from coclo_vio.datasets.ground_truth import LOST, read_ground_truth
from coclo_vio.datasets.read_report import ReadTally
from coclo_vio.datasets.truth_defects import jumping_poses, lost_poses

_STAMPS_NS = np.arange(100) * 10_000_000


def _walk() -> np.ndarray:
    return np.linspace([1.0, 0.5, 0.3], [1.5, 0.5, 0.3], 100)


def test_zeros_between_poses_are_lost_ones() -> None:
    positions = _walk()
    positions[[0, 1, 40, 41, 99]] = 0.0
    assert np.flatnonzero(lost_poses(positions)).tolist() == [0, 1, 40, 41, 99]


def test_a_walk_that_starts_at_the_origin_or_crosses_it_loses_nothing() -> None:
    from_origin = _walk() - _walk()[0]
    assert not lost_poses(from_origin).any()
    far_apart = np.linspace([0.0, 0.0, 0.0], [500.0, 0.0, 0.0], 100)
    assert not lost_poses(far_apart).any()
    assert not lost_poses(np.zeros((5, 3))).any()


def test_poses_that_jump_away_and_back_are_named() -> None:
    positions = _walk()
    positions[20] += [0.0, 5.0, 0.0]
    positions[60:64] += [0.0, 0.0, 3.0]
    positions[0] += [2.0, 0.0, 0.0]
    assert np.flatnonzero(jumping_poses(_STAMPS_NS, positions)).tolist() == [0, 20, 60, 61, 62, 63]


def test_a_fast_walk_does_not_jump() -> None:
    assert not jumping_poses(_STAMPS_NS, 8.0 * _walk()).any()


@pytest.mark.parametrize(("factor", "name"), [(1e3, "milliseconds"), (1e6, "microseconds"), (1e9, "nanoseconds")])
def test_stamps_of_a_tum_file_in_another_unit_are_read_with_a_note(tmp_path, factor: float, name: str) -> None:
    path = tmp_path / "groundtruth.tum"
    lines = [f"{round((1_700_000_000 + 0.5 * i) * factor)} {0.1 * i} 0 0.3 0 0 0 1" for i in range(4)]
    path.write_text("# a comment\n" + "\n".join(lines) + "\n")
    tally = ReadTally("test", 0.1)
    truth = read_ground_truth(path, ColumnNames(), tally)
    assert truth.trajectory.stamps_ns.tolist() == [1_700_000_000_000_000_000 + 500_000_000 * i for i in range(4)]
    assert any(name in note for note in tally.report().notes)


def test_lost_poses_are_left_out_of_a_file_and_counted(tmp_path) -> None:
    path = tmp_path / "groundtruth.tum"
    rows = _walk()
    rows[30:35] = 0.0
    path.write_text("\n".join(f"{0.01 * i:.2f} {x} {y} {z} 0 0 0 1" for i, (x, y, z) in enumerate(rows)))
    tally = ReadTally("test", 0.1)
    assert len(read_ground_truth(path, ColumnNames(), tally).trajectory) == 95
    assert tally.report().dropped[LOST] == 5
