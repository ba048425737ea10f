# SPDX-License-Identifier: BSD-3-Clause
import cv2
import numpy as np
import pytest

from coclo_vio.datasets import euroc_sensor, image_pairs, images
from coclo_vio.datasets.dataset import DatasetConfig, open_dataset
from coclo_vio.datasets.writer import write_euroc_folder
from coclo_vio.values.calibration import CameraCalibration
from coclo_vio.values.errors import CalibrationMissing, DatasetError, TopicNotFound
from coclo_vio.values.measurements import ALL_SENSORS, VISION_SENSORS, CameraImuSample, StereoFrame

FRAMES_ONLY = frozenset({StereoFrame})


@pytest.fixture
def mav0(tmp_path, full_recording):
    return write_euroc_folder(tmp_path, full_recording)


def frames_of(mav0, **config):
    return list(open_dataset(mav0, None, DatasetConfig(**config)).measurements(FRAMES_ONLY))


def image_files(mav0, camera):
    return sorted((mav0 / camera / "data").iterdir())


def replace_image(mav0, camera, number, pixels):
    image_files(mav0, camera)[number].write_bytes(cv2.imencode(".png", pixels)[1].tobytes())


def test_cameras_and_their_imu_are_read_without_a_robot(mav0):
    kinds = {type(sample) for sample in open_dataset(mav0, None).measurements(VISION_SENSORS)}
    assert kinds == {CameraImuSample, StereoFrame}


def test_no_image_is_decoded_unless_requested(mav0, full_recording, monkeypatch, assert_same):
    def refuse(data, source):
        raise AssertionError(f"{source} was decoded")

    monkeypatch.setattr(image_pairs.images, "decoded", refuse)
    dataset = open_dataset(mav0, full_recording.robot)
    assert all(type(sample) is not StereoFrame for sample in dataset.measurements())
    stereo = dataset.report().stream("stereo")
    assert (stereo.samples, stereo.start_ns) == (5, full_recording.frames[0].stamp_ns)
    assert stereo.rate_hz == pytest.approx(25.0, abs=0.01)
    with pytest.raises(AssertionError, match="was decoded"):
        list(dataset.measurements(ALL_SENSORS))


def test_missing_images_are_left_out_and_named(mav0):
    gone = image_files(mav0, "cam1")[1:3]
    for path in gone:
        path.unlink()
    dataset = open_dataset(mav0, None)
    assert len(list(dataset.measurements(FRAMES_ONLY))) == 3
    report = dataset.report()
    assert report.dropped == {
        "cam1/data.csv: image file is missing": 2,
        "cam0/data.csv: no image of the other camera at this stamp": 2,
    }
    assert f"cam1/data.csv names 2 images whose files are missing: {gone[0].name}, {gone[1].name}" in report.notes


def test_rows_are_paired_by_stamp_and_not_by_order(mav0, full_recording):
    path = mav0 / "cam1" / "data.csv"
    header, *rows = path.read_text().splitlines()
    path.write_text("\n".join([header, *reversed(rows)]) + "\n")
    for frame, encoded in zip(frames_of(mav0), full_recording.frames, strict=True):
        np.testing.assert_array_equal(frame.right, images.decoded(encoded.right, "made"))


def test_shuffled_rows_are_sorted_if_configured(mav0, full_recording):
    stamps = [frame.stamp_ns for frame in full_recording.frames]
    for camera in ("cam0", "cam1"):
        path = mav0 / camera / "data.csv"
        header, *rows = path.read_text().splitlines()
        path.write_text("\n".join([header, *reversed(rows)]) + "\n")
    assert [frame.stamp_ns for frame in frames_of(mav0)] == stamps[::-1]
    assert [frame.stamp_ns for frame in frames_of(mav0, sort=True)] == stamps


def test_a_list_that_was_cut_off_is_read_up_to_there(mav0):
    path = mav0 / "cam0" / "data.csv"
    path.write_text(path.read_text()[:-3])  # within a file name
    dataset = open_dataset(mav0, None)
    assert len(list(dataset.measurements(FRAMES_ONLY))) == 4
    assert dataset.report().dropped["cam0/data.csv: image file is missing"] == 1


def test_a_last_line_without_newline_is_an_image_like_others(mav0):
    path = mav0 / "cam0" / "data.csv"
    path.write_text(path.read_text().rstrip("\n"))
    assert len(frames_of(mav0)) == 5


def test_a_single_camera_is_not_read_and_that_is_noted(mav0, full_recording):
    (mav0 / "cam1" / "data.csv").unlink()
    report = open_dataset(mav0, full_recording.robot).report()
    assert report.stream("stereo") is None
    assert any("cam1/data.csv is absent" in note for note in report.notes)


def test_colour_becomes_grey(mav0):
    grey = np.full((12, 16), 77, dtype=np.uint8)
    replace_image(mav0, "cam0", 0, np.dstack([grey] * 3))
    replace_image(mav0, "cam1", 0, np.dstack([grey] * 4))
    first = frames_of(mav0)[0]
    np.testing.assert_array_equal(first.left, grey)
    np.testing.assert_array_equal(first.right, grey)


def test_images_of_16_bits_are_refused_in_a_sentence(mav0):
    replace_image(mav0, "cam1", 2, np.full((12, 16), 4000, dtype=np.uint16))
    with pytest.raises(DatasetError, match=r"cam1/data/\d+\.png has pixels of uint16, only 8-bit"):
        frames_of(mav0)


