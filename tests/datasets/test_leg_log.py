# SPDX-License-Identifier: BSD-3-Clause
from pathlib import Path

import numpy as np
import pytest

from coclo_vio.datasets.dataset import DatasetConfig, open_dataset
from coclo_vio.datasets.writer import RecordedJoints, write_leg_log
from coclo_vio.robot.description import load_robot
from coclo_vio.values.errors import DatasetError, TimestampError, TopicNotFound
from coclo_vio.values.measurements import FootForceSample, ImuSample, JointSample

HEADER = (
    "time_s,gyro_x_radps,gyro_y_radps,gyro_z_radps,accel_x_mps2,accel_y_mps2,accel_z_mps2,"
    "left_hip.position,left_knee.position,right_hip.position,right_knee.position,left.force,right.force"
)
ROW = "0.1,0.2,0.3,0,0,9.81,1,2,3,4,50,60"


def rows_at(*stamps: str) -> list[str]:
    return [HEADER, *(f"{stamp},{ROW}" for stamp in stamps)]


@pytest.fixture
def write(tmp_path):
    def write_lines(lines, end="\n"):
        path = tmp_path / "walk.csv"
        path.write_text("\n".join(lines) + end, encoding="utf-8")
        return path

    return write_lines


def joints_of(measurements):
    return [sample for sample in measurements if isinstance(sample, JointSample)]


def test_a_row_becomes_force_imu_and_joints_with_aliases_resolved(write, biped):
    samples = list(open_dataset(write(rows_at("42.5811")), biped).measurements())
    force, imu, joints = samples
    assert isinstance(force, FootForceSample)
    assert isinstance(imu, ImuSample)
    assert {sample.stamp_ns for sample in samples} == {42_581_100_000}
    np.testing.assert_array_equal(force.force, [50, 60])
    np.testing.assert_array_equal(imu.angular_velocity, [0.1, 0.2, 0.3])
    np.testing.assert_array_equal(imu.specific_force, [0, 0, 9.81])
    np.testing.assert_array_equal(joints.position, [1, 2, 3, 4])
    assert np.isnan(joints.effort).all()


def test_columns_in_another_order_hold_the_same_samples(write, biped, assert_same):
    plain = list(open_dataset(write(rows_at("1.0", "1.01", "1.02")), biped).measurements())
    order = np.random.default_rng(3).permutation(13)
    shuffled = [",".join(np.array(line.split(","))[order]) for line in rows_at("1.0", "1.01", "1.02")]
    assert_same(open_dataset(write(shuffled), biped).measurements(), plain)


def test_velocity_is_estimated_where_the_log_has_none_and_kept_where_it_has_some(write, biped):
    lines = [f"{HEADER},left_hip.velocity"]
    lines += [f"{i * 0.01:.2f},0,0,0,0,0,9.81,{0.02 * i},0,{-0.01 * i},0,50,60,7" for i in range(5)]
    dataset = open_dataset(write(lines), biped)
    last = joints_of(dataset.measurements())[-1]
    np.testing.assert_allclose(last.velocity, [7, 0, -1, 0], atol=1e-12)
    assert any(
        "no joint velocity of left_knee_joint, right_hip_joint, right_knee_joint" in n for n in dataset.report().notes
    )


def test_missing_joint_lists_the_columns_and_the_joints(write, biped):
    header = HEADER.replace("left_knee.position", "left_nee.position")
    with pytest.raises(TopicNotFound, match="no angle of left_knee_joint") as error:
        open_dataset(write([header, f"0,{ROW}"]), biped)
    for name in ("left_nee.position", "right_hip_joint", "gyro_x_radps", "joint_aliases"):
        assert name in str(error.value)


def test_missing_imu_axis_and_missing_time_are_named(write, biped):
    with pytest.raises(TopicNotFound, match="5 of the 6 IMU columns"):
        open_dataset(write([HEADER.replace("gyro_y_radps", "rate")]), biped)
    with pytest.raises(TopicNotFound, match="no time column: none of"):
        open_dataset(write([HEADER.replace("time_s", "clock")]), biped)


