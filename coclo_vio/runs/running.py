# SPDX-License-Identifier: BSD-3-Clause
"""A recording through several modes into one run folder."""

from collections.abc import Iterable, Iterator, Sequence
from contextlib import closing, contextmanager, nullcontext, suppress
from dataclasses import dataclass
from pathlib import Path

from coclo_vio import __version__
from coclo_vio.datasets.dataset import Dataset, open_dataset, robot_fit
from coclo_vio.datasets.read_ahead import read_ahead
from coclo_vio.datasets.read_report import STREAM_NAMES
from coclo_vio.diagnosis.diagnose import Diagnosis
from coclo_vio.runs import pipeline, run_folder
from coclo_vio.runs.equipment import Equipment
from coclo_vio.runs.faults import Faults
from coclo_vio.runs.guarding import guarded
from coclo_vio.runs.modes.mode import Mode
from coclo_vio.runs.modes.registry import mode_of
from coclo_vio.runs.observers import Observers
from coclo_vio.runs.paced_feed import PacedFeed
from coclo_vio.runs.preflight import preflight, refusal, truth_errors
from coclo_vio.runs.recorder import OutputRecorder, failed_records
from coclo_vio.runs.recording_view import seen
from coclo_vio.runs.run_config import RunConfig
from coclo_vio.runs.run_folder import Existing
from coclo_vio.runs.run_journal import Progressed, RunJournal
from coclo_vio.runs.run_record import FindingRecord, GroundTruthRecord, RunRecord, union
from coclo_vio.runs.stop_request import StopRequest
from coclo_vio.values.config import write_yaml
from coclo_vio.values.errors import CocloError, DatasetError
from coclo_vio.values.measurements import IMAGE_SENSORS, Measurement
from coclo_vio.values.outputs import Estimator, Output

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
        progress: called with mode and stamp.
        watch: called with mode and output.
        pictures_every: write the picture of every n-th frame of a mode that processes images; none if None.
        feed: plays the recording to the estimators by its stamps; None: they get it as fast as they take it.

    Raises:
        CocloError: the folder holds results, the recording, the robot or the configuration is at fault, or no mode has
            what it needs.
    """
    modes = {name: mode_of(name) for name in names}  # a misspelt mode is found before anything runs
    ending = ending or Ending()
    if ending.existing is Existing.REFUSE:
        run_folder.check_free(folder)
    dataset = open_dataset(path, config.robot, config.dataset)
    resolved = config.on_recording(dataset.imu_calibration())
    faults = Faults(resolved.faults, resolved.robot)
    observers = observers or Observers()
    every = observers.drawn_every
    prepared = {name: _prepared(mode, path, dataset, resolved, every) for name, mode in modes.items()}
    diagnosis = preflight(dataset, resolved)
    if not config.dataset.allow_partial:
        prepared = {name: _contradicted(modes[name], ready, diagnosis) or ready for name, ready in prepared.items()}
    lacks = [ready for ready in prepared.values() if isinstance(ready, CocloError)]
    if len(lacks) == len(prepared) and lacks:
        raise lacks[0]
    _check_apart(folder, path)
    run_folder.clear(run_folder.prepare(folder))
    with run_folder.writing(folder):
        write_yaml(resolved, folder / "config.yaml")
        journal = RunJournal(folder, _described(path, dataset, config, resolved, folder, diagnosis))
        source = _Source(path, dataset, resolved, faults, feed)
        try:
            for name, ready in prepared.items():
                if ending.is_requested:
                    break
                if isinstance(ready, CocloError):
                    journal.update((None, failed_records(modes[name], str(ready))))
                else:
                    _run_one(ready, source, journal, observers, ending.stop)
            return journal.end(_with_reader(journal.record, dataset))
        except BaseException as error:
            journal.abandon(error)
            raise


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


@dataclass(frozen=True, slots=True)
class _Prepared:
    """A mode that can run.

    Attributes:
        mode: which.
        estimator: a fresh one.
        sensors: what it reads of the recording.
        leg_names: of the robot whose legs it follows.
        reads_ahead: whether a thread reads ahead of the estimator.
    """

    mode: Mode
    estimator: Estimator
    sensors: frozenset[type]
    leg_names: tuple[str, ...]
    reads_ahead: bool


def _prepared(
    mode: Mode, path: Path, dataset: Dataset, config: RunConfig, pictures_every: int | None
) -> _Prepared | CocloError:
    """A mode made ready, or what it lacks."""
    if mode.has_legs and config.robot is None:
        return robot_fit(path, config.dataset).unknown_robot_error(path)
    try:
        equipment = Equipment.of(dataset, config, mode.sensors).with_pictures(pictures_every)
        estimator = guarded(mode, equipment, config)
    except CocloError as error:
        return error
    legs = () if equipment.robot is None else equipment.robot.leg_names
    return _Prepared(mode, estimator, mode.sensors_of(equipment), legs, config.dataset.reading_threads > 0)


def _contradicted(mode: Mode, ready: "_Prepared | CocloError", diagnosis: Diagnosis) -> CocloError | None:
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


@dataclass(frozen=True, slots=True)
class _Source:
    """Where an estimator's measurements come from.

    Attributes:
        path: of the recording.
        dataset: its reader.
        config: resolved configuration.
        faults: on the measurements.
        feed: plays them by their stamps, if there is one.
    """

    path: Path
    dataset: Dataset
    config: RunConfig
    faults: Faults
    feed: PacedFeed | None

    @contextmanager
    def opened(self, ready: _Prepared) -> Iterator[tuple[Estimator, Iterable[Measurement]]]:
        """The estimator, and its measurements."""
        if self.feed is not None:
            stereo = self.dataset.stereo_calibration()
            with self.feed.open(ready.estimator, self.path, self.config, ready.sensors, stereo) as fed:
                yield fed
            return
        measurements = self.faults.measurements(self.dataset.measurements, ready.sensors)
        with closing(read_ahead(measurements)) if ready.reads_ahead else nullcontext(measurements) as source:
            yield ready.estimator, source


def _run_one(
    ready: _Prepared, source: _Source, journal: RunJournal, observers: Observers, stop: StopRequest | None
) -> None:
    """Run one mode, and keep what it comes to in the journal."""
    name = ready.mode.name
    tally = pipeline.Tally()
    with OutputRecorder(journal.folder, ready.mode, ready.leg_names) as recorder:

        def progressed() -> Progressed:
            summary = tally.summary(dict(ready.estimator.counts))
            return summary.recording_ns, recorder.records(summary, ready.sensors, is_running=True)

        def take(output: Output) -> None:
            if observers.keep(output):
                recorder.take(output)
            observers.take(name, output)

        def advance(stamp_ns: int) -> None:
            journal.tick(progressed)
            observers.advance(name, stamp_ns)

        journal.update(progressed())
        try:
            with source.opened(ready) as (estimator, measurements), nullcontext() if stop is None else stop.polled():
                shown = measurements if observers.view is None else seen(measurements, observers.view)
                summary = pipeline.run(estimator, shown, take, advance, tally=tally, stop=stop)
        except BaseException:
            with suppress(OSError):
                journal.update(progressed())
            raise
    journal.update((summary.recording_ns, recorder.records(summary, ready.sensors)))


def _with_reader(record: RunRecord, dataset: Dataset) -> RunRecord:
    """The record with what was read, and from when to when, also where every mode stopped early.

    Of a mode with cameras it is the time of the cameras that counts.
    """
    try:
        report = dataset.report()
    except DatasetError:  # each mode has it as its failure
        return record
    recording_ns = record.recording_ns
    trajectories = dict(record.estimators)
    for stream in report.streams:
        span = stream.start_ns, stream.end_ns
        recording_ns = union(recording_ns, span)
        for name, trajectory in trajectories.items():
            if stream.name in _IMAGE_STREAMS and stream.name in trajectory.sensors:
                trajectories[name] = trajectory.model_copy(update={"recording_ns": span})
    return record.model_copy(update={"reader": report, "recording_ns": recording_ns, "estimators": trajectories})
