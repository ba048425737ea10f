# SPDX-License-Identifier: BSD-3-Clause
"""The commands that are ended, and the short recordings that they run on."""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import takewhile
from pathlib import Path
from typing import Literal

import numpy as np

from coclo_vio.datasets.dataset import open_dataset
from coclo_vio.datasets.images import encoded
from coclo_vio.datasets.recording_contents import RecordingContents
from coclo_vio.datasets.rosbag.writing.bag_writer import write_bag
from coclo_vio.datasets.sample import sample_path
from coclo_vio.datasets.writer import write_euroc_folder
from coclo_vio.experiments.table.plan import TablePlan
from coclo_vio.robot.description import load_robot
from coclo_vio.robot.model import RobotModel
from coclo_vio.simulation.analytic import AnalyticTrialConfig, generate
from coclo_vio.simulation.body_motion import BodyMotionConfig
from coclo_vio.simulation.simulated_recording import SIMULATED_ROBOT, truth_folder
from coclo_vio.values.config import write_yaml
from coclo_vio.values.errors import DatasetError
from coclo_vio.values.measurements import ALL_SENSORS, EncodedStereoFrame, Measurement, StereoFrame
from coclo_vio.values.trajectory import GroundTruth, write_tum
from coclo_vio.values.units import NS_PER_S

CUT_S = 12.0
"""How much of the sample modes with cameras run over: standing for 2 s, then walking."""
_TABLE_SEED, _TABLE_SEEDS = 11, 2
WALK = BodyMotionConfig(rest_s=1.0, walk_s=12.0, stop_s=1.0)
"""Of the recordings of the table."""


@dataclass(frozen=True, slots=True)
class Case:
    """A command and its modes; ``more`` are further arguments."""

    command: Literal["run", "compare", "table"]
    modes: str
    more: tuple[str, ...]

    @property
    def name(self) -> str:
        """For a folder."""
        return f"{self.command}_{self.modes.replace(',', '_')}"

    def arguments(self, folder: Path) -> list[str]:
        """The command line."""
        return [
            self.command,
            *self.more,
            "--mode" if self.command == "run" else "--modes",
            self.modes,
            "-o",
            str(folder),
        ]

    def resuming(self, folder: Path) -> list[str]:
        """The command line that goes on; that of a table is the same."""
        return [*self.arguments(folder), *([] if self.command == "table" else ["--resume"])]


def all_cases(folder: Path, interval_s: float, leg_modes: str, visual_modes: str, table_modes: str) -> list[Case]:
    """The commands; recordings that are missing are written.

    Args:
        folder: for the recordings.
        interval_s: seconds of recording between two checkpoints.
        leg_modes: each is run over the bundled sample, and all of them compared; separated by commas.
        visual_modes: each is run over the first ``CUT_S`` seconds of the sample.
        table_modes: of a table over short walks.

    Raises:
        DatasetError: a recording cannot be written.
    """
    folder.mkdir(parents=True, exist_ok=True)
    checkpoints = ("--robot", "daisy", "--set", f"checkpoints.interval_s={interval_s}")
    cases = [Case("run", mode, (str(sample_path()), *checkpoints)) for mode in _names(leg_modes)]
    if len(_names(leg_modes)) > 1:
        cases.append(Case("compare", leg_modes, (str(sample_path()), *checkpoints)))
    if visual_modes:
        cut = write_cut(folder / "cut.mcap", CUT_S)
        cases += [Case("run", mode, (str(cut), *checkpoints)) for mode in _names(visual_modes)]
    if table_modes:
        made = write_walks(folder / "walks")
        seeds = ("--seeds", str(_TABLE_SEEDS), "--first-seed", str(_TABLE_SEED), "--policy-seeds", "0")
        cases.append(
            Case("table", table_modes, (*seeds, "--trials", "flat", "--workers", "2", "--recordings", str(made)))
        )
    return cases


def _names(text: str) -> list[str]:
    return [name for name in text.split(",") if name]


def write_cut(path: Path, length_s: float) -> Path:
    """The beginning of the bundled sample with its images, as a bag; where it is there already it stays.

    Raises:
        DatasetError: it cannot be written.
    """
    if path.exists():
        return path
    robot = load_robot("daisy")
    sample = open_dataset(sample_path(), robot)
    begin_ns = next(iter(sample.measurements(ALL_SENSORS))).stamp_ns
    end_ns = begin_ns + round(length_s * NS_PER_S)

    def part(sensors: frozenset[type]) -> Iterator[Measurement]:
        return takewhile(lambda measurement: measurement.stamp_ns < end_ns, sample.measurements(sensors))

    def frames() -> Iterator[EncodedStereoFrame]:
        for frame in part(frozenset({StereoFrame})):
            if isinstance(frame, StereoFrame):
                left, right = (encoded(image, "png") for image in (frame.left, frame.right))
                yield EncodedStereoFrame(frame.stamp_ns, left, right, "png")

    truth = sample.ground_truth()
    if truth is None:
        raise DatasetError(f"{sample_path()} has no ground truth; install the package again")
    poses = truth.trajectory.select(np.flatnonzero(truth.trajectory.stamps_ns < end_ns))
    contents = RecordingContents(
        robot,
        part(ALL_SENSORS - {StereoFrame}),
        GroundTruth(poses, truth.has_stamps, truth.source),
        sample.imu_calibration(),
        sample.camera_imu_calibration(),
        sample.stereo_calibration(),
        frames(),
    )
    half = path.with_stem(f"{path.stem}_half")
    half.unlink(missing_ok=True)
    write_bag(half, contents)
    return half.rename(path)


def write_walks(folder: Path) -> Path:
    """Short analytic walks without images in the place of a table's recordings; those that are there stay.

    Raises:
        DatasetError: they cannot be written.
    """
    robot = load_robot(SIMULATED_ROBOT)
    for seed in range(_TABLE_SEED, _TABLE_SEED + _TABLE_SEEDS):
        path = folder / f"flat_{seed}"
        if (truth_folder(path) / "config.yaml").exists():
            continue
        folder.mkdir(parents=True, exist_ok=True)
        trial = generate(AnalyticTrialConfig(body=WALK), RobotModel(robot), seed=seed)
        truth = GroundTruth(trial.truth, True, "truth")
        write_euroc_folder(path, RecordingContents(robot, trial.measurements, truth, imu=robot.imu))
        truth_folder(path).mkdir(exist_ok=True)
        write_tum(trial.truth, truth_folder(path) / "groundtruth.tum")
        write_yaml(TablePlan().simulation_of("flat"), truth_folder(path) / "config.yaml")
    return folder
