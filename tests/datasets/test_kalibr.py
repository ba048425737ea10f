# SPDX-License-Identifier: BSD-3-Clause
"""Files of Kalibr: directions by key, chains, and errors of one sentence."""

import copy

import numpy as np
import pytest
import yaml

from coclo_vio.datasets.kalibr import read_camchain, read_imu
from coclo_vio.geometry import se3, so3
from coclo_vio.values.errors import CalibrationMissing, ConfigError

T_CAM_IMU = se3.transform(so3.exp(np.array([1.1, -0.4, 0.7])), np.array([0.1, -0.05, 0.02]))
T_CAM1_CAM0 = se3.transform(so3.exp(np.array([0.0, 0.01, 0.0])), np.array([-0.11, 0.0, 0.001]))
LENS = {
    "camera_model": "pinhole",
    "intrinsics": [458.654, 457.296, 367.215, 248.375],
    "distortion_model": "radtan",
    "distortion_coeffs": [-0.28, 0.07, 0.0002, 1.7e-05],
    "resolution": [752, 480],
}
CHAIN = {
    "cam0": LENS | {"T_cam_imu": T_CAM_IMU.tolist(), "timeshift_cam_imu": -0.003, "rostopic": "/cam0/image_raw"},
    "cam1": LENS | {"T_cn_cnm1": T_CAM1_CAM0.tolist()},
}


@pytest.fixture
def read(tmp_path):
    def written(values):
        path = tmp_path / "camchain.yaml"
        path.write_text(values if isinstance(values, str) else yaml.safe_dump(values))
        return read_camchain(path)

    return written


def changed(camera, key, value):
    chain = copy.deepcopy(CHAIN)
    if value is None:
        del chain[camera][key]
    else:
        chain[camera][key] = value
    return chain


def test_a_camchain_holds_intrinsics_mountings_and_the_time_shift(read):
    left, right = read(CHAIN)
    np.testing.assert_allclose(left.T_camera_imu, T_CAM_IMU, atol=1e-12)
    np.testing.assert_allclose(right.T_camera_imu, T_CAM1_CAM0 @ T_CAM_IMU, atol=1e-12)
    assert left.intrinsics.focal_px == (458.654, 457.296)
    assert left.intrinsics.principal_point_px == (367.215, 248.375)
    assert (left.intrinsics.width_px, left.intrinsics.height_px) == (752, 480)
    assert left.intrinsics.distortion_coefficients == (-0.28, 0.07, 0.0002, 1.7e-05)
    assert (left.time_shift_s, left.topic) == (-0.003, "/cam0/image_raw")
    assert (right.time_shift_s, right.topic) == (0.0, "")


def test_either_direction_is_read_by_its_key(read):
    chain = changed("cam0", "T_cam_imu", None)
    chain["cam0"]["T_imu_cam"] = se3.inverse(T_CAM_IMU).tolist()
    np.testing.assert_allclose(read(chain)[0].T_camera_imu, T_CAM_IMU, atol=1e-12)


def test_both_directions_are_accepted_if_they_agree(read):
    np.testing.assert_allclose(
        read(changed("cam0", "T_imu_cam", se3.inverse(T_CAM_IMU).tolist()))[0].T_camera_imu, T_CAM_IMU, atol=1e-12
    )


