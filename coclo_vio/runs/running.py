# SPDX-License-Identifier: BSD-3-Clause
"""A recording through several estimators into one run folder."""

from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from coclo_vio import __version__
from coclo_vio.datasets.dataset import Dataset, open_dataset, robot_fit
from coclo_vio.datasets.read_report import STREAM_NAMES
from coclo_vio.runs import pipeline, run_folder
from coclo_vio.runs.equipment import Equipment
from coclo_vio.runs.estimators import EstimatorKind, estimator_kind
from coclo_vio.runs.faults import Faults
from coclo_vio.runs.keyframe_log import HasPictures, KeyframeWriter, PictureWriter
from coclo_vio.runs.run_config import RunConfig
from coclo_vio.runs.run_folder import StateWriter
from coclo_vio.values.config import write_yaml
from coclo_vio.values.errors import CocloError, DatasetError
from coclo_vio.values.estimates import Several
from coclo_vio.values.measurements import StereoFrame, StereoTracks
from coclo_vio.values.outputs import Estimator
from coclo_vio.values.units import NS_PER_S

_EYES = (STREAM_NAMES[StereoFrame], STREAM_NAMES[StereoTracks])
Progress = Callable[[str, int], None]  # estimator, stamp in ns


def run_all(
    path: Path,
    modes: Sequence[str],
    config: RunConfig,
    folder: Path,
    progress: Progress | None = None,
    pictures_every: int | None = None,
) -> dict[str, Any]:
    """Run each mode on a recording; returns what ``run.json`` holds.

    A mode that fails leaves its estimates up to there, and the others run; so they do where the recording lacks what
    one of them needs.

    Args:
        path: the recording.
        modes: names of estimators.
        config: resolved configuration.
        folder: run folder, made if needed.
        progress: called with estimator and stamp.
        pictures_every: write the picture of every n-th frame of a mode that looks at images; none if None.

    Raises:
        CocloError: the recording, the robot or the configuration is at fault, or no mode has what it needs.
    """
    kinds = {mode: estimator_kind(mode) for mode in modes}  # a misspelt mode is found before anything runs
    dataset = open_dataset(path, config.robot, config.dataset)
    asked, config = config, config.on_recording(dataset.imu_calibration())
    faults = Faults(config.faults, config.robot)
    prepared = {mode: _prepared(kind, path, dataset, config) for mode, kind in kinds.items()}
    lacks = [one for one in prepared.values() if isinstance(one, CocloError)]
    if len(lacks) == len(prepared) and lacks:
        raise lacks[0]
    run_folder.prepare(folder)
    with run_folder.writing(folder):
        write_yaml(config, folder / "config.yaml")
        run = _described(path, dataset, asked, config, folder)
        for mode, one in prepared.items():
            if isinstance(one, CocloError):
                ran = _Ran(pipeline.RunSummary(0, 0, None, 0.0, {}, str(one)), frozenset())
            else:
                ran = _run_one(mode, dataset, faults, one, folder, progress, pictures_every)
            run["recording_ns"] = _union(run["recording_ns"], ran.summary.recording_ns)
            run["estimators"].update(ran.to_json(mode))
            run_folder.write_json(folder / "run.json", run)
        _add_reader(run, dataset)
        run_folder.write_json(folder / "run.json", run)
    return run


@dataclass(frozen=True, slots=True)
class _Prepared:
    """A mode that can run.

    Attributes:
        estimator: a fresh one.
        sensors: what it takes of the recording.
        leg_names: of the robot whose legs it follows.
    """

    estimator: Estimator
    sensors: frozenset[type]
    leg_names: tuple[str, ...]


def _prepared(kind: EstimatorKind, path: Path, dataset: Dataset, config: RunConfig) -> _Prepared | CocloError:
    """A mode made ready, or what it lacks."""
    if kind.has_legs and config.robot is None:
        return robot_fit(path, config.dataset).why_unknown(path)
    try:
        equipment = Equipment.of(dataset, config, kind.sensors)
        estimator = kind.make(equipment, config)
    except CocloError as error:
        return error
    legs = () if equipment.robot is None else equipment.robot.leg_names
    return _Prepared(estimator, kind.taken(equipment), legs)


