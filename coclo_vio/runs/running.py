# SPDX-License-Identifier: BSD-3-Clause
"""A recording through several modes into one run folder."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from coclo_vio import __version__
from coclo_vio.datasets.dataset import Dataset, open_dataset, robot_fit
from coclo_vio.datasets.read_report import STREAM_NAMES
from coclo_vio.diagnosis.diagnose import Diagnosis
from coclo_vio.runs import run_folder
from coclo_vio.runs.checkpoint import forget_all
from coclo_vio.runs.contact_source import with_contact_source
from coclo_vio.runs.equipment import Equipment
from coclo_vio.runs.faults import Faults
from coclo_vio.runs.guarding import guarded
from coclo_vio.runs.mode_run import ModeRun, PreparedMode
from coclo_vio.runs.modes.mode import Mode
from coclo_vio.runs.modes.registry import mode_of
from coclo_vio.runs.observers import Observers
from coclo_vio.runs.paced_feed import PacedFeed
from coclo_vio.runs.preflight import preflight, refusal, truth_errors
from coclo_vio.runs.recorder import failed_records
from coclo_vio.runs.resuming import earlier_run
from coclo_vio.runs.run_config import RunConfig
from coclo_vio.runs.run_folder import Existing
from coclo_vio.runs.run_journal import RunJournal
from coclo_vio.runs.run_record import FindingRecord, GroundTruthRecord, RunRecord, union
from coclo_vio.runs.run_source import RunSource
from coclo_vio.runs.stop_request import StopRequest
from coclo_vio.values.config import write_yaml
from coclo_vio.values.errors import CocloError, DatasetError
from coclo_vio.values.measurements import IMAGE_SENSORS

_IMAGE_STREAMS = frozenset(STREAM_NAMES[sensor] for sensor in IMAGE_SENSORS)


def run_modes(
    path: Path,
    names: Sequence[str],
    config: RunConfig,
    folder: Path,
    *,
    observers: Observers | None = None,
    ending: "Ending | None" = None,
    feed: PacedFeed | None = None,
) -> RunRecord:
    """Run each mode on a recording; returns what ``run.json`` holds.

    A mode that fails leaves its estimates up to there, and the others run; so they do where the recording lacks what
    one of them needs, or contradicts physics in what one of them reads (unless ``dataset.allow_partial`` is set).
    ``run.json`` is there from the start and renewed every second.

    Args:
        path: the recording.
        names: of the modes.
        config: resolved configuration.
        folder: run folder, made if needed.
        observers: who is shown what the modes read and give.
        ending: what becomes of earlier results, and what stops the run; earlier results are refused if None.
        feed: plays the recording to the estimators by its stamps; None: they get it as fast as they take it.

    Raises:
        CocloError: the folder holds results, the recording, the robot or the configuration is at fault, or no mode has
            what it needs.
    """
    modes = {name: mode_of(name) for name in names}  # a misspelt mode is found before anything runs
    ending = ending or Ending()
    if ending.existing is Existing.REFUSE:
        run_folder.check_free(folder, *([] if feed is None else [run_folder.WITHOUT_RESUME]))
    dataset = open_dataset(path, config.robot, config.dataset)
    config = with_contact_source(config, dataset)
    resolved = config.on_recording(dataset.imu_calibration())
    faults = Faults(resolved.faults, resolved.robot)
    observers = observers or Observers()
    prepared, diagnosis = _all_prepared(modes, path, dataset, resolved, observers.drawn_every)
    _check_apart(folder, path)
    earlier = earlier_run(folder, path, resolved) if ending.existing is Existing.RESUME else None
    _prepare(folder, is_new=earlier is None)
    with run_folder.writing(folder):
        write_yaml(resolved, folder / "config.yaml")
        journal = RunJournal(folder, _described(path, dataset, config, resolved, folder, diagnosis), earlier)
        source = RunSource(path, dataset, resolved, faults, feed)
        with journal.kept_on_errors():
            for name, ready in prepared.items():
                if ending.is_requested:
                    break
                if journal.has_ended(name):
                    continue
                if isinstance(ready, CocloError):
                    journal.update((None, failed_records(modes[name], str(ready))))
                else:
                    run = ModeRun(ready, journal, observers, ending.stop, resumes=earlier is not None)
                    run.run(source)
            record = _with_reader(journal.record, dataset, is_played=feed is not None)
            return journal.end(record, is_stopped=ending.is_requested)


def _prepare(folder: Path, *, is_new: bool) -> None:
    """Make the folder; for a new run without what an earlier one left."""
    run_folder.prepare(folder)
    if is_new:
        run_folder.clear(folder)
        forget_all(folder)


def _check_apart(folder: Path, recording: Path) -> None:
    """See that results do not overwrite files of the recording: the folder itself, or ground truth beside a file.

    Raises:
        DatasetError: they would.
    """
    own = recording.resolve().parent if recording.is_file() else recording.resolve()
    has_truth = (own / "groundtruth.tum").is_file() and not (own / run_folder.RUN_JSON).is_file()
    if folder.resolve() == own and (recording.is_dir() or has_truth):
        raise DatasetError(
            f"{folder} is the folder of the recording itself, whose files would be overwritten; choose another folder "
            "for the results"
        )


@dataclass(frozen=True, slots=True)
class Ending:
    """How a run ends, its own and the one before it.

    Attributes:
        existing: what becomes of results that are in the folder.
        stop: asked before each measurement whether to stop; None: the run goes to its end.
    """

    existing: Existing = Existing.REFUSE
    stop: StopRequest | None = None

    @property
    def is_requested(self) -> bool:
        """Whether the run is to stop now."""
        return self.stop is not None and self.stop.is_requested


def _all_prepared(
    modes: Mapping[str, Mode], path: Path, dataset: Dataset, config: RunConfig, pictures_every: int | None
) -> tuple[dict[str, PreparedMode | CocloError], Diagnosis]:
    """Each mode made ready, or why it cannot run, by name; and what is wrong with the recording.

    Raises:
        CocloError: no mode can run.
    """
    prepared = {name: _prepared(mode, path, dataset, config, pictures_every) for name, mode in modes.items()}
    diagnosis = preflight(dataset, config)
    if not config.dataset.allow_partial:
        prepared = {name: _contradicted(modes[name], ready, diagnosis) or ready for name, ready in prepared.items()}
    lacks = [ready for ready in prepared.values() if isinstance(ready, CocloError)]
    if len(lacks) == len(prepared) and lacks:
        raise lacks[0]
    return prepared, diagnosis


def _prepared(
    mode: Mode, path: Path, dataset: Dataset, config: RunConfig, pictures_every: int | None
) -> PreparedMode | CocloError:
    """A mode made ready, or what it lacks."""
    if mode.has_legs and config.robot is None:
        return robot_fit(path, config.dataset).unknown_robot_error(path)
    try:
        equipment = Equipment.of(dataset, config, mode.sensors).with_pictures(pictures_every)
        estimator = guarded(mode, equipment, config)
    except CocloError as error:
        return error
    legs = () if equipment.robot is None else equipment.robot.leg_names
    return PreparedMode(
        mode,
        estimator,
        mode.sensors_of(equipment),
        legs,
        config.checkpoints.interval_s,
    )


def _contradicted(mode: Mode, ready: PreparedMode | CocloError, diagnosis: Diagnosis) -> CocloError | None:
    """Why a mode cannot be right, whether it could run or not; or None."""
    return refusal(diagnosis, mode.sensors if isinstance(ready, CocloError) else ready.sensors)


def _described(
    path: Path, dataset: Dataset, given: RunConfig, resolved: RunConfig, folder: Path, diagnosis: Diagnosis
) -> RunRecord:
    """``run.json`` before any mode has run; the ground truth goes to its own file, unless it cannot be meant so."""
    is_wrong = truth_errors(diagnosis) and not given.dataset.allow_partial
    faults = Faults(resolved.faults, resolved.robot)
    truth = None if is_wrong else faults.truth(dataset.ground_truth(), dataset.measurements)
    if truth is not None:
        run_folder.write_ground_truth(folder, truth)
    is_robots = resolved.robot is not None and resolved.robot == given.robot
    return RunRecord(
        version=__version__,
        dataset=str(path),
        robot=None if resolved.robot is None else resolved.robot.name,
        imu_calibration="robot" if is_robots else "recording",
        ground_truth=None if truth is None else GroundTruthRecord(source=truth.source, has_stamps=truth.has_stamps),
        faults=None if resolved.faults.is_none else resolved.faults.model_dump(mode="json"),
        findings=tuple(map(FindingRecord.of, diagnosis.findings)),
    )


def _with_reader(record: RunRecord, dataset: Dataset, *, is_played: bool) -> RunRecord:
    """The record with what was read, and from when to when, also where every mode stopped early.

    Of a mode with cameras it is the time of the cameras that counts. Of a stream that a finished mode has read the span
    is that of the samples used, without stamps that were refused; of a recording that is played, that of what was
    played, and where a clock stepped that of the samples used, by the clock before.
    """
    try:
        report = dataset.report()
    except DatasetError:  # each mode has it as its failure
        return record
    if is_played or any(trajectory.clock_steps for trajectory in record.estimators.values()):
        return record.model_copy(update={"reader": report})
    recording_ns = record.recording_ns
    trajectories = dict(record.estimators)
    known = {sensor for one in trajectories.values() if one.status == "finished" for sensor in one.sensors}
    for stream in report.streams:
        span = stream.start_ns, stream.end_ns
        if stream.name not in known:
            recording_ns = union(recording_ns, span)
        for name, trajectory in trajectories.items():
            if stream.name in _IMAGE_STREAMS and stream.name in trajectory.sensors:
                trajectories[name] = trajectory.model_copy(update={"recording_ns": span})
    return record.model_copy(update={"reader": report, "recording_ns": recording_ns, "estimators": trajectories})
