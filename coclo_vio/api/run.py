# SPDX-License-Identifier: BSD-3-Clause
"""Modes over a recording, and what comes out: trajectories, events, learnt calibration, metrics, figures."""

import shutil
import tempfile
import weakref
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from functools import cached_property
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING

from coclo_vio.api.recording import Recording, open_recording
from coclo_vio.datasets.config import DatasetConfig
from coclo_vio.datasets.ground_truth import read_ground_truth
from coclo_vio.datasets.read_report import ReadTally
from coclo_vio.evaluation.evaluate import EvaluationConfig
from coclo_vio.evaluation.evaluation import Evaluation
from coclo_vio.runs import evaluating, run_folder
from coclo_vio.runs.equipment import check_pictures
from coclo_vio.runs.evaluating import evaluation_config
from coclo_vio.runs.modes.registry import mode_of, modes
from coclo_vio.runs.observers import Observers, Progress, Watch
from coclo_vio.runs.output_logs import read_calibrations, read_health
from coclo_vio.runs.run_figures import check_figure, draw_figure
from coclo_vio.runs.run_folder import Existing, RecordedTrajectory
from coclo_vio.runs.run_record import RunRecord
from coclo_vio.runs.running import Ending, run_modes
from coclo_vio.values.errors import ConfigError, DatasetError, EvaluationError, listing
from coclo_vio.values.outputs import Calibration, Event, KeyframeHealth
from coclo_vio.values.trajectory import GroundTruth, Trajectory
from coclo_vio.views.view import View

if TYPE_CHECKING:
    from matplotlib.figure import Figure


class Run:
    """One or several modes over a recording, as they stand in a run folder.

    Attributes:
        folder: of the run; a temporary one, removed with this object, unless a folder was given.
        record: what ``run.json`` holds: by trajectory sensors, counts, times, events and failures.
    """

    def __init__(self, folder: Path, record: RunRecord, *, remove: Callable[[], None] | None = None) -> None:
        """Read a run folder.

        Args:
            folder: of the run.
            record: its ``run.json``.
            remove: removes the folder; called once this object is gone. None keeps the folder.
        """
        self.folder, self.record = folder, record
        if remove is not None:
            weakref.finalize(self, remove)

    def __repr__(self) -> str:
        return f"Run({', '.join(self.names)}; {len(self.events)} events; {self.folder})"

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the trajectories."""
        return tuple(self.record.estimators)

    @property
    def failures(self) -> Mapping[str, str]:
        """Why modes stopped early, by mode; empty where all went through."""
        return {mode: run.failure for mode, run in self.record.by_mode().items() if run.failure is not None}

    @cached_property
    def trajectories(self) -> Mapping[str, Trajectory]:
        """The trajectories that have poses, by name, with velocity and covariance."""
        return MappingProxyType(
            {name: self.estimates(name).trajectory for name, run in self.record.estimators.items() if run.estimates}
        )

    def estimates(self, name: str | None = None) -> RecordedTrajectory:
        """Everything estimated of one trajectory: poses, velocities, rates, biases, covariance, contact probability.

        Args:
            name: of the trajectory; the first one if None.

        Raises:
            DatasetError: the run has no such trajectory, or it has no pose.
        """
        name = name or self.names[0]
        if name not in self.record.estimators:
            raise DatasetError(f"{self.folder} has no trajectory {name!r}; it has {listing(self.names)}")
        of_run = self.record.estimators[name]
        if not of_run.estimates:
            raise DatasetError(f"{self.folder} has no pose of {name!r}: {of_run.failure or 'the mode gave none'}")
        return run_folder.read_estimates(self.folder, name)

    @property
    def events(self) -> tuple[Event, ...]:
        """What happened in the estimators, in the order of their stamps."""
        events = [Event(event.stamp_ns, event.kind, event.detail) for _, event in self.record.events()]
        return tuple(sorted(events, key=lambda event: event.stamp_ns))

    @property
    def health(self) -> tuple[KeyframeHealth, ...]:
        """The keyframes of the sliding windows, in the order of the trajectories."""
        return tuple(health for name in self.names for health in read_health(self.folder, name))

    @property
    def calibrations(self) -> tuple[Calibration, ...]:
        """What was learnt of the cameras, keyframe by keyframe; empty for modes that do not learn any."""
        return tuple(calibration for name in self.names for calibration in read_calibrations(self.folder, name))

    @property
    def calibration(self) -> Calibration | None:
        """What had been learnt of the cameras by the end; None where nothing was."""
        learnt = self.calibrations
        return learnt[-1] if learnt else None

    def ground_truth(self) -> GroundTruth | None:
        """The recording's own reference trajectory, None where it has none."""
        return run_folder.read_ground_truth(self.folder, self.record)

    def metrics(
        self, vicon: str | Path | None = None, *, config: EvaluationConfig | None = None
    ) -> Mapping[str, Evaluation]:
        """Each trajectory against ground truth, by name; trajectories that cannot be evaluated are left out.

        Args:
            vicon: TUM, EuRoC or mocap CSV file of another ground truth than the recording's own.
            config: how to compare; as the run was configured if None.

        Raises:
            DatasetError: there is no ground truth, or it cannot be read.
            EvaluationError: no trajectory can be evaluated; gives the reasons.
        """
        evaluations, failures = self.evaluated(vicon, config=config)
        if not evaluations:
            reasons = "; ".join(f"{name}: {reason}" for name, reason in failures.items())
            raise EvaluationError(f"nothing in {self.folder} can be evaluated: {reasons or 'it has no trajectory'}")
        return evaluations

    def evaluated(
        self, vicon: str | Path | None = None, *, config: EvaluationConfig | None = None
    ) -> tuple[Mapping[str, Evaluation], Mapping[str, str]]:
        """As ``metrics``, with the reasons for the trajectories that cannot be evaluated, by name.

        Raises:
            DatasetError: there is no ground truth, or it cannot be read.
        """
        truth = None if vicon is None else load_ground_truth(vicon)
        return evaluating.evaluate_run(self.folder, config or self.evaluation_config, truth)

    @property
    def evaluation_config(self) -> EvaluationConfig:
        """How the run was configured to be compared with ground truth."""
        return evaluation_config(self.folder / "config.yaml")

    def save(self, folder: str | Path, overwrite: bool = False) -> Path:
        """Copy the run folder; returns the path of the copy.

        Args:
            folder: for the copy.
            overwrite: whether results of another run that are there already are replaced.

        Raises:
            DatasetError: it holds results of another run, or cannot be written.
        """
        target = run_folder.prepare(Path(folder))
        if target.resolve() == self.folder.resolve():
            return target
        if not overwrite:
            run_folder.check_free(target, "give overwrite=True to replace them, or another folder")
        run_folder.clear(target)
        with run_folder.writing(target):
            shutil.copytree(self.folder, target, dirs_exist_ok=True)
        return target

    def plot(self, kind: str = "path", *, vicon: str | Path | None = None) -> "Figure":
        """A figure: ``overview``, ``path``, ``positions``, ``velocities``, ``position_error``, ``contacts``,
        ``keyframes`` or ``error_bands``.

        Args:
            kind: of the figure.
            vicon: another ground truth than the recording's own.

        Raises:
            EvaluationError: no such figure, it needs a ground truth or data that the run does not have, or matplotlib
                is not installed.
        """
        check_figure(kind)
        has_truth = vicon is not None or self.record.ground_truth is not None
        evaluations = self.evaluated(vicon)[0] if has_truth else {}
        return draw_figure(kind, self.folder, self.record, evaluations, self.evaluation_config)


