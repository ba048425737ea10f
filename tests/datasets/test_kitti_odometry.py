# SPDX-License-Identifier: BSD-3-Clause
import numpy as np
import pytest

from coclo_vio.datasets import image_pairs, images
from coclo_vio.datasets.dataset import DatasetConfig, guess_robot, open_dataset
from coclo_vio.geometry import se3, so3
from coclo_vio.values.errors import CalibrationMissing, DatasetError, TimestampError
from coclo_vio.values.measurements import ALL_SENSORS, StereoFrame

FRAMES_ONLY = frozenset({StereoFrame})
K = np.array([[718.856, 0.0, 607.1928], [0.0, 718.856, 185.2157], [0.0, 0.0, 1.0]])
# The centres of KITTI's four cameras in the frame of the first, m; the colour cameras are slightly off the line.
CENTRES = {
    "P0": (0.0, 0.0, 0.0),
    "P1": (0.5372, 0.0, 0.0),
    "P2": (-0.06, 0.0003, -0.0027),
    "P3": (0.4725, 0.003, -0.0027),
}
TIMES_S = ("0.000000e+00", "1.036224e-01", "2.072448e-01", "3.108672e-01", "4.144896e-01")
TIMES_NS = [0, 103_622_400, 207_244_800, 310_867_200, 414_489_600]


def projection(name):
    return K @ np.column_stack((np.eye(3), -np.array(CENTRES[name])))


def row(matrix):
    return " ".join(f"{value:.12e}" for value in matrix.ravel())


def calib(*names):
    return "".join(f"{name}: {row(projection(name))}\n" for name in names)


def poses(count):
    """Cameras that move along their z axis and turn to the right: T_world_camera (count, 4, 4)."""
    steps = np.arange(count)[:, None]
    return se3.transform(so3.exp(steps * np.array([0.0, 0.1, 0.0])), steps * np.array([0.2, -0.1, 1.2]))


@pytest.fixture
def pictures():
    """Five pairs of small random images, (5, 2, 8, 12)."""
    return np.random.default_rng(3).integers(0, 256, (5, 2, 8, 12), dtype=np.uint8)


@pytest.fixture
def write(tmp_path, pictures):
    """Writes a sequence and returns its folder."""

    def write_sequence(name="00", folders=("image_0", "image_1"), calibration=None, times=TIMES_S):
        folder = tmp_path / "sequences" / name
        for side, camera in enumerate(folders):
            (folder / camera).mkdir(parents=True)
            for number, pair in enumerate(pictures):
                (folder / camera / f"{number:06d}.png").write_bytes(images.encoded(pair[side % 2], "png"))
        (folder / "calib.txt").write_text(calib("P0", "P1", "P2", "P3") if calibration is None else calibration)
        if times is not None:
            (folder / "times.txt").write_text("\n".join(times) + "\n")
        return folder

    return write_sequence


def frames_of(folder, **config):
    return list(open_dataset(folder, None, DatasetConfig(**config)).measurements(FRAMES_ONLY))


def test_a_sequence_comes_back_as_it_was_written(write, pictures):
    folder = write()
    dataset = open_dataset(folder, None)
    assert (dataset.name, guess_robot(folder)) == ("00", None)
    got = list(dataset.measurements(ALL_SENSORS))
    assert [frame.stamp_ns for frame in got] == TIMES_NS
    for frame, (left, right) in zip(got, pictures, strict=True):
        np.testing.assert_array_equal(frame.left, left)
        np.testing.assert_array_equal(frame.right, right)
    assert list(dataset.measurements()) == []
    assert dataset.imu_calibration() is dataset.camera_imu_calibration() is dataset.ground_truth() is None
    assert dataset.report().dropped == {}


def test_no_image_is_decoded_for_the_report(write, monkeypatch):
    def refuse(data, source):
        raise AssertionError(f"{source} was decoded")

    monkeypatch.setattr(image_pairs.images, "decoded", refuse)
    stereo = open_dataset(write(), None).report().stream("stereo")
    assert (stereo.samples, stereo.end_ns) == (5, TIMES_NS[-1])
    assert stereo.rate_hz == pytest.approx(9.65, abs=0.01)