def test_column_patterns_are_configuration(write, biped):
    lines = rows_at("1.0")
    lines[0] = lines[0].replace("time_s", "clock").replace(".position", "/q")
    config = DatasetConfig.parse({"columns": {"stamp_s": ["clock"], "position": ["{joint}/q"]}}, "test")
    assert len(list(open_dataset(write(lines), biped, config).measurements())) == 3


def test_a_column_that_is_named_twice_is_refused(write, biped):
    with pytest.raises(DatasetError, match=r"more than one column right_hip\.position"):
        open_dataset(write([HEADER.replace("left_hip", "right_hip")]), biped)


def test_nan_in_joints_and_force_is_passed_on_and_in_the_imu_dropped(write, biped):
    lines = [
        HEADER,
        "0.00,0,0,0,0,0,9.81,1,,3,4,nan,60",
        "0.01,0,nan,0,0,0,9.81,1,2,3,4,50,60",
        "0.02,0,,0,0,inf,9,1,2,3,4,5,6",
    ]
    dataset = open_dataset(write(lines), biped)
    samples = list(dataset.measurements())
    assert [type(sample) for sample in samples].count(ImuSample) == 1
    np.testing.assert_array_equal(joints_of(samples)[0].position, [1, np.nan, 3, 4])
    np.testing.assert_array_equal(samples[0].force, [np.nan, 60])
    report = dataset.report()
    assert report.dropped == {"walk.csv: IMU reading empty or NaN": 2}
    assert report.stream("joints").samples_with_nan == 1
    assert report.stream("foot_force").samples_with_nan == 1


def test_a_sensor_with_all_its_cells_empty_has_no_sample_in_that_row(write, biped):
    lines = [HEADER, "0.00,0,0,0,0,0,9.81,,,,,,", "0.01,,,,,,,1,2,3,4,50,60"]
    dataset = open_dataset(write(lines), biped)
    assert [type(sample) for sample in dataset.measurements()] == [ImuSample, FootForceSample, JointSample]
    assert dataset.report().dropped == {}


def test_a_row_without_a_stamp_is_dropped_and_counted(write, biped):
    dataset = open_dataset(write(rows_at("1.0", "", "nan", "1.1")), biped)
    assert len(joints_of(dataset.measurements())) == 2
    assert dataset.report().dropped == {"walk.csv: row without a stamp": 2}


