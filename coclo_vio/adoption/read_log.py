# SPDX-License-Identifier: BSD-3-Clause
"""A log that was read with the joints of a URDF, in SI units and with its signs."""

from dataclasses import dataclass

from coclo_vio.adoption.adoption import AdoptedField
from coclo_vio.adoption.recorded_legs import RecordedLegs
from coclo_vio.adoption.stance_motion import FeetMotion
from coclo_vio.robot.model import RobotModel


@dataclass(frozen=True, slots=True, eq=False)
class ReadLog:
    """A log as the steps after reading take it.

    Attributes:
        robot: legs in the order of the log.
        recorded: joints, IMU and foot forces.
        motion: of the feet.
        fields: found while it was read.
        settings: with which it has to be read, beside those of the joints.
    """

    robot: RobotModel
    recorded: RecordedLegs
    motion: FeetMotion
    fields: tuple[AdoptedField, ...]
    settings: tuple[str, ...]