def test_without_times_the_rate_is_assumed_and_that_is_noted(write):
    folder = write(times=None)
    assert [frame.stamp_ns for frame in frames_of(folder)] == [n * 100_000_000 for n in range(5)]
    assert [frame.stamp_ns for frame in frames_of(folder, frame_rate_hz=15.0)][:3] == [0, 66_666_667, 133_333_333]
    assert any("taken to be 10 Hz" in note for note in open_dataset(folder, None).report().notes)


def test_both_forms_of_the_calibration_hold_the_same_rectified_pair(write):
    bare = "\n".join(row(projection(name)) for name in ("P0", "P1"))
    in_rows = "\n".join(row(line) for name in ("P0", "P1") for line in projection(name))
    pairs = [
        open_dataset(write(name, folders, calibration), None).stereo_calibration()
        for name, folders, calibration in (
            ("named", ("image_0", "image_1"), None),
            ("bare", ("image_l", "image_r"), bare),
            ("rows", ("image_l", "image_r"), in_rows),
        )
    ]
    assert pairs[0] == pairs[1] == pairs[2]
    stereo = pairs[0]
    assert stereo.left == stereo.right
    assert (stereo.left.width_px, stereo.left.height_px, stereo.left.distortion) == (12, 8, "none")
    np.testing.assert_allclose(stereo.left.camera_matrix, K)
    assert stereo.baseline_m == pytest.approx(0.5372, abs=1e-9)


def test_the_body_is_the_first_camera_with_x_forward_y_left_z_up(write):
    stereo = open_dataset(write(), None).stereo_calibration()
    forward, right, down = (stereo.T_body_left_camera[:3, axis] for axis in (2, 0, 1))
    np.testing.assert_array_equal([forward, right, down], [[1, 0, 0], [0, -1, 0], [0, 0, -1]])
    np.testing.assert_allclose(stereo.T_body_right_camera[:3, 3], [0.0, -0.5372, 0.0], atol=1e-12)


def test_grey_cameras_are_preferred_and_colour_cameras_have_their_own_mounting(write):
    both = write("both", ("image_0", "image_1", "image_2", "image_3"))
    assert any("image_2 and image_3 are not" in note for note in open_dataset(both, None).report().notes)
    stereo = open_dataset(write("colour", ("image_2", "image_3")), None).stereo_calibration()
    np.testing.assert_allclose(stereo.T_body_left_camera[:3, 3], [-0.0027, 0.06, -0.0003], atol=1e-9)
    assert stereo.baseline_m == pytest.approx(0.5325, abs=1e-9)


@pytest.mark.parametrize("place", ["poses.txt", "../poses/00.txt", "../../poses/00.txt"])
def test_poses_of_the_camera_become_those_of_the_body_in_a_world_that_is_z_up(write, place):
    folder = write()
    path = folder / place
    path.parent.mkdir(exist_ok=True)
    path.write_text("".join(row(T[:3]) + "\n" for T in poses(5)))
    truth = open_dataset(folder, None).ground_truth()
    assert (truth.has_stamps, truth.source) == (True, path.name)
    np.testing.assert_array_equal(truth.trajectory.stamps_ns, TIMES_NS)
    np.testing.assert_allclose(truth.trajectory.T_world_body[0], np.eye(4), atol=1e-12)
    np.testing.assert_allclose(truth.trajectory.positions[2], [2.4, -0.4, 0.2], atol=1e-9)
    np.testing.assert_allclose(so3.log(truth.trajectory.rotations[2]), [0.0, 0.0, -0.2], atol=1e-9)


def test_poses_without_a_time_and_a_last_line_that_was_cut_off_are_left_out(write):
    folder = write()
    text = "".join(row(T[:3]) + "\n" for T in poses(7))
    (folder / "poses.txt").write_text(text[: text.rindex(" ")])
    dataset = open_dataset(folder, None)
    assert len(dataset.ground_truth().trajectory) == 5
    dropped = {"ground truth: last line cut off": 1, "ground truth: pose without a line in times.txt": 1}
    assert dataset.report().dropped == dropped


