# SPDX-License-Identifier: BSD-3-Clause
"""What ``LegOdometryFilter`` asks of a profile."""

from typing import Protocol

from coclo_vio.filter.imu_delay import ImuDelay
from coclo_vio.filter.initialisation import FootPrior
from coclo_vio.filter.leg_check import LegCheck
from coclo_vio.filter.square_root_filter import SquareRootFilter
from coclo_vio.filter.stance import Reading
from coclo_vio.filter.state import StateLayout
from coclo_vio.robot.leg_sensing import InertialStep
from coclo_vio.values.arrays import BoolArray


class Profile(Protocol):
    """The steps of the filter, and the blocks of its state.

    Attributes:
        layout: of the state.
        is_wide: sigma points as far away as in the paper, see ``SquareRootFilter``.
        can_coast: whether ``coast`` is there, which predicts across gaps of the joints.
        leg_check: compares each leg with the others; None before the start, and where the profile has none.
        creep_level: the random walk of a foot in stance, as a multiple of the declared one; 1 until others set it.
        imu_delay: of the gyroscope behind the joints; None before the start, and where the profile knows none.
    """

    layout: StateLayout
    is_wide: bool
    can_coast: bool
    leg_check: LegCheck | None
    imu_delay: ImuDelay | None
    creep_level: float

    def start(self, reading: Reading) -> None:
        """Take the first reading."""

    def foot_prior(self, reading: Reading) -> FootPrior:
        """Uncertainty of the feet at the start."""

    def step(
        self, core: SquareRootFilter, reading: Reading, dt_s: float, gyroscope_noise_radps: float, *, is_gap: bool
    ) -> BoolArray:
        """Predict to the reading and update by it; returns the legs that were used as stance, (n,)."""

    def coast(self, core: SquareRootFilter, step: InertialStep, dt_s: float, gyroscope_noise_radps: float) -> None:
        """One step without joints, to a sample of the IMU."""