def _described(path: Path, dataset: Dataset, asked: RunConfig, config: RunConfig, folder: Path) -> dict[str, Any]:
    """``run.json`` before any estimator has run; the ground truth goes to its own file."""
    truth = dataset.ground_truth()
    if truth is not None:
        run_folder.write_ground_truth(folder, truth)
    own = config.robot is not None and config.robot == asked.robot
    return {
        "version": __version__,
        "dataset": str(path),
        "robot": None if config.robot is None else config.robot.name,
        "imu_calibration": "robot" if own else "recording",
        "ground_truth": None if truth is None else {"has_stamps": truth.has_stamps, "source": truth.source},
        "faults": None if config.faults.is_none else config.faults.model_dump(mode="json"),
        "recording_ns": None,
        "estimators": {},
    }


def _add_reader(run: dict[str, Any], dataset: Dataset) -> None:
    """What was read, and from when to when, also where every estimator stopped early.

    Of an estimator that sees it is the time of the cameras that counts.
    """
    try:
        report = dataset.report()
    except DatasetError:  # each estimator has told of it as its failure
        run["reader"] = None
        return
    run["reader"] = asdict(report)
    for stream in report.streams:
        run["recording_ns"] = _union(run["recording_ns"], (stream.start_ns, stream.end_ns))
        for told in run["estimators"].values():
            if stream.name in _EYES and stream.name in told["sensors"]:
                told["recording_ns"] = (stream.start_ns, stream.end_ns)


def _union(one: tuple[int, int] | None, other: tuple[int, int] | None) -> tuple[int, int] | None:
    """The shortest interval that holds both."""
    if one is None or other is None:
        return one or other
    return min(one[0], other[0]), max(one[1], other[1])


@dataclass(frozen=True, slots=True)
class _Ran:
    """A mode that has run.

    Attributes:
        summary: how it went.
        sensors: what it took of the recording.
        keyframes: what they come to, where it has any.
        pictures: how many were drawn.
        name: of its estimates; its mode's if None.
    """

    summary: pipeline.RunSummary
    sensors: frozenset[type]
    keyframes: Mapping[str, float | None] | None = None
    pictures: int = 0
    name: str | None = None

    def to_json(self, mode: str) -> dict[str, Any]:
        """What ``run.json`` says of it: an object for each name of its estimates, that of ``push`` first."""
        told = {"mode": mode, **self._told()}
        others = {name: {**told, "estimates": number} for name, number in self.summary.others.items()}
        return {self.name or mode: told, **others}

    def _told(self) -> dict[str, Any]:
        summary = self.summary
        start_ns = 0 if summary.recording_ns is None else summary.recording_ns[0]
        return {
            "sensors": sorted(STREAM_NAMES[sensor] for sensor in self.sensors),
            "measurements": summary.measurements,
            "estimates": summary.estimates,
            "compute_s": summary.compute_s,
            "realtime_factor": summary.realtime_factor,
            "counts": dict(summary.counts),
            "events": [{"time_s": (event.stamp_ns - start_ns) / NS_PER_S, **asdict(event)} for event in summary.events],
            "keyframes": self.keyframes,
            "pictures": self.pictures,
            "failure": summary.failure,
        }


def _run_one(
    mode: str,
    dataset: Dataset,
    faults: Faults,
    prepared: _Prepared,
    folder: Path,
    progress: Progress | None,
    pictures_every: int | None,
) -> _Ran:
    told = None if progress is None else lambda stamp_ns: progress(mode, stamp_ns)
    pictures = PictureWriter(folder, mode)
    if pictures_every is not None and isinstance(prepared.estimator, HasPictures):
        prepared.estimator.show(pictures_every, pictures.write)
    estimator = prepared.estimator
    several = estimator if isinstance(estimator, Several) else None
    name, other_names = (mode, ()) if several is None else (several.name, several.other_names)
    with ExitStack() as files:
        writer = files.enter_context(StateWriter(folder, name, prepared.leg_names))
        others = {other: files.enter_context(StateWriter(folder, other, ())) for other in other_names}
        keyframes = files.enter_context(KeyframeWriter(folder, (name, *other_names)[-1]))
        summary = pipeline.run(
            estimator,
            faults.measurements(dataset.measurements, prepared.sensors),
            writer.write,
            told,
            keyframes.write,
            lambda other, estimate: others[other].write(estimate),
        )
    return _Ran(summary, prepared.sensors, keyframes.summary(), pictures.written, name)