def run(
    recording: Recording | str | Path,
    mode: str | Sequence[str] | None = None,
    *,
    folder: str | Path | None = None,
    progress: Progress | None = None,
    watch: Watch | None = None,
    pictures_every: int | None = None,
    existing: Existing | Ending | str = Existing.REFUSE,
    view: View | None = None,
) -> Run:
    """Run one or several modes on a recording. A mode that stops early keeps its estimates up to there.

    Args:
        recording: what ``open`` gives, or a path.
        mode: name or names; the best that the recording is enough for if None.
        folder: run folder; a temporary one if None.
        progress: called with the mode and the stamp (ns) of each measurement.
        watch: called with the mode and each of its outputs.
        pictures_every: write every n-th frame with its tracks to ``debug_images`` of the folder; none if None.
        existing: what becomes of results in the folder: ``refuse``, ``overwrite``, or ``resume`` their run; or an
            ``Ending``, which may stop the run, whose ``record.status`` is ``interrupted`` then.
        view: shown measurements and outputs while they come, such as ``open_view`` gives; the caller closes it.

    Raises:
        ConfigError: there is no such mode, or the list of modes is empty.
        CocloError: the folder holds results and ``existing`` refuses them, the recording or the robot is at fault, or
            no mode has what it needs.
    """
    if not isinstance(recording, Recording):
        recording = open_recording(recording)
    names = mode_names(recording.default_mode if mode is None else mode)
    check_pictures(pictures_every)
    ending = existing if isinstance(existing, Ending) else Ending(existing_of(existing))
    with ExitStack() as stack:
        if folder is None:
            folder = stack.enter_context(tempfile.TemporaryDirectory(prefix="coclo_vio_"))
        record = run_modes(
            recording.path,
            names,
            recording.config,
            Path(folder),
            observers=Observers(progress, watch, view, pictures_every),
            ending=ending,
        )
        return Run(Path(folder), record, remove=stack.pop_all().close)


def existing_of(word: Existing | str) -> Existing:
    """What becomes of results that are in a folder already, by its word.

    Raises:
        ConfigError: there is no such word.
    """
    try:
        return Existing(word)
    except ValueError as error:
        raise ConfigError(f"existing = {word!r}: give one of {listing(Existing)}") from error


def mode_names(modes_given: str | Sequence[str]) -> list[str]:
    """The names of modes, each checked.

    Args:
        modes_given: a name, or several.

    Raises:
        ConfigError: there is no such mode, or the list is empty.
    """
    names = [modes_given] if isinstance(modes_given, str) else list(modes_given)
    if not names:
        raise ConfigError(f"the list of modes is empty; give at least one of {listing(modes())}")
    return [mode_of(name).name for name in names]


def load_run(folder: str | Path) -> Run:
    """The run in a folder that ``run`` or the command line wrote.

    Raises:
        DatasetError: it is no run folder, or one of another version of the package.
    """
    return Run(Path(folder), run_folder.read_record(Path(folder)))


def load_ground_truth(path: str | Path) -> GroundTruth:
    """A reference trajectory from a TUM, EuRoC or mocap CSV file, even without stamps.

    Raises:
        DatasetError: the file cannot be read.
    """
    return read_ground_truth(Path(path), DatasetConfig().columns, ReadTally("ground truth", 0.1))
