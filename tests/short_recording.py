# SPDX-License-Identifier: BSD-3-Clause
"""Recordings that are short enough for a test: the beginning of the bundled one, and a leg log with known truth."""

from collections.abc import Iterator
from itertools import takewhile
from pathlib import Path

import coclo_vio as cv
from coclo_vio.datasets.images import encoded
from coclo_vio.datasets.recording_contents import RecordingContents
from coclo_vio.datasets.rosbag.writing.bag_writer import write_bag
from coclo_vio.datasets.writer import write_leg_log
from coclo_vio.robot.model import RobotModel
from coclo_vio.simulation.analytic import AnalyticTrialConfig, generate
from coclo_vio.simulation.body_motion import BodyMotionConfig
from coclo_vio.values.measurements import ALL_SENSORS, EncodedStereoFrame
from coclo_vio.values.units import NS_PER_S

LENGTH_S = 6.0  # 2 s of standing, 4 s of walking


def write_beginning(path: Path, length_s: float = LENGTH_S) -> Path:
    """Write the beginning of the bundled recording, with all sensors and the ground truth of that time, as a bag."""
    recording = cv.open(cv.sample_path(), robot="daisy")
    begin_ns = next(recording.measurements()).stamp_ns
    end_ns = begin_ns + round(length_s * NS_PER_S)

    def part(sensors: frozenset[type]) -> Iterator[cv.Measurement]:
        return takewhile(lambda measurement: measurement.stamp_ns < end_ns, recording.measurements(sensors))

    def frames() -> Iterator[EncodedStereoFrame]:
        for frame in part(frozenset({cv.StereoFrame})):
            assert isinstance(frame, cv.StereoFrame)
            left, right = (encoded(image, "png") for image in (frame.left, frame.right))
            yield EncodedStereoFrame(frame.stamp_ns, left, right, "png")

    truth = recording.ground_truth()
    assert truth is not None
    is_part = truth.trajectory.stamps_ns < end_ns
    poses = cv.Trajectory(truth.trajectory.stamps_ns[is_part], truth.trajectory.T_world_body[is_part])
    calibration = recording.calibration
    contents = RecordingContents(
        cv.load_robot("daisy"),
        part(ALL_SENSORS - {cv.StereoFrame}),
        cv.GroundTruth(poses, truth.has_stamps, truth.source),
        calibration.imu,
        calibration.camera_imu,
        calibration.stereo,
        frames(),
    )
    return write_bag(path, contents)


def write_leg_walk(folder: Path) -> Path:
    """Write three seconds of a Daisy that stands and walks as a leg log, with exact ground truth; its folder."""
    robot = cv.load_robot("daisy")
    body = BodyMotionConfig(rest_s=0.8, walk_s=2.0, stop_s=0.2, ramp_s=0.4)
    trial = generate(AnalyticTrialConfig(body=body), RobotModel(robot), seed=12)
    write_leg_log(folder, robot, trial.measurements, cv.GroundTruth(trial.truth, True, "truth"))
    return folder
