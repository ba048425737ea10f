# SPDX-License-Identifier: BSD-3-Clause
"""A run folder in a view, after the run: what the files hold of it, and the joints where the recording is there."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from coclo_vio.datasets.dataset import open_dataset
from coclo_vio.runs import run_folder
from coclo_vio.runs.output_logs import read_calibrations, read_health
from coclo_vio.runs.run_config import RunConfig
from coclo_vio.runs.run_folder import RecordedTrajectory
from coclo_vio.runs.run_record import RunRecord
from coclo_vio.values.config import read_yaml
from coclo_vio.values.errors import CocloError
from coclo_vio.values.estimates import FootState, NavState, StateEstimate
from coclo_vio.values.measurements import JointSample, Measurement
from coclo_vio.values.outputs import Estimate, Event, Output
from coclo_vio.views.opening import open_view
from coclo_vio.views.view import Setting

_STANCE = 0.5


def replay(folder: Path, kind: str, file: Path) -> Path:
    """Draw a run folder into a file; returns its path.

    Args:
        folder: of the run.
        kind: ``foxglove`` or ``rerun``.
        file: what is written.

    Raises:
        ConfigError: no such view, its library is not installed, or the file cannot be written.
        DatasetError: it is no run folder.
    """
    record = run_folder.read_record(folder)
    config = RunConfig.parse(read_yaml(folder / "config.yaml"), str(folder / "config.yaml"))
    truth = run_folder.read_ground_truth(folder, record)
    setting = Setting(config.robot, truth.trajectory if truth is not None and truth.has_stamps else None)
    outputs = sorted(_outputs(folder, record), key=stamp_of)
    joints = _joints(record, config)
    view = open_view(kind, setting, file=file)
    try:
        ahead = next(joints, None)
        for output in outputs:
            while ahead is not None and ahead.stamp_ns <= stamp_of(output):
                view.measurement(ahead)
                ahead = next(joints, None)
            view.take(output)
    finally:
        view.close()
    return file


def stamp_of(output: Output) -> int:
    """When an output is of, ns."""
    return output.state.stamp_ns if isinstance(output, Estimate) else output.stamp_ns


def _outputs(folder: Path, record: RunRecord) -> Iterator[Output]:
    for name, of_run in record.estimators.items():
        if of_run.estimates:
            yield from _estimates(run_folder.read_estimates(folder, name))
        yield from read_health(folder, name)
        yield from read_calibrations(folder, name)
    yield from (Event(event.stamp_ns, event.kind, event.detail) for _, event in record.events())


def _estimates(recorded: RecordedTrajectory) -> Iterator[Estimate]:
    """The estimates of a trajectory; what its files lack is zero. The feet's positions follow from the joints."""
    poses, zero = recorded.trajectory, np.zeros((len(recorded.trajectory), 3))
    velocity = zero if poses.velocity_world is None else poses.velocity_world
    vectors = [recorded.angular_velocity_body, recorded.gyroscope_bias, recorded.accelerometer_bias]
    rate, gyroscope, accelerometer = (zero if vector is None else vector for vector in vectors)
    legs = len(recorded.leg_names)
    for row, stamp_ns in enumerate(poses.stamps_ns.tolist()):
        covariance = np.zeros((9, 9))
        if poses.covariance is not None:
            covariance[:6, :6] = poses.covariance[row]
        T, contact = poses.T_world_body[row], recorded.contact_probability[row]
        feet = FootState(np.tile(T[:3, 3], (legs, 1)), contact, contact > _STANCE) if legs else None
        nav = NavState(T, velocity[row], rate[row], gyroscope[row], accelerometer[row])
        yield Estimate(recorded.name, StateEstimate(stamp_ns, nav, covariance, feet))


def _joints(record: RunRecord, config: RunConfig) -> Iterator[Measurement]:
    """The joint samples of the recording; none where it is not there any more."""
    path = Path(record.dataset)
    if config.robot is None or not path.exists():
        return
    try:
        dataset = open_dataset(path, config.robot, config.dataset)
        yield from dataset.measurements(frozenset({JointSample}))
    except CocloError:  # what is wrong with it is in the record of the run
        return
