# SPDX-License-Identifier: BSD-3-Clause
"""The trajectories of a run folder against ground truth."""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

from coclo_vio.datasets.read_report import STREAM_NAMES
from coclo_vio.evaluation.evaluate import EvaluationConfig, evaluate
from coclo_vio.evaluation.evaluation import Evaluation
from coclo_vio.runs import run_folder
from coclo_vio.runs.modes.registry import modes
from coclo_vio.runs.run_record import Interval, TrajectoryRecord
from coclo_vio.runs.stepped_clock import on_clock_of, step_note
from coclo_vio.values.config import merged, parse_settings, read_yaml
from coclo_vio.values.errors import CocloError, DatasetError
from coclo_vio.values.measurements import CameraImuSample, ImuSample
from coclo_vio.values.trajectory import GroundTruth
from coclo_vio.values.units import NS_PER_S

_GRAVITY_SENSORS = (STREAM_NAMES[ImuSample], STREAM_NAMES[CameraImuSample])


def evaluation_config(file: Path | None, settings: Sequence[str] = ()) -> EvaluationConfig:
    """The section ``evaluation`` of a configuration file, with settings; the defaults where the file is not there.

    Args:
        file: YAML configuration; None for none.
        settings: ``evaluation.key=value`` strings; the later wins.

    Raises:
        ConfigError: an unknown key or a value out of bounds.
    """
    values = read_yaml(file) if file is not None and file.is_file() else {}
    changed = merged(values, parse_settings(settings)).get("evaluation") or {}
    return EvaluationConfig.parse(changed, str(file or "--set"))


def evaluate_run(
    folder: Path, config: EvaluationConfig, truth: GroundTruth | None = None
) -> tuple[dict[str, Evaluation], dict[str, str]]:
    """Every trajectory of a run folder against ground truth.

    Args:
        folder: what ``run_modes`` wrote.
        config: how to compare.
        truth: another ground truth than the run's own.

    Returns:
        The evaluations by trajectory, and for those that could not be evaluated the reason.

    Raises:
        DatasetError: no run folder, or no ground truth.
    """
    modes()  # whoever shows the result asks for the kinds of its trajectories
    record = run_folder.read_record(folder)
    truth = truth or run_folder.read_ground_truth(folder, record)
    if truth is None:
        raise DatasetError(f"{folder} has no ground truth; give one with `coclo-vio evaluate {folder} --vicon FILE`")
    evaluations: dict[str, Evaluation] = {}
    failures: dict[str, str] = {}
    for name, run in record.estimators.items():
        if not run.estimates:
            failures[name] = run.failure or "it has no estimate"
            continue
        try:
            found = run_folder.read_estimates(folder, name)
            of_run_ns = run.recording_ns or record.recording_ns
            estimate, recording_ns = on_clock_of(truth.trajectory, found.trajectory, of_run_ns, run.clock_steps)
            evaluation = evaluate(
                estimate,
                truth,
                config,
                recording_ns=recording_ns,
                realtime_factor=run.realtime_factor,
                is_gravity_aligned=any(sensor in _GRAVITY_SENSORS for sensor in run.sensors),
            )
            stepped = step_note(truth.trajectory, run.clock_steps, record.recording_ns)
            notes = (*found.notes, *filter(None, [stepped]), *_stopped(run, record.recording_ns))
            evaluations[name] = replace(evaluation, notes=(*notes, *evaluation.notes))
        except CocloError as error:
            failures[name] = run.failure or str(error)
    return evaluations, failures


def _stopped(run: TrajectoryRecord, recording_ns: Interval | None) -> Iterator[str]:
    """A sentence on a run that did not come to its end by itself."""
    how = {"running": "was killed, or is still going on", "interrupted": "was interrupted"}.get(run.status)
    if how is not None:
        until = ""
        if run.last_ns is not None and recording_ns is not None:
            until = (
                f": its estimates end {(run.last_ns - recording_ns[0]) / NS_PER_S:.2f} s after the first measurement"
            )
        yield f"the run of {run.mode} {how}{until}"
