# SPDX-License-Identifier: BSD-3-Clause
"""A short walk of a Go1 in a textured room, with every sensor: what ``walk.mcap`` is in the pages' examples."""

from collections.abc import Iterator
from pathlib import Path

from textured_room import Room, rig

import coclo_vio as cv
from coclo_vio.datasets.images import encoded
from coclo_vio.datasets.recording_contents import RecordingContents
from coclo_vio.datasets.rosbag.writing.bag_writer import write_bag
from coclo_vio.robot.model import RobotModel
from coclo_vio.simulation.analytic import AnalyticTrialConfig, generate
from coclo_vio.simulation.body_motion import BodyMotionConfig
from coclo_vio.values.measurements import EncodedStereoFrame

BODY = BodyMotionConfig(rest_s=1.0, walk_s=2.0, stop_s=0.0, ramp_s=0.4, speed_mps=0.25)
FRAME_STEP = 8  # a frame at every eighth joint sample: 12.5 Hz


def write_go1_walk(path: Path) -> Path:
    """Write the walk as a bag, three seconds long."""
    robot = cv.load_robot("go1")
    trial = generate(AnalyticTrialConfig(body=BODY), RobotModel(robot), seed=21)
    cameras = rig()
    room = Room(cameras)

    def frames() -> Iterator[EncodedStereoFrame]:
        for sample in range(0, len(trial.truth), FRAME_STEP):
            stamp_ns = int(trial.truth.stamps_ns[sample])
            frame = room.frame(stamp_ns, trial.truth.T_world_body[sample])
            yield EncodedStereoFrame(stamp_ns, encoded(frame.left, "png"), encoded(frame.right, "png"), "png")

    contents = RecordingContents(
        robot,
        trial.measurements,
        cv.GroundTruth(trial.truth, True, "truth"),
        imu=robot.imu,
        stereo=cameras,
        frames=frames(),
    )
    return write_bag(path, contents)
