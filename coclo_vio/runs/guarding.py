# SPDX-License-Identifier: BSD-3-Clause
"""The estimator of a mode behind the guard, for recordings and online alike."""

from coclo_vio.online.guarded_estimator import GuardedEstimator
from coclo_vio.runs.equipment import Equipment
from coclo_vio.runs.modes.mode import Mode, Need
from coclo_vio.runs.run_config import RunConfig


def guarded(mode: Mode, equipment: Equipment, config: RunConfig) -> GuardedEstimator:
    """A fresh estimator of a mode behind the guard.

    Args:
        mode: which.
        equipment: what there is.
        config: of all stages, ``online`` among them.

    Raises:
        CocloError: as ``Mode.make``.
    """
    is_levelled = mode.has_legs or Need.IMU in mode.needs
    return GuardedEstimator(lambda: mode.make(equipment, config), config.online, is_levelled=is_levelled)
