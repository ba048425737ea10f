# SPDX-License-Identifier: BSD-3-Clause
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from coclo_vio.geometry import se3, so3
from coclo_vio.values.calibration import CameraCalibration, ImuCalibration, RectifiedStereo, StereoCalibration, matrix4
from coclo_vio.values.errors import CalibrationMissing, ConfigError

_ANGLES = st.floats(-3.2, 3.2)


def test_an_imu_is_at_the_body_origin_by_default() -> None:
    np.testing.assert_array_equal(ImuCalibration().T_body_imu, np.eye(4))


@given(_ANGLES, _ANGLES, _ANGLES)
def test_roll_pitch_yaw_are_those_of_urdf(roll: float, pitch: float, yaw: float) -> None:
    """Fixed axes x, y, z in this order: R = Rz(yaw) Ry(pitch) Rx(roll)."""
    imu = ImuCalibration(rotation_body_imu_rpy_rad=(roll, pitch, yaw), position_body_m=(0.1, 0.2, 0.3))
    expected = Rotation.from_euler("xyz", [roll, pitch, yaw]).as_matrix()
    np.testing.assert_allclose(imu.T_body_imu[:3, :3], expected, atol=1e-14)
    np.testing.assert_array_equal(imu.T_body_imu[:3, 3], [0.1, 0.2, 0.3])


def test_body_forward_is_to_the_right_of_an_imu_turned_left_by_a_quarter() -> None:
    imu = ImuCalibration(rotation_body_imu_rpy_rad=(0.0, 0.0, np.pi / 2))
    forward_imu = imu.T_body_imu[:3, :3].T @ [1.0, 0.0, 0.0]
    np.testing.assert_allclose(forward_imu, [0.0, -1.0, 0.0], atol=1e-15)


@pytest.mark.parametrize(
    ("key", "value"),
    [("gyroscope_noise_density", 0.0), ("accelerometer_bias_walk", -1e-9), ("gyroscope_bias_walk", float("nan"))],
)
def test_noise_out_of_bounds_is_refused(key: str, value: float) -> None:
    with pytest.raises(ConfigError, match=rf"sensor.yaml: {key} = "):
        ImuCalibration.parse({key: value}, "sensor.yaml")


LENS = {"width_px": 640, "height_px": 480, "focal_px": (380.0, 381.0), "principal_point_px": (319.5, 239.5)}


def test_a_lens_takes_as_many_coefficients_as_its_model_has() -> None:
    assert CameraCalibration.parse(LENS, "here").camera_matrix.tolist() == [[380, 0, 319.5], [0, 381, 239.5], [0, 0, 1]]
    for count in (4, 5, 8):
        CameraCalibration.parse(LENS | {"distortion": "radtan", "distortion_coefficients": [0.0] * count}, "here")
    with pytest.raises(ConfigError, match="equidistant distortion takes 4 coefficients, got 5"):
        CameraCalibration.parse(LENS | {"distortion": "equidistant", "distortion_coefficients": [0.0] * 5}, "here")
    with pytest.raises(ConfigError, match="must be positive"):
        CameraCalibration.parse(LENS | {"focal_px": (380.0, -1.0)}, "here")


def test_cameras_are_mounted_by_rigid_transforms() -> None:
    lens, left, right = CameraCalibration.parse(LENS, "here"), np.eye(4), np.eye(4)
    right[0, 3] = 0.05
    stereo = StereoCalibration(left=lens, right=lens, body_left_camera=matrix4(left), body_right_camera=matrix4(right))
    assert stereo.baseline_m == 0.05
    np.testing.assert_array_equal(stereo.T_body_right_camera, right)
    sheared = left.copy()
    sheared[0, 1] = 0.1
    with pytest.raises(ConfigError, match="body_left_camera is not a rigid transform"):
        StereoCalibration.parse(
            {"left": lens, "right": lens, "body_left_camera": sheared.tolist(), "body_right_camera": right.tolist()},
            "x",
        )


def test_points_and_pixels_of_a_rectified_pair_are_inverse() -> None:
    rig = RectifiedStereo((400.0, 380.0), (320.0, 240.0), 0.05, np.eye(4))
    left_px, disparity_px = rig.pixels(np.array([[0.5, -0.25, 2.0]]))
    np.testing.assert_allclose(left_px, [[400.0 * 0.25 + 320.0, -380.0 * 0.125 + 240.0]])
    np.testing.assert_allclose(disparity_px, [400.0 * 0.05 / 2.0])
    np.testing.assert_allclose(rig.points(left_px, disparity_px), [[0.5, -0.25, 2.0]])


def test_a_baseline_is_positive() -> None:
    with pytest.raises(ValueError, match=r"baseline_m = 0\.0 must be positive"):
        RectifiedStereo((400.0, 400.0), (320.0, 240.0), 0.0, np.eye(4))


def rectified_pair(**changes: object) -> StereoCalibration:
    lens = CameraCalibration(width_px=640, height_px=480, focal_px=(400.0, 410.0), principal_point_px=(320.0, 240.0))
    T_body_left = se3.transform(so3.exp(np.array([0.3, -1.2, 0.5])), np.array([0.2, 0.1, -0.1]))
    values = {
        "left": lens,
        "right": lens,
        "body_left_camera": matrix4(T_body_left),
        "body_right_camera": matrix4(T_body_left @ se3.transform(np.eye(3), np.array([0.05, 0.0, 0.0]))),
    }
    return StereoCalibration(**values | changes)  # type: ignore[arg-type]


def test_a_rectified_calibration_is_a_rectified_pair() -> None:
    rig = RectifiedStereo.of(rectified_pair())
    assert (rig.focal_px, rig.principal_point_px) == ((400.0, 410.0), (320.0, 240.0))
    assert rig.baseline_m == pytest.approx(0.05, abs=1e-12)
    np.testing.assert_array_equal(rig.T_body_camera, rectified_pair().T_body_left_camera)


@pytest.mark.parametrize(
    ("right_from_left", "lens", "defect"),
    [
        ([0.05, 0.0, 0.0, 0.0, 0.0, 0.01], {}, "axes that are not parallel"),
        ([0.05, 0.001, 0.0, 0.0, 0.0, 0.0], {}, "a baseline that is not along x"),
        ([-0.05, 0.0, 0.0, 0.0, 0.0, 0.0], {}, "a baseline that is not along x"),
        ([0.05, 0.0, 0.0, 0.0, 0.0, 0.0], {"focal_px": (401.0, 410.0)}, "different camera matrices"),
        (
            [0.05, 0.0, 0.0, 0.0, 0.0, 0.0],
            {"distortion": "radtan", "distortion_coefficients": (0.1, 0.0, 0.0, 0.0)},
            "lens distortion",
        ),
        (
            [0.05, 0.0, 0.0, 0.0, 0.0, 0.0],
            {"distortion": "equidistant", "distortion_coefficients": (0.0, 0.0, 0.0, 0.0)},
            "lens distortion",
        ),
    ],
)
def test_the_defects_of_unrectified_cameras_are_named(
    right_from_left: list[float], lens: dict[str, object], defect: str
) -> None:
    plain = rectified_pair()
    step = se3.transform(so3.exp(np.array(right_from_left[3:])), np.array(right_from_left[:3]))
    right = plain.right.model_copy(update=lens)
    stereo = rectified_pair(right=right, body_right_camera=matrix4(plain.T_body_left_camera @ step))
    with pytest.raises(CalibrationMissing, match=f"not rectified, they have {defect}; tracks need"):
        RectifiedStereo.of(stereo)
