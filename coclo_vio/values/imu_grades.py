# SPDX-License-Identifier: BSD-3-Clause
"""Grades of IMUs: noise densities, bias walks and biases at switch-on that an IMU has unless they are given.

The biases are those of the part as mounted and calibrated by its maker, a year later: "bias repeatability" or "offset"
of a data sheet, which is one sigma or a typical value, each axis. The random walks of the biases are not in data
sheets; they are chosen such that the bias changes by about its in-run instability in a few minutes.

Sources, by grade; the figures are as remembered of the data sheets and were not checked against them:

* ``tactical``: Honeywell HG4930 (angle random walk 0.04 deg/sqrt(h), velocity random walk 0.03 m/s/sqrt(h), bias
  repeatability 20 deg/h and 1.7 mg).
* ``calibrated_mems``: Xsens MTi of the 10 and 100 series (0.03 and 0.01 deg/s/sqrt(Hz), 60 to 80 ug/sqrt(Hz), bias
  repeatability over a year 0.2 deg/s and 0.03 m/s^2); VectorNav VN-100 (0.0035 deg/s/sqrt(Hz), 140 ug/sqrt(Hz)) is of
  this grade.
* ``cheap_mems``: Bosch BMI055, as in the RealSense D435i (0.014 deg/s/sqrt(Hz), 150 ug/sqrt(Hz), offsets of 1 deg/s and
  70 mg), BMI088 (1 deg/s and 20 mg) and InvenSense ICM-20948 (offsets of 5 deg/s and 50 mg as soldered): 10 mg, which
  takes the 20 mg of the better of them as two sigmas; the others need a calibration by their user, or a value of their
  own. Where nothing turns the robot, a bias is not distinguishable from tilt, and the estimate of tilt wanders within
  the prior.

The scale of a gyroscope: 300 ppm (HG4930), 0.1 % (MTi, non-linearity and residual of its calibration), and a
sensitivity tolerance of 1 % (BMI055, BMI088), 1.5 % (ICM-20948) and 3 % (MPU-6000): 1 %.
"""

from typing import Literal, NamedTuple

ImuGrade = Literal["tactical", "calibrated_mems", "cheap_mems"]


class ImuErrors(NamedTuple):
    """Errors of an IMU, each axis.

    Attributes:
        gyroscope_noise_density: white noise, rad/s/sqrt(Hz).
        gyroscope_bias_walk: rad/s^2/sqrt(Hz).
        gyroscope_bias: one sigma at switch-on, rad/s.
        gyroscope_scale: one sigma of the relative error of its scale.
        accelerometer_noise_density: white noise, m/s^2/sqrt(Hz).
        accelerometer_bias_walk: m/s^3/sqrt(Hz).
        accelerometer_bias: one sigma at switch-on, m/s^2.
    """

    gyroscope_noise_density: float
    gyroscope_bias_walk: float
    gyroscope_bias: float
    gyroscope_scale: float
    accelerometer_noise_density: float
    accelerometer_bias_walk: float
    accelerometer_bias: float


ERRORS_OF_GRADE: dict[ImuGrade, ImuErrors] = {
    "tactical": ImuErrors(1.2e-5, 1e-7, 1e-4, 3e-4, 5e-4, 1e-5, 0.017),
    "calibrated_mems": ImuErrors(2e-4, 5e-6, 3.5e-3, 1e-3, 8e-4, 5e-5, 0.03),
    "cheap_mems": ImuErrors(2e-4, 2e-5, 0.02, 0.01, 2e-3, 3e-4, 0.1),
}
"""The errors that each grade stands for; the sources are above."""
