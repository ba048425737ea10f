# SPDX-License-Identifier: BSD-3-Clause
"""Walks whose readings tests alter and write in two formats."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from coclo_vio.datasets.dataset import DatasetConfig, open_dataset
from coclo_vio.datasets.recording_contents import RecordingContents
from coclo_vio.datasets.rosbag.writing.bag_writer import write_bag
from coclo_vio.datasets.writer import write_leg_log
from coclo_vio.diagnosis.all_checks import CHECKS
from coclo_vio.diagnosis.diagnose import Check, diagnose
from coclo_vio.diagnosis.evidence import Evidence
from coclo_vio.diagnosis.finding import Finding, Stage
from coclo_vio.robot.description import RobotDescription
from coclo_vio.values.config import parse_settings
from coclo_vio.values.measurements import FootForceSample, JointSample, Measurement
from coclo_vio.values.trajectory import GroundTruth, Trajectory

_STAGES = {Stage.JOINTS, Stage.CONTACT, Stage.GROUND_TRUTH}

JointChange = Callable[[np.ndarray, np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray, np.ndarray]]


@dataclass(frozen=True)
class Walk:
    """A sound recording."""

    robot: RobotDescription
    samples: Sequence[Measurement]
    truth: GroundTruth

    def with_joints(self, change: JointChange) -> "Walk":
        """The same with all readings of the joints (N, J) changed."""
        joints = [each for each in self.samples if isinstance(each, JointSample)]
        arrays = (np.array([getattr(each, name) for each in joints]) for name in ("position", "velocity", "effort"))
        rows = iter(zip(*change(*arrays), strict=True))
        changed = [
            JointSample(each.stamp_ns, *next(rows)) if isinstance(each, JointSample) else each for each in self.samples
        ]
        return Walk(self.robot, changed, self.truth)

    def with_forces(self, change: Callable[[np.ndarray], np.ndarray]) -> "Walk":
        """The same with the forces of each sample (legs,) changed."""
        changed = [
            FootForceSample(each.stamp_ns, change(each.force)) if isinstance(each, FootForceSample) else each
            for each in self.samples
        ]
        return Walk(self.robot, changed, self.truth)

    def with_truth(self, stamps_ns: np.ndarray, T_world_body: np.ndarray) -> "Walk":
        """The same with another ground truth."""
        return Walk(self.robot, self.samples, GroundTruth(Trajectory(stamps_ns, T_world_body), True, "truth"))

    def written(self, folder: Path, *, as_bag: bool = False) -> Path:
        """The path of the recording, a bag or a CSV file with its ground truth beside it."""
        folder.mkdir(exist_ok=True)
        if not as_bag:
            return write_leg_log(folder, self.robot, self.samples, self.truth)
        return write_bag(folder / "walk.mcap", RecordingContents(self.robot, self.samples, self.truth))

    def findings(self, path: Path, settings: Iterable[str] = ()) -> tuple[Finding, ...]:
        """What the checks of joints, contacts and ground truth find in the recording at a path."""
        values = parse_settings(list(settings)).get("dataset", {})
        dataset = open_dataset(path, self.robot, DatasetConfig.parse(values, "test"))
        evidence = Evidence(dataset, self.robot, self.robot.imu)
        checks: list[Check] = [check for check in CHECKS if check.stage in _STAGES]
        return diagnose(evidence, checks).findings
