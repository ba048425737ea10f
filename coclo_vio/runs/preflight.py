# SPDX-License-Identifier: BSD-3-Clause
"""The diagnosis of a recording as it is configured: before a run, in an inspection, and in full for ``doctor``."""

from collections.abc import Iterable

from coclo_vio.datasets.dataset import Dataset
from coclo_vio.datasets.read_report import STREAM_NAMES
from coclo_vio.diagnosis.all_checks import CHECKS
from coclo_vio.diagnosis.diagnose import Cost, Diagnosis, diagnose
from coclo_vio.diagnosis.evidence import Evidence
from coclo_vio.diagnosis.finding import Finding
from coclo_vio.runs.contact_source import with_contact_source
from coclo_vio.runs.run_config import RunConfig
from coclo_vio.values.errors import CocloError, DatasetError

_SECONDS = 60.0  # of the recording that are looked at before a run
GROUND_TRUTH = "ground_truth"


def evidence_of(dataset: Dataset, config: RunConfig, seconds: float = _SECONDS) -> Evidence:
    """What the checks look at, with the robot and the mounting of its IMU that a run would use.

    Args:
        dataset: the recording.
        config: resolved configuration.
        seconds: how much of the recording is looked at, s.
    """
    try:
        imu = dataset.imu_calibration()
    except CocloError:  # a run reports it
        imu = None
    config = with_contact_source(config, dataset)
    description = config.on_recording(imu).robot
    used = imu if description is None else description.imu
    described = None if config.robot is None else config.robot.imu
    unused = imu if config.imu_calibration == "robot" else described
    return Evidence(dataset, description, used, seconds, config.dataset.corrections, unused)


def preflight(dataset: Dataset, config: RunConfig) -> Diagnosis:
    """The checks that a run makes before it starts: of stamps, samples and a few images."""
    return diagnose(evidence_of(dataset, config), CHECKS, Cost.SAMPLES)


def refusal(diagnosis: Diagnosis, sensors: Iterable[type]) -> DatasetError | None:
    """Why a mode that reads these sensors cannot give a right result, None where nothing says so."""
    streams = {STREAM_NAMES[sensor] for sensor in sensors}
    errors = [finding for finding in diagnosis.of_streams(streams) if finding.is_error]
    if not errors:
        return None
    more = f" (and {len(errors) - 1} more: coclo-vio doctor lists them)" if len(errors) > 1 else ""
    return DatasetError(f"{errors[0].sentence}{more}; --allow-partial (dataset.allow_partial) runs it as it is")


def truth_errors(diagnosis: Diagnosis) -> tuple[Finding, ...]:
    """Why the ground truth cannot be meant as it was read; nothing where nothing says so."""
    return tuple(finding for finding in diagnosis.of_streams((GROUND_TRUTH,)) if finding.is_error)
