# SPDX-License-Identifier: BSD-3-Clause
"""Samples of a sensor as arrays."""

from dataclasses import dataclass

from coclo_vio.values.arrays import Array, IntArray


@dataclass(frozen=True, slots=True, eq=False)
class InertialRecord:
    """Readings of an IMU, in its own frame.

    Attributes:
        stamps_ns: (N,).
        rate: rad/s, (N, 3).
        force: m/s^2, (N, 3).
    """

    stamps_ns: IntArray
    rate: Array
    force: Array


@dataclass(frozen=True, slots=True, eq=False)
class JointRecord:
    """Readings of all joints, NaN where there is none.

    Attributes:
        stamps_ns: (N,).
        position: rad, (N, J).
        velocity: rad/s, (N, J).
        effort: Nm, (N, J).
    """

    stamps_ns: IntArray
    position: Array
    velocity: Array
    effort: Array


@dataclass(frozen=True, slots=True, eq=False)
class ForceRecord:
    """Readings of the foot sensors.

    Attributes:
        stamps_ns: (N,).
        force: (N, legs), in the unit of the recording.
    """

    stamps_ns: IntArray
    force: Array
