# SPDX-License-Identifier: BSD-3-Clause
"""What the figures and the zoomable plots of a run are drawn from, each file read once."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

from coclo_vio.evaluation.evaluate import EvaluationConfig
from coclo_vio.evaluation.evaluation import Evaluation
from coclo_vio.runs import run_folder
from coclo_vio.runs.modes.registry import modes
from coclo_vio.runs.output_logs import read_keyframes
from coclo_vio.runs.run_folder import RecordedTrajectory
from coclo_vio.runs.run_record import RunRecord
from coclo_vio.values.arrays import Array
from coclo_vio.values.errors import EvaluationError
from coclo_vio.values.trajectory import Trajectory


@dataclass(frozen=True, eq=False)
class DrawnRun:
    """A run as figures and plots need it.

    Attributes:
        folder: of the run.
        record: of the run.
        evaluations: by trajectory; empty without ground truth.
        config: how they were compared.
    """

    folder: Path
    record: RunRecord
    evaluations: Mapping[str, Evaluation]
    config: EvaluationConfig

    @property
    def start_ns(self) -> int | None:
        """Stamp of the first measurement; None where nothing was read."""
        return None if self.record.recording_ns is None else self.record.recording_ns[0]

    @cached_property
    def estimates(self) -> dict[str, Trajectory]:
        """In the world of the ground truth where there is one, otherwise in that of each estimator."""
        if self.evaluations:
            return {name: evaluation.estimate for name, evaluation in self.evaluations.items()}
        estimated = [name for name, run in self.record.estimators.items() if run.estimates]
        if not estimated:
            raise EvaluationError(f"{self.folder} has no estimate to draw")
        return {name: run_folder.read_estimates(self.folder, name).trajectory for name in estimated}

    @property
    def references(self) -> dict[str, Trajectory]:
        """The ground truth on the clock of each evaluated trajectory."""
        return {name: evaluation.reference for name, evaluation in self.evaluations.items()}

    @property
    def reference(self) -> Trajectory | None:
        """The first of them."""
        return next(iter(self.references.values()), None)

    @property
    def events(self) -> dict[str, list[int]]:
        """Stamps of the events of all modes, by kind."""
        stamps: dict[str, list[int]] = {}
        for _, event in self.record.events():
            stamps.setdefault(f"event: {event.kind}", []).append(event.stamp_ns)
        return stamps

    @property
    def with_covariance(self) -> dict[str, Trajectory]:
        """Featured trajectories of leg odometry whose covariance is known."""
        legs = {
            mode.trajectories[0].name for mode in modes().values() if mode.has_legs and mode.trajectories[0].is_featured
        }
        return {name: one for name, one in self.estimates.items() if name in legs and one.covariance is not None}

    @property
    def keyframes(self) -> dict[str, Mapping[str, Array]]:
        """Columns of the keyframes by trajectory, of those that have some."""
        found = ((name, read_keyframes(self.folder, name)) for name in self.record.estimators)
        return {name: columns for name, columns in found if columns is not None}

    @cached_property
    def with_feet(self) -> RecordedTrajectory | None:
        """The first trajectory that has contact probabilities."""
        recorded = (run_folder.read_estimates(self.folder, name) for name in self.estimates)
        return next((one for one in recorded if one.leg_names), None)
