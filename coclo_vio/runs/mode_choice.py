# SPDX-License-Identifier: BSD-3-Clause
"""Which modes a recording is enough for: those that ``compare`` runs, and the one that ``run`` takes."""

from collections.abc import Iterator
from pathlib import Path

from coclo_vio.datasets.dataset import Dataset, open_dataset
from coclo_vio.runs.equipment import Equipment, sensors_of
from coclo_vio.runs.modes.mode import Compared, Mode, Need
from coclo_vio.runs.modes.registry import modes
from coclo_vio.runs.run_config import RunConfig
from coclo_vio.values.errors import DatasetError
from coclo_vio.values.measurements import IMAGE_SENSORS, IMU_SENSORS, VISION_SENSORS, BodyTwistSample, JointSample


def default_mode(path: Path, config: RunConfig) -> str:
    """The mode that ``run`` takes: of those that a recording is enough for the one with the lowest ``default_rank``.

    Raises:
        DatasetError: no such path, or no known format.
    """
    met, _ = _met_needs(path, config)
    enough = [mode for mode in modes().values() if mode.needs <= met]
    ranked = [(mode.default_rank, mode.name) for mode in enough if mode.default_rank is not None]
    return min(ranked)[1]


def compared_modes(path: Path, config: RunConfig) -> tuple[str, ...]:
    """The modes that ``compare`` runs: those of legs, of cameras whose calibration is known, and of both.

    Raises:
        DatasetError: no such path, or no known format.
    """
    met, has_legs = _met_needs(path, config)
    return tuple(mode.name for mode in modes().values() if mode.needs <= met and _is_compared(mode, has_legs=has_legs))


def _met_needs(path: Path, config: RunConfig) -> tuple[set[Need], bool]:
    """The needs that a recording meets, and whether it has legs.

    A recording without cameras is taken to have legs, and one without legs to have calibrated cameras, also where
    the robot or a calibration is missing: running a mode raises the error that names it.
    """
    dataset = open_dataset(path, config.robot, config.dataset)
    sensors = sensors_of(dataset)
    has_legs = config.robot is not None and JointSample in sensors
    if not sensors & IMAGE_SENSORS:
        return {Need.LEGS} | ({Need.BODY_TWIST} if BodyTwistSample in sensors else set()), has_legs
    met = {Need.LEGS} if has_legs else set()
    return met | set(_met_by_cameras(dataset, config, sensors, needs_calibration=has_legs)), has_legs


def _is_compared(mode: Mode, *, has_legs: bool) -> bool:
    return mode.compared is Compared.ALWAYS or (mode.compared is Compared.WITHOUT_LEGS and not has_legs)


def _met_by_cameras(
    dataset: Dataset, config: RunConfig, sensors: frozenset[type], *, needs_calibration: bool
) -> Iterator[Need]:
    """The needs that cameras and what goes with them meet."""
    has_stereo, has_imu = _calibrated(dataset, config) if needs_calibration else (True, True)
    if has_stereo:
        yield Need.CAMERAS
    if sensors & IMU_SENSORS and has_imu:
        yield Need.IMU
    if BodyTwistSample in sensors:
        yield Need.BODY_TWIST


def _calibrated(dataset: Dataset, config: RunConfig) -> tuple[bool, bool]:
    """Whether the calibration of the cameras is known, and of an IMU that goes with them."""
    try:
        equipment = Equipment.of(dataset, config, VISION_SENSORS)
    except DatasetError:
        return False, False
    return equipment.stereo is not None, equipment.vision_imu is not None
