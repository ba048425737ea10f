# SPDX-License-Identifier: BSD-3-Clause
from typing import get_args

import pytest

from coclo_vio.values.calibration import ImuCalibration
from coclo_vio.values.errors import ConfigError
from coclo_vio.values.imu_grades import ERRORS_OF_GRADE, ImuErrors, ImuGrade


@pytest.mark.parametrize("grade", get_args(ImuGrade))
def test_what_is_not_given_is_that_of_the_grade(grade: ImuGrade) -> None:
    imu = ImuCalibration(grade=grade, gyroscope_bias=0.07)
    expected = ERRORS_OF_GRADE[grade]._replace(gyroscope_bias=0.07)
    assert ImuErrors(*(getattr(imu, name) for name in ImuErrors._fields)) == expected


def test_without_a_grade_an_imu_is_cheap() -> None:
    imu = ImuCalibration()
    assert imu == ImuCalibration(grade="cheap_mems")
    assert tuple(getattr(imu, name) for name in ImuErrors._fields) == ERRORS_OF_GRADE["cheap_mems"]


def test_each_grade_is_better_than_the_next() -> None:
    tactical, calibrated, cheap = ERRORS_OF_GRADE.values()
    for better, worse in ((tactical, calibrated), (calibrated, cheap)):
        assert all(one <= other for one, other in zip(better, worse, strict=True))
        assert better.accelerometer_bias < worse.accelerometer_bias
        assert better.gyroscope_bias < worse.gyroscope_bias


def test_another_grade_replaces_what_was_not_given() -> None:
    given = ImuCalibration(grade="tactical", accelerometer_noise_density=0.01).model_dump(exclude_unset=True)
    changed = ImuCalibration.parse(given | {"grade": "cheap_mems"}, "test")
    assert changed.gyroscope_bias == ERRORS_OF_GRADE["cheap_mems"].gyroscope_bias
    assert changed.accelerometer_noise_density == 0.01


def test_an_unknown_grade_lists_the_known_ones() -> None:
    with pytest.raises(ConfigError, match=r"robot\.yaml: grade = 'navigation': .*'tactical', .*'cheap_mems'"):
        ImuCalibration.parse({"grade": "navigation"}, "robot.yaml")