@pytest.mark.parametrize(
    ("broken", "message"),
    [
        ("1 0 0 0 0 1 0 0 0 0 1\n", "line 1: 11 numbers; a pose has 12"),
        ("1 0 0 0 0 1 0 0 0 0 1 0 5\n", "line 1: 13 numbers"),
        ("1 0 0 0 0 1 0 0 0 0 1 x\n", "line 1: could not convert string to float: 'x'"),
        ("1 0 0 0 0 1 0 0 0 0 nan 0\n", "line 1: a number is not finite"),
        ("1 0 0 0 0 2 0 0 0 0 1 0\n", "pose 1: its first three columns are not a rotation"),
        ("-1 0 0 0 0 1 0 0 0 0 1 0\n", "pose 1: its first three columns are not a rotation"),
        ("\n", "holds no pose"),
    ],
)
def test_malformed_poses_are_an_error_with_their_line(write, broken, message):
    folder = write()
    (folder / "poses.txt").write_text(broken)
    with pytest.raises(DatasetError, match=f"poses.txt.*{message}"):
        open_dataset(folder, None).ground_truth()


def test_images_without_a_partner_are_left_out_and_the_rest_keeps_its_times(write):
    folder = write()
    (folder / "image_1" / "000001.png").unlink()
    (folder / "image_0" / "000003.png").unlink()
    (folder / "image_0" / "cover.png").write_bytes(b"")
    (folder / "image_0" / "notes.txt").write_text("no image")
    dataset = open_dataset(folder, None)
    stamps = [frame.stamp_ns for frame in dataset.measurements(FRAMES_ONLY)]
    assert stamps == [TIMES_NS[0], TIMES_NS[2], TIMES_NS[4]]
    assert dataset.report().dropped == {
        "image_0: no image of the other camera with this number": 1,
        "image_1: no image of the other camera with this number": 1,
        "image_0: image name is not a number, or its number is repeated": 1,
    }


def test_a_list_of_times_that_was_cut_off_leaves_out_what_has_no_time(write):
    dataset = open_dataset(write(times=TIMES_S[:3]), None)
    assert [frame.stamp_ns for frame in dataset.measurements(FRAMES_ONLY)] == TIMES_NS[:3]
    assert dataset.report().dropped == {"stereo: image pair without a line in times.txt": 2}


def test_times_that_go_back_are_counted_and_sorted_if_configured(write):
    folder = write(times=(*TIMES_S[2:], *TIMES_S[:2]))
    assert open_dataset(folder, None).report().stream("stereo").backward_stamps == 1
    assert [frame.stamp_ns for frame in frames_of(folder, sort=True)] == TIMES_NS


@pytest.mark.parametrize(
    ("times", "error", "message"),
    [
        (("0.0", "0.1 0.2"), DatasetError, "times.txt, line 2: a line holds one time in seconds"),
        (("0.0", "nan"), DatasetError, "times.txt, line 2"),
        (("1317384506402996540",), TimestampError, "line 1: 1317384506402996540 s is beyond 64-bit nanoseconds"),
        ((), DatasetError, "times.txt is empty"),
    ],
)
def test_malformed_times_are_an_error_with_their_line(write, times, error, message):
    with pytest.raises(error, match=message):
        open_dataset(write(times=times), None)