def test_images_of_different_sizes_are_named(mav0):
    replace_image(mav0, "cam1", 2, np.zeros((12, 18), dtype=np.uint8))
    with pytest.raises(DatasetError, match=r"16 x 12 pixels, .*18 x 12; the images of a pair must agree"):
        frames_of(mav0)


@pytest.mark.parametrize("keep", [0, 30, -20])
def test_a_file_that_is_not_an_image_is_named(mav0, keep):
    path = image_files(mav0, "cam0")[3]
    path.write_bytes(path.read_bytes()[:keep])
    with pytest.raises(DatasetError, match=f"{path.name} cannot be decoded as an image"):
        frames_of(mav0)


def test_images_that_cannot_be_read_are_left_out_when_that_is_allowed(mav0, full_recording):
    image_files(mav0, "cam1")[3].write_bytes(b"no image")
    dataset = open_dataset(mav0, full_recording.robot, DatasetConfig(allow_partial=True))
    kinds = [type(sample) for sample in dataset.measurements(ALL_SENSORS)]
    assert kinds.count(StereoFrame) == 4
    report = dataset.report()
    assert (report.stream("stereo").samples, report.stream("imu").samples) == (4, 40)
    assert report.dropped == {"stereo: image pair cannot be decoded": 1}
    assert any("cannot be decoded as an image" in note for note in report.notes)


def test_a_list_without_file_names_is_an_error(mav0):
    path = mav0 / "cam0" / "data.csv"
    path.write_text(path.read_text().replace("filename", "name"))
    with pytest.raises(TopicNotFound, match="no column filename; the columns are name, timestamp"):
        open_dataset(mav0, None)


@pytest.mark.parametrize(
    ("distortion", "coefficients"),
    [("none", ()), ("radtan", (-0.28, 0.07, 1e-4, 2e-5)), ("radtan", (1.0,) * 8), ("equidistant", (0.0,) * 4)],
)
def test_intrinsics_survive(tmp_path, full_recording, distortion, coefficients):
    lens = CameraCalibration(
        width_px=752,
        height_px=480,
        focal_px=(458.654, 457.296),
        principal_point_px=(367.215, 248.375),
        distortion=distortion,
        distortion_coefficients=coefficients,
    )
    for side in ("left", "right"):
        euroc_sensor.write_camera(
            tmp_path / side, lens, getattr(full_recording.stereo, f"T_body_{side}_camera"), -0.0125
        )
    back = euroc_sensor.read_stereo(tmp_path / "left" / "sensor.yaml", tmp_path / "right" / "sensor.yaml")
    assert back == full_recording.stereo.model_copy(update={"left": lens, "right": lens, "time_offset_s": -0.0125})


@pytest.mark.parametrize(
    ("found", "put", "error", "message"),
    [
        ("intrinsics", "intrinsic", CalibrationMissing, "has no intrinsics; its keys are: T_BS, camera_model"),
        ("T_BS", "T_SB", CalibrationMissing, "has no T_BS"),
        ("radial-tangential", "fov", DatasetError, "'fov' is not supported; supported are equidistant"),
        ("[16, 12]", "[16]", DatasetError, "must be width and height"),
        ("[16, 12]", "[16, -12]", DatasetError, "height_px"),
        ("[9.5, ", "[", DatasetError, "the four numbers fx, fy, cx, cy"),
        ("[0.0, 0.0, 0.0, 0.0]", "[0.1, 0.0]", DatasetError, "4 or 5 or 8 coefficients"),
    ],
)
def test_a_camera_without_its_calibration_is_one_sentence(mav0, found, put, error, message):
    path = mav0 / "cam1" / "sensor.yaml"
    assert found in path.read_text()
    path.write_text(path.read_text().replace(found, put))
    with pytest.raises(error, match=message) as raised:
        open_dataset(mav0, None).stereo_calibration()
    assert "\n" not in str(raised.value)


def test_without_a_sensor_yaml_there_is_no_stereo_calibration(mav0):
    (mav0 / "cam0" / "sensor.yaml").unlink()
    assert open_dataset(mav0, None).stereo_calibration() is None


def test_the_start_of_v1_01_as_it_is(shared_data):
    dataset = open_dataset(shared_data / "euroc_v1_01_start", None)
    frames = dataset.measurements(FRAMES_ONLY)
    first = next(frames)
    assert first.left.shape == first.right.shape == (480, 752)
    report = dataset.report()
    assert report.stream("stereo").samples == 95
    assert report.stream("stereo").rate_hz == pytest.approx(20.0, abs=0.01)
    assert report.dropped == {"cam1/data.csv: image file is missing": 4}
    assert any("cam1/data.csv names 4 images whose files are missing: " in note for note in report.notes)
    stereo = dataset.stereo_calibration()
    assert stereo.baseline_m == pytest.approx(0.110, abs=0.001)
    assert (stereo.left.distortion, stereo.left.focal_px) == ("radtan", (458.654, 457.296))


def test_the_keyframes_of_v1_01_are_jpeg(shared_data):
    dataset = open_dataset(shared_data / "euroc_v1_01_keyframes", None)
    frame = next(dataset.measurements(FRAMES_ONLY))
    assert frame.left.shape == (480, 752)
    stereo = dataset.report().stream("stereo")
    assert (stereo.samples, stereo.gaps, stereo.rate_hz < 2.0) == (100, 4, True)