def test_repeated_and_backward_stamps_are_passed_on_and_counted(write, biped):
    dataset = open_dataset(write(rows_at("1.00", "1.01", "1.01", "0.99", "1.02")), biped)
    stamps = [sample.stamp_ns // 10_000_000 for sample in joints_of(dataset.measurements())]
    assert stamps == [100, 101, 101, 99, 102]
    joints = dataset.report().stream("joints")
    assert (joints.repeated_stamps, joints.backward_stamps) == (1, 1)
    assert (joints.start_ns, joints.end_ns) == (990_000_000, 1_020_000_000)


def test_sorting_puts_a_shuffled_log_in_order_and_estimates_velocity_after_that(write, biped, assert_same):
    lines = [HEADER, *(f"{i * 0.0025:.4f},0,0,0,0,0,9.81,{0.01 * i * i},0,0,0,{i},0" for i in range(30))]
    ordered = list(open_dataset(write(lines), biped).measurements())
    rows = lines[1:]
    np.random.default_rng(11).shuffle(rows)
    dataset = open_dataset(write([HEADER, *rows]), biped, DatasetConfig(sort=True))
    assert_same(dataset.measurements(), ordered)
    assert any("sorted by time" in note for note in dataset.report().notes)
    assert dataset.report().stream("joints").backward_stamps == 0


def test_a_text_cell_is_named_by_file_line_and_column(write, biped):
    path = write([HEADER, f"0.0,{ROW}", f"0.1,{ROW.replace('0.3', 'oops')}"])
    with pytest.raises(DatasetError, match=r"walk\.csv, line 3, column gyro_z_radps: 'oops' is not a number"):
        open_dataset(path, biped).report()


def test_a_short_row_in_the_middle_is_an_error_that_names_the_line(write, biped):
    path = write([HEADER, f"0.0,{ROW}", "0.1,3", f"0.2,{ROW}"])
    with pytest.raises(DatasetError, match="line 3: 2 cells under a header of 13 columns"):
        open_dataset(path, biped).report()


@pytest.mark.parametrize("cut", [1, 3, 12, len(ROW)])
def test_a_last_line_that_was_cut_off_is_dropped_and_counted(write, biped, cut):
    dataset = open_dataset(write([HEADER, f"0.0,{ROW}", f"0.1,{ROW}"[:-cut]], end=""), biped)
    report = dataset.report()
    # A cut inside the last number leaves a number: then the row is kept, and a note states the doubt.
    kept = 2 if cut == 1 else 1
    assert report.stream("joints").samples == kept
    if kept == 2:
        assert any("no newline" in note for note in report.notes)
    else:
        assert report.dropped == {"walk.csv: last line cut off": 1}


@pytest.mark.parametrize("end", ["", "-", "1.5e-"])
def test_a_last_number_that_was_cut_off_drops_its_line(write, biped, end):
    cut = f"0.1,{ROW.removesuffix('60')}{end}"
    report = open_dataset(write([HEADER, f"0.0,{ROW}", cut], end=""), biped).report()
    assert report.stream("foot_force").samples == 1
    assert report.dropped == {"walk.csv: last line cut off": 1}


def test_a_log_that_was_cut_off_anywhere_is_read_up_to_the_cut(write, biped, tmp_path):
    text = "\n".join(rows_at("0.00", "0.01", "0.02")) + "\n"
    start = len(HEADER) + len(ROW) + 8
    for length in range(start, len(text)):
        (tmp_path / "walk.csv").write_text(text[:length])
        whole = text[:length].count("\n") - 1
        joints = open_dataset(tmp_path / "walk.csv", biped).report().stream("joints")
        assert joints.samples in {whole, whole + 1}


def test_a_stamp_in_the_wrong_unit_is_an_error_that_names_the_unit(write, biped):
    with pytest.raises(TimestampError, match="check whether the column is in seconds"):
        open_dataset(write(rows_at("1403715273262142976")), biped).report()


def test_an_empty_file_a_header_alone_and_a_binary_file_are_refused(tmp_path, write, biped):
    (tmp_path / "empty.csv").write_text("")
    with pytest.raises(DatasetError, match="is empty"):
        open_dataset(tmp_path / "empty.csv", biped)
    with pytest.raises(DatasetError, match="holds no sample"):
        open_dataset(write([HEADER]), biped).report()
    (tmp_path / "binary.csv").write_bytes(bytes(range(128, 256)))
    with pytest.raises(DatasetError, match="not a CSV text file"):
        open_dataset(tmp_path / "binary.csv", biped)


def test_a_gap_is_counted_and_left_out_of_the_rate(write, biped):
    stamps = [f"{i * 0.01:.2f}" for i in range(50)] + [f"{1 + i * 0.01:.2f}" for i in range(51)]
    imu = open_dataset(write(rows_at(*stamps)), biped).report().stream("imu")
    assert (imu.samples, imu.gaps, imu.longest_gap_s, imu.longest_gap_start_ns) == (101, 1, 0.51, 490_000_000)
    assert imu.rate_hz == pytest.approx(100.0)
    assert imu.duration_s == 1.5


def test_without_a_robot_only_the_imu_is_read(write):
    dataset = open_dataset(write(rows_at("0.0")), None)
    assert [type(sample) for sample in dataset.measurements()] == [ImuSample]
    assert any("not read" in note and "left_hip.position" in note for note in dataset.report().notes)


def test_unread_columns_and_absent_sensors_are_noted(write, biped):
    lines = [
        "stamp_ns,left_hip.position,left_knee.position,right_hip.position,right_knee.position,battery",
        "5,1,2,3,4,99",
    ]
    dataset = open_dataset(write(lines), biped)
    assert [type(sample) for sample in dataset.measurements()] == [JointSample]
    notes = " ".join(dataset.report().notes)
    for words in ("columns not read: battery", "no IMU in the log", "no joint torque", "no joint velocity"):
        assert words in notes


def test_the_file_is_streamed_not_loaded(write, biped):
    stream = open_dataset(write(rows_at("0.0", "0.01", "oops", "0.02")), biped).measurements()
    assert [next(stream).stamp_ns for _ in range(3)] == [0, 0, 0]
    with pytest.raises(DatasetError, match="'oops' is not a number"):
        list(stream)


def test_the_folder_may_be_the_current_one(write, biped, monkeypatch):
    monkeypatch.chdir(write(rows_at("0.0")).parent)
    assert open_dataset(Path(), biped).name == Path.cwd().name


def test_measurements_start_anew_each_time(write, biped, assert_same):
    dataset = open_dataset(write(rows_at("0.0", "0.01", "0.02")), biped)
    assert_same(dataset.measurements(), dataset.measurements())


def test_ground_truth_is_taken_from_the_folder_unless_it_holds_several_logs(tmp_path, write, biped):
    write(rows_at("0.0"))
    (tmp_path / "groundtruth.tum").write_text("0.5 1 2 3 0 0 0 1\n1.5 2 2 3 0 0 0 1\n")
    for path in (tmp_path, tmp_path / "walk.csv"):
        truth = open_dataset(path, biped).ground_truth()
        assert truth.has_stamps
        np.testing.assert_array_equal(truth.trajectory.positions, [[1, 2, 3], [2, 2, 3]])
    (tmp_path / "other.csv").write_text("\n".join(rows_at("0.0")))
    with pytest.raises(DatasetError, match=r"2 leg logs \(other\.csv, walk\.csv\)"):
        open_dataset(tmp_path, biped)
    alone = open_dataset(tmp_path / "walk.csv", biped)
    assert alone.ground_truth() is None
    assert any("several logs" in note for note in alone.report().notes)


def test_of_several_ground_truths_the_first_is_read_and_the_others_named(tmp_path, write, biped):
    write(rows_at("0.0"))
    (tmp_path / "groundtruth.tum").write_text("0.5 1 2 3 0 0 0 1\n")
    (tmp_path / "mocap.csv").write_text("x,y,z,qx,qy,qz,qw\n9,9,9,0,0,0,1\n")
    dataset = open_dataset(tmp_path, biped)
    assert dataset.ground_truth().source == "groundtruth.tum"
    assert any("not mocap.csv" in note for note in dataset.report().notes)


def test_go1_log_as_it_is(shared_data):
    robot = load_robot("go1")
    dataset = open_dataset(shared_data / "go1_mocap", robot)
    samples = list(dataset.measurements())
    report = dataset.report()
    assert [report.stream(name).samples for name in ("imu", "joints", "foot_force")] == [10_148] * 3
    assert report.dropped == {}
    assert report.stream("imu").rate_hz == pytest.approx(399, abs=1)
    assert any("velocity in the log: estimated" in note for note in report.notes)
    assert any("no stamps" in note for note in report.notes)
    first, last = joints_of(samples)[0], joints_of(samples)[-1]
    assert first.stamp_ns == 42_581_100_000
    np.testing.assert_array_equal(first.position[:3], [-0.165013, 0.972757, -2.2736])
    assert np.isnan(first.velocity).all()
    assert last.velocity.shape == (12,)
    assert np.isfinite(last.velocity).all()
    np.testing.assert_array_equal(samples[0].force, [1, 71, 150, 169])
    truth = dataset.ground_truth()
    assert not truth.has_stamps
    assert len(truth.trajectory) == 1610
    np.testing.assert_array_equal(truth.trajectory.positions[0], [0.023922, -0.632131, 0.174621])


def test_go1_log_survives_being_written_and_read_back(shared_data, tmp_path, assert_same):
    robot = load_robot("go1")
    source = open_dataset(shared_data / "go1_mocap", robot)
    head = [sample for sample, _ in zip(source.measurements(), range(3000), strict=False)]
    write_leg_log(tmp_path, robot, head, source.ground_truth(), joints=RecordedJoints(with_effort=False))
    back = open_dataset(tmp_path, robot)
    assert_same(back.measurements(), head)
    assert not back.ground_truth().has_stamps
