# SPDX-License-Identifier: BSD-3-Clause
import dataclasses
import pickle
from dataclasses import fields

import numpy as np
import pytest

from coclo_vio.values.arrays import has_nan, is_finite
from coclo_vio.values.measurements import (
    ALL_SENSORS,
    LEG_SENSORS,
    VISION_SENSORS,
    BodyTwistSample,
    CameraImuSample,
    FootForceSample,
    ImuSample,
    JointSample,
    Measurement,
    StereoFrame,
    StereoTracks,
)

_NONE = np.full(3, np.nan)


def test_a_wrong_length_is_refused_with_both_shapes() -> None:
    with pytest.raises(ValueError, match=r"ImuSample.angular_velocity must have shape \(3,\), got \(2,\)"):
        ImuSample(0, np.zeros(2), np.zeros(3))
    with pytest.raises(ValueError, match=r"JointSample.effort must have shape \(3,\), got \(4,\)"):
        JointSample(0, np.zeros(3), np.zeros(3), np.zeros(4))
    with pytest.raises(ValueError, match=r"FootForceSample.force must have shape \('any',\), got \(\)"):
        FootForceSample(0, np.float64(3.0))  # type: ignore[arg-type]


def test_an_imu_reading_must_be_finite() -> None:
    for value in (np.nan, np.inf):
        with pytest.raises(ValueError, match=rf"ImuSample.specific_force must be finite, got {value} at index \(1,\)"):
            ImuSample(0, np.zeros(3), np.array([0.0, value, 9.81]))


def test_joint_and_foot_readings_may_be_missing_but_not_infinite() -> None:
    assert np.isnan(JointSample(0, _NONE, _NONE, _NONE).position).all()
    assert np.isnan(FootForceSample(0, _NONE).force).all()
    infinite = np.array([0.0, -np.inf, 0.0])
    with pytest.raises(ValueError, match=r"JointSample.velocity must be finite, got -inf"):
        JointSample(0, _NONE, infinite, _NONE)
    with pytest.raises(ValueError, match=r"FootForceSample.force must be finite, got -inf"):
        FootForceSample(0, infinite)


def test_samples_are_read_only_copies() -> None:
    readings = np.zeros(3)
    sample = ImuSample(5, readings, np.array([0.0, 0.0, 9.81]))
    readings[0] = 1.0
    np.testing.assert_array_equal(sample.angular_velocity, np.zeros(3))
    with pytest.raises(ValueError, match="read-only"):
        sample.angular_velocity[0] = 1.0
    with pytest.raises(dataclasses.FrozenInstanceError):
        sample.stamp_ns = 6  # type: ignore[misc]


def test_readings_become_float64() -> None:
    sample = JointSample(0, [1, 2], np.array([1, 2], dtype=np.float32), [0, 0])  # type: ignore[arg-type]
    assert {sample.position.dtype, sample.velocity.dtype, sample.effort.dtype} == {np.dtype(np.float64)}


def test_the_camera_imu_is_a_type_of_its_own() -> None:
    camera_imu = CameraImuSample(0, np.zeros(3), np.zeros(3))
    assert not isinstance(camera_imu, ImuSample)
    with pytest.raises(ValueError, match=r"CameraImuSample.specific_force must have shape \(3,\)"):
        CameraImuSample(0, np.zeros(3), np.zeros(2))
    assert LEG_SENSORS.isdisjoint(VISION_SENSORS)
    assert LEG_SENSORS | VISION_SENSORS == ALL_SENSORS


def test_a_stereo_frame_is_two_grey_images_of_one_size() -> None:
    grey = np.arange(6, dtype=np.uint8).reshape(2, 3)
    frame = StereoFrame(5, grey, grey)
    with pytest.raises(ValueError, match="read-only"):
        frame.left[0, 0] = 1
    grey[0, 0] = 9  # images are not copied
    assert frame.right[0, 0] == 9
    with pytest.raises(ValueError, match=r"StereoFrame.right must be \(rows, columns\) of uint8, got \(2, 3, 3\)"):
        StereoFrame(5, grey, np.zeros((2, 3, 3), dtype=np.uint8))
    with pytest.raises(ValueError, match=r"StereoFrame.left must be .* uint16"):
        StereoFrame(5, grey.astype(np.uint16), grey)  # type: ignore[arg-type]
    with pytest.raises(ValueError, match=r"\(2, 3\), the right one \(3, 2\); they must agree"):
        StereoFrame(5, grey, grey.T)