@pytest.mark.parametrize(
    ("camera", "key", "value", "message"),
    [
        ("cam0", "T_cam_imu", None, r"cam0 has no mounting.*T_cam_imu .*T_imu_cam"),
        ("cam1", "T_cn_cnm1", None, r"cam1 has no mounting"),
        ("cam0", "T_imu_cam", T_CAM_IMU.tolist(), r"T_cam_imu and T_imu_cam contradict each other by .* deg"),
        ("cam1", "T_cam_imu", T_CAM_IMU.tolist(), r"cam1: T_cam_imu and T_cn_cnm1 contradict"),
        ("cam0", "T_cam_imu", np.diag([1.0, 1.0, -1.0, 1.0]).tolist(), r"T_cam_imu is not a rigid transform"),
        ("cam0", "T_cam_imu", [[1.0, 0.0]], r"T_cam_imu must be 4 rows of 4 numbers"),
        ("cam0", "camera_model", "omni", r"camera_model omni with distortion_model radtan is not supported"),
        ("cam0", "distortion_model", "fov", r"distortion_model fov is not supported.*radtan or equidistant"),
        ("cam0", "intrinsics", [1.0, 2.0], r"intrinsics = \[1.0, 2.0\] must be 4 finite numbers"),
        ("cam0", "resolution", None, r"resolution = None must be numbers"),
        ("cam0", "distortion_coeffs", [0.1, 0.2], r"radtan distortion takes 4 or 5 or 8 coefficients, got 2"),
        ("cam0", "timeshift_cam_imu", "late", r"timeshift_cam_imu = \['late'\] must be numbers"),
    ],
)
def test_what_is_missing_or_contradictory_is_one_sentence(read, camera, key, value, message):
    with pytest.raises(CalibrationMissing, match=message) as error:
        read(changed(camera, key, value))
    assert "camchain.yaml, cam" in str(error.value)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize("values", [{"imu0": {}}, {"cam0": 3}])
def test_a_file_without_cameras_is_refused(read, values):
    with pytest.raises(CalibrationMissing):
        read(values)


def test_a_file_that_is_missing_or_not_yaml_is_refused(tmp_path, read):
    with pytest.raises(ConfigError, match="nowhere"):
        read_camchain(tmp_path / "nowhere.yaml")
    with pytest.raises(ConfigError, match="is not YAML"):
        read("cam0: [")


@pytest.mark.parametrize("indent", [False, True])
def test_noise_of_an_imu_is_read_by_key(tmp_path, indent):
    noise = {
        "accelerometer_noise_density": 0.01,
        "accelerometer_random_walk": 0.0002,
        "gyroscope_noise_density": 0.0005,
        "gyroscope_random_walk": 4e-06,
        "rostopic": "/imu0",
        "update_rate": 200.0,
    }
    path = tmp_path / "imu.yaml"
    path.write_text(yaml.safe_dump({"imu0": noise} if indent else noise))
    imu = read_imu(path)
    assert imu.noise == {
        "accelerometer_noise_density": 0.01,
        "accelerometer_bias_walk": 0.0002,
        "gyroscope_noise_density": 0.0005,
        "gyroscope_bias_walk": 4e-06,
    }
    assert imu.topic == "/imu0"


def test_an_imu_file_without_noise_names_the_keys(tmp_path):
    path = tmp_path / "imu.yaml"
    path.write_text("{rostopic: /imu0}")
    with pytest.raises(CalibrationMissing, match=r"none of accelerometer_noise_density.*its keys rostopic"):
        read_imu(path)


def test_the_directive_of_opencv_is_no_obstacle(read):
    assert read("%YAML:1.0\n---\n" + yaml.safe_dump(CHAIN))[0].time_shift_s == -0.003


@pytest.mark.parametrize(
    ("key", "value", "sentence"),
    [
        ("camera_model", "omni", "camera_model omni with distortion_model radtan is not supported"),
        ("camera_model", "ds", "camera_model ds .* is not supported"),
        ("camera_model", "eucm", "camera_model eucm .* is not supported"),
        ("distortion_model", "fov", "distortion_model fov is not supported"),
        ("resolution", [1e300, 480], "width_px"),
        ("intrinsics", [10**400, 1, 1, 1], "must be numbers"),
        ("T_cam_imu", [[1, 0, 0, float("inf")], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]], "must be finite"),
        ("timeshift_cam_imu", float("nan"), "must be 1 finite numbers"),
    ],
)
def test_values_no_camera_has_are_refused_in_a_sentence(read, key, value, sentence):
    with pytest.raises(CalibrationMissing, match=sentence) as error:
        read(changed("cam0", key, value))
    assert "\n" not in str(error.value)