@pytest.mark.parametrize(
    ("calibration", "error", "message"),
    [
        (calib("P0", "P2"), CalibrationMissing, "has no P1; its lines are: P0, P2"),
        (calib("P0", "P1").replace("P1: ", "P1: 4 "), DatasetError, "line 2: P1 has 13 numbers, a projection has 12"),
        (calib("P0")[4:], DatasetError, "it holds 12 numbers without a name, 0 lines with one"),
        (calib("P0", "P1").replace("P1: ", ""), DatasetError, "it holds 12 numbers without a name, 1 lines with one"),
        (calib("P0", "P1").replace("P1: ", "P1: x"), DatasetError, "line 2: could not convert"),
        (
            calib("P0", "P1").replace("P0", "P9").replace("P1", "P0").replace("P9", "P1"),
            DatasetError,
            "check the order",
        ),
        (f"P0: {row(projection('P0'))}\nP1: {row(2 * projection('P1'))}", DatasetError, "different camera matrices"),
        (f"P0: {row(projection('P0') + 0.1)}\nP1: {row(projection('P1'))}", DatasetError, "begin with a camera matrix"),
    ],
)
def test_a_malformed_calibration_is_one_sentence(write, calibration, error, message):
    dataset = open_dataset(write(calibration=calibration), None)
    with pytest.raises(error, match=message) as raised:
        dataset.stereo_calibration()
    assert "\n" not in str(raised.value)


def test_cameras_that_are_not_side_by_side_are_not_a_rectified_pair(write, monkeypatch):
    monkeypatch.setitem(CENTRES, "P1", (0.5, 0.1, 0.0))
    with pytest.raises(DatasetError, match=r"P1 is at \[0\.5, 0\.1, 0\.0\] m from P0.*not rectified"):
        open_dataset(write(calibration=calib("P0", "P1")), None).stereo_calibration()


def test_without_its_file_there_is_no_calibration_and_that_is_noted(write):
    folder = write()
    (folder / "calib.txt").unlink()
    dataset = open_dataset(folder, None)
    assert dataset.stereo_calibration() is None
    assert "calib.txt is absent: the cameras are not calibrated" in dataset.report().notes


def test_a_folder_of_one_camera_is_not_a_recording(write):
    folder = write(folders=("image_0",))
    with pytest.raises(DatasetError, match=r"has image_0 but no pair of folders; a sequence has .*image_0 and image_1"):
        open_dataset(folder, None)


def test_folders_without_images_are_an_error(write):
    folder = write()
    for camera in ("image_0", "image_1"):
        for path in (folder / camera).iterdir():
            path.unlink()
    dataset = open_dataset(folder, None)
    with pytest.raises(DatasetError, match="00 holds no sample"):
        dataset.report()
    with pytest.raises(DatasetError, match=r"holds no image named by a number, such as 000000\.png"):
        dataset.stereo_calibration()


def test_images_of_different_sizes_and_broken_ones_are_named(write):
    folder = write()
    path = folder / "image_1" / "000002.png"
    path.write_bytes(images.encoded(np.zeros((8, 14), dtype=np.uint8), "png"))
    with pytest.raises(DatasetError, match=r"000002\.png has 12 x 8 pixels, .*000002\.png 14 x 8"):
        frames_of(folder)
    path.write_bytes(b"no image")
    with pytest.raises(DatasetError, match=r"image_1/000002\.png cannot be decoded as an image"):
        frames_of(folder)
    assert [frame.stamp_ns for frame in frames_of(folder, allow_partial=True)] == TIMES_NS[:2] + TIMES_NS[3:]


def test_the_real_extract_as_it_is(shared_data):
    dataset = open_dataset(shared_data / "kitti_stereo", None)
    stereo = dataset.report().stream("stereo")
    assert (stereo.samples, stereo.end_ns, dataset.report().dropped) == (51, 5_000_000_000, {})
    calibration = dataset.stereo_calibration()
    assert (calibration.left.width_px, calibration.left.height_px) == (1226, 370)
    assert calibration.baseline_m == pytest.approx(0.5372, abs=1e-4)
    assert next(dataset.measurements(FRAMES_ONLY)).left.shape == (370, 1226)
    truth = dataset.ground_truth().trajectory
    assert truth.path_length_m() == pytest.approx(59.9, abs=0.05)
    np.testing.assert_allclose(truth.T_world_body[0], np.eye(4), atol=1e-6)
    assert np.linalg.norm(truth.positions[-1] - [59.8, 1.0, 1.2]) < 0.1  # ahead, a metre to the left, uphill