def test_track_arrays_agree_in_length_and_identities_are_unique() -> None:
    pixels = np.array([[10.0, 20.0], [30.0, 40.0]])
    with pytest.raises(ValueError, match=r"StereoTracks.right_px must have shape \(2, 2\), got \(1, 2\)"):
        StereoTracks(0, np.arange(2), pixels, pixels[:1])
    with pytest.raises(ValueError, match=r"StereoTracks.track_ids must have shape \(2,\), got \(3,\)"):
        StereoTracks(0, np.arange(3), pixels, pixels)
    with pytest.raises(ValueError, match="has a repeated identity at 7 ns"):
        StereoTracks(7, np.array([4, 4]), pixels, pixels)


def test_a_point_may_be_missing_in_the_right_image_only() -> None:
    pixels, missing = np.array([[10.0, 20.0]]), np.full((1, 2), np.nan)
    assert np.isnan(StereoTracks(0, np.arange(1), pixels, missing).right_px).all()
    with pytest.raises(ValueError, match=r"StereoTracks.left_px must be finite, got nan"):
        StereoTracks(0, np.arange(1), missing, pixels)


def test_tracks_of_unknown_age_are_new() -> None:
    assert StereoTracks(0, np.arange(3), np.zeros((3, 2)), np.zeros((3, 2))).ages.tolist() == [1, 1, 1]


def test_a_twist_must_be_finite() -> None:
    with pytest.raises(ValueError, match=r"BodyTwistSample.velocity must be finite, got inf at index \(2,\)"):
        BodyTwistSample(0, np.zeros(3), np.array([0.0, 0.0, np.inf]))


def test_a_value_that_is_not_finite_is_found_at_any_index() -> None:
    values = np.random.default_rng(4).normal(scale=1e200, size=(3, 5))  # their squares overflow
    assert not has_nan(values)
    assert is_finite(values)
    for index in np.ndindex(values.shape):
        gap = values.copy()
        gap[index] = np.nan
        assert has_nan(gap)
        assert not is_finite(gap)
        gap[index] = -np.inf
        assert not is_finite(gap)


def test_other_velocities_are_checked_like_the_first() -> None:
    sample = JointSample(5, np.arange(3.0), np.zeros(3), np.full(3, np.nan))
    other = sample.with_velocity(np.array([1.0, np.nan, 3.0]))
    assert other.stamp_ns == 5
    np.testing.assert_array_equal(other.position, sample.position)
    np.testing.assert_array_equal(other.velocity, [1.0, np.nan, 3.0])
    assert not other.velocity.flags.writeable
    with pytest.raises(ValueError, match=r"JointSample.velocity must have shape \(3,\), got \(2,\)"):
        sample.with_velocity(np.zeros(2))
    with pytest.raises(ValueError, match="must be finite, got inf at index"):
        sample.with_velocity(np.array([0.0, np.inf, 0.0]))


@pytest.mark.parametrize(
    "sample",
    [
        ImuSample(3, np.arange(3.0), np.arange(3.0, 6.0)),
        CameraImuSample(np.int64(4), np.zeros(3), np.ones(3)),
        JointSample(5, np.array([0.1, np.nan]), np.array([np.nan, 0.2]), np.full(2, np.nan)),
        FootForceSample(6, np.array([1.0, np.nan, 3.0])),
        FootForceSample(7, np.zeros(0)),
    ],
    ids=lambda sample: type(sample).__name__,
)
def test_samples_are_the_same_in_another_process(sample: Measurement) -> None:
    there = pickle.loads(pickle.dumps(sample))
    assert type(there) is type(sample)
    assert there.stamp_ns == sample.stamp_ns
    for name in (field.name for field in fields(sample) if field.name != "stamp_ns"):
        np.testing.assert_array_equal(getattr(there, name), getattr(sample, name))
        assert not getattr(there, name).flags.writeable
