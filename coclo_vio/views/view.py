# SPDX-License-Identifier: BSD-3-Clause
"""What a view is from the outside, and what it has to know of the robot and the recording."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

from coclo_vio.robot.description import RobotDescription
from coclo_vio.values.arrays import ByteImage
from coclo_vio.values.measurements import Measurement
from coclo_vio.values.outputs import Output
from coclo_vio.values.trajectory import Trajectory


@runtime_checkable
class View(Protocol):
    """Shows what goes into an estimator and what comes out; whoever runs the estimator calls it.

    Nothing that it is given makes it fail, so that it never ends a run.
    """

    def measurement(self, measurement: Measurement) -> None:
        """Take a measurement, before the outputs that it leads to."""

    def take(self, output: Output) -> None:
        """Take an output."""

    def close(self) -> None:
        """Finish the file and end the server; nothing may follow."""


@dataclass(frozen=True, slots=True, eq=False)
class Setting:
    """What a view shows besides measurements and outputs.

    Attributes:
        robot: drawn with its joints; None where it is not known.
        ground_truth: drawn beside the estimates, placed on the first of them; None where there is none.
        encode: an image (rows, columns, 3), blue, green, red, to the bytes of a JPEG file; None leaves images out.
    """

    robot: RobotDescription | None = None
    ground_truth: Trajectory | None = None
    encode: Callable[[ByteImage], bytes] | None = None
