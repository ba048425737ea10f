# SPDX-License-Identifier: BSD-3-Clause
import numpy as np
import pytest

from coclo_vio.datasets.columns import ColumnNames
from coclo_vio.datasets.ground_truth import UNSTAMPED_PERIOD_NS, read_ground_truth, tum_files
from coclo_vio.datasets.read_report import ReadTally
from coclo_vio.geometry import so3
from coclo_vio.values.errors import DatasetError, TimestampError

QUARTER = "0,0,0.7071067811865476,0.7071067811865476"


@pytest.fixture
def read(tmp_path):
    def read_lines(*lines, name="mocap.csv"):
        path = tmp_path / name
        path.write_text("\n".join(lines) + "\n")
        tally = ReadTally("test", 0.1)
        return read_ground_truth(path, ColumnNames(), tally), tally

    return read_lines


def test_columns_are_taken_by_name_in_any_order(read):
    truth, tally = read("qw,qx,qy,qz,z,y,x,time_s", "0.7071067811865476,0,0,0.7071067811865476,3,2,1,12.5")
    assert truth.has_stamps
    assert truth.trajectory.stamps_ns[0] == 12_500_000_000
    np.testing.assert_array_equal(truth.trajectory.positions[0], [1, 2, 3])
    assert so3.yaw(truth.trajectory.rotations)[0] == pytest.approx(np.pi / 2)
    assert tally.notes == []


def test_a_header_whose_names_repeat_is_read_by_position_and_that_is_noted(read):
    truth, tally = read("px,py,pz,px,py,pz,pw", f"1,2,3,{QUARTER}", f"2,2,3,{QUARTER}")
    assert not truth.has_stamps
    assert so3.yaw(truth.trajectory.rotations)[0] == pytest.approx(np.pi / 2)
    np.testing.assert_array_equal(truth.trajectory.stamps_ns, [0, UNSTAMPED_PERIOD_NS])
    assert any("in that order" in note for note in tally.notes)
    assert any("no stamps" in note for note in tally.notes)


def test_a_pose_that_is_missing_keeps_its_place_in_time(read):
    truth, tally = read("x,y,z,qx,qy,qz,qw", "0,0,0,0,0,0,1", "nan,0,0,0,0,0,1", "2,0,0,0,0,0,1")
    np.testing.assert_array_equal(truth.trajectory.stamps_ns, [0, 2 * UNSTAMPED_PERIOD_NS])
    assert tally.dropped == {"ground truth: pose empty or NaN": 1}


def test_stamps_that_repeat_or_go_back_are_dropped_and_counted(read):
    rows = [f"{stamp},0,0,0,0,0,0,1" for stamp in (1, 2, 2, 1, 3)]
    truth, tally = read("stamp_ns,x,y,z,qx,qy,qz,qw", *rows)
    np.testing.assert_array_equal(truth.trajectory.stamps_ns, [1, 2, 3])
    assert tally.dropped == {"ground truth: stamp repeated or out of order": 2}


def test_a_quaternion_that_is_not_a_unit_is_refused(read):
    with pytest.raises(DatasetError, match=r"pose 2: the quaternion has norm 3\.742, not 1"):
        read("x,y,z,qx,qy,qz,qw", "0,0,0,0,0,0,1", "0,0,1,0,1,2,3")


def test_columns_that_are_not_a_pose_are_listed(read):
    with pytest.raises(DatasetError, match="from the columns alpha, beta"):
        read("alpha,beta", "1,2")


def test_a_file_without_a_pose_is_refused(read):
    with pytest.raises(TimestampError, match="no complete pose"):
        read("x,y,z,qx,qy,qz,qw")


def test_euroc_ground_truth_has_velocity_and_scalar_first_quaternions(read):
    header = "#timestamp, p_RS_R_x [m], p_RS_R_y [m], p_RS_R_z [m], q_RS_w [], q_RS_x [], q_RS_y [], q_RS_z [],"
    header += " v_RS_R_x [m s^-1], v_RS_R_y [m s^-1], v_RS_R_z [m s^-1], b_w_RS_S_x [rad s^-1]"
    truth, _ = read(header, "1403636580838555648,1,2,3,0.7071067811865476,0,0,0.7071067811865476,4,5,6,0.1")
    assert truth.trajectory.stamps_ns[0] == 1403636580838555648
    assert so3.yaw(truth.trajectory.rotations)[0] == pytest.approx(np.pi / 2)
    np.testing.assert_array_equal(truth.trajectory.velocity_world, [[4, 5, 6]])


POSE = f"1 2 3 {QUARTER.replace(',', ' ')}"
TUM = ("# time x y z qx qy qz qw", "", f"1.5 {POSE}", f"1.6 {POSE}")


@pytest.mark.parametrize("name", ["stamped_groundtruth.txt", "poses.csv", "x.tum", "truth"])
def test_tum_lines_are_read_under_any_name(read, name):
    truth, _ = read(*TUM, name=name)
    np.testing.assert_array_equal(truth.trajectory.stamps_ns, [1_500_000_000, 1_600_000_000])
    assert so3.yaw(truth.trajectory.rotations)[0] == pytest.approx(np.pi / 2)


def test_of_several_tum_files_those_named_as_ground_truth_are_taken(tmp_path):
    text = "\n".join(TUM) + "\n"
    (tmp_path / "notes.txt").write_text("not a trajectory\n")
    (tmp_path / "a.txt").write_text(text)
    assert [path.name for path in tum_files(tmp_path)] == ["a.txt"]
    (tmp_path / "b.tum").write_text(text)
    assert tum_files(tmp_path) == []  # none is named, and two could be meant
    (tmp_path / "stamped_groundtruth.txt").write_text(text)
    assert [path.name for path in tum_files(tmp_path)] == ["stamped_groundtruth.txt"]


@pytest.mark.parametrize("stamp", ["1e99999999", "1" * 5000, "9" * 30, "1e400", "inf"])
def test_a_stamp_of_too_many_digits_is_refused_at_once(read, stamp):
    with pytest.raises(DatasetError) as error:
        read("stamp_ns,x,y,z,qx,qy,qz,qw", f"{stamp},1,2,3,0,0,0,1", "1,1,2,3,0,0,0,1")
    assert len(str(error.value)) < 600
