# SPDX-License-Identifier: BSD-3-Clause
"""The entries of a log before any robot is known: names of joints and of foot forces, as far as it has any."""

import re
from dataclasses import dataclass
from pathlib import Path

from coclo_vio.datasets.config import DatasetConfig
from coclo_vio.datasets.csv_table import CsvTable
from coclo_vio.datasets.dataset import robot_fit
from coclo_vio.datasets.leg_log import find_log, is_leg_log
from coclo_vio.datasets.rosbag.bag_preview import preview_of
from coclo_vio.datasets.rosbag.message_types import JOINT_STATE
from coclo_vio.datasets.rosbag.storage.bag_file import BagFile
from coclo_vio.datasets.rosbag.storage.files import is_rosbag


@dataclass(frozen=True, slots=True)
class LogEntries:
    """What a log names.

    Attributes:
        names: of the joints, in the order of the log; empty where it has none.
        size: number of angles in a reading.
        is_named: whether each angle has a name.
        is_bag: whether the log is a rosbag, whose entries can be named by settings.
        force_names: legs that the foot forces of a leg log are named after.
    """

    names: tuple[str, ...]
    size: int
    is_named: bool
    is_bag: bool
    force_names: tuple[str, ...]


def log_entries(path: Path, config: DatasetConfig) -> LogEntries:
    """Look at the header of a log, or at the first joint messages of a bag.

    Raises:
        DatasetError: no such path, no known format, or a damaged file.
    """
    if path.exists() and is_rosbag(path):
        return _of_bag(path, config)
    names = robot_fit(path, config).joints
    forces: tuple[str, ...] = ()
    if is_leg_log(path):
        header = CsvTable.open(find_log(path, config.columns)).header
        patterns = [re.escape(pattern).replace(r"\{leg\}", "(.+)") for pattern in config.columns.force]
        found = (re.fullmatch(pattern, name) for name in header for pattern in patterns)
        forces = tuple(dict.fromkeys(match[1] for match in found if match))
    return LogEntries(names, len(names), True, False, forces)


def _of_bag(path: Path, config: DatasetConfig) -> LogEntries:
    preview = preview_of(BagFile(path, allow_partial=True), config.rosbag.types)
    best: tuple[int, tuple[str, ...], bool] = (0, (), True)
    for topic in preview.of_type(JOINT_STATE):
        message, names = preview.first.get(topic), preview.entries.get(topic, ())
        if message is None:
            continue
        size = len(message.position)
        is_named = size == len(message.name)
        known = tuple(names) if names else tuple(message.name)
        if max(size, len(known)) > best[0]:
            best = max(size, len(known)) if is_named else size, known, is_named
    return LogEntries(best[1], best[0], best[2], True, ())
