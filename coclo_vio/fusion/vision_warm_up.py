# SPDX-License-Identifier: BSD-3-Clause
"""Frames of a wall that passes by, for stages that are thrown away: kernels are compiled and libraries loaded by them.

The first frames of a recording would wait for that, seconds in a fresh installation.
"""

from collections.abc import Iterator
from contextlib import suppress

import numpy as np

from coclo_vio.fusion.frame_processor import FrameJob, VisionStages
from coclo_vio.geometry import se3
from coclo_vio.values.calibration import RectifiedStereo
from coclo_vio.values.errors import CocloError
from coclo_vio.values.keyframes import OdometryDelta, PoseMarginal
from coclo_vio.values.measurements import StereoFrame, StereoTracks
from coclo_vio.values.units import NS_PER_S

_FRAMES = 16  # more than a window of keyframes
_PERIOD_NS = NS_PER_S // 10
_STEP_PX, _DISPARITY_PX = 12, 24  # motion a frame, and disparity, of the wall
_GRAIN_PX = 8  # size of the wall's spots
_POINTS = 120
_SIGMA = 0.01  # of the motion, rad and m


def warm_up(stages: VisionStages, rig: RectifiedStereo, width_px: int, height_px: int, *, has_frames: bool) -> None:
    """Process the frames, whatever comes of them.

    Args:
        stages: fresh ones, which are of no use afterwards.
        rig: the cameras.
        width_px: of an image.
        height_px: of an image.
        has_frames: whether there are images; otherwise tracks.
    """
    frames: Iterator[StereoFrame | StereoTracks]
    frames = _images(width_px, height_px) if has_frames else _tracks(width_px, height_px)
    to_the_right = rig.T_body_camera[:3, 0] * rig.baseline_m * _STEP_PX / _DISPARITY_PX
    step, keyframe_ns, pose = se3.transform(np.eye(3), to_the_right), 0, np.eye(4)
    with suppress(CocloError):
        for frame in frames:
            before, pose = pose, pose @ step
            start, motion = PoseMarginal(frame.stamp_ns, pose, np.zeros((6, 6))), None
            if keyframe_ns:
                since = np.linalg.matrix_power(step, (frame.stamp_ns - keyframe_ns) // _PERIOD_NS)
                motion = OdometryDelta(keyframe_ns, frame.stamp_ns, since, np.eye(6) * _SIGMA**2)
            processed = stages.process(FrameJob(frame, before, pose, motion, start=None if keyframe_ns else start))
            if not keyframe_ns or (processed is not None and processed[1].keyframe is not None):
                keyframe_ns = frame.stamp_ns


def _images(width_px: int, height_px: int) -> Iterator[StereoFrame]:
    columns = width_px + _FRAMES * _STEP_PX + _DISPARITY_PX
    size = height_px // _GRAIN_PX + 1, columns // _GRAIN_PX + 1
    spots = np.random.default_rng(0).integers(30, 220, size, dtype=np.uint8)
    wall = spots.repeat(_GRAIN_PX, axis=0).repeat(_GRAIN_PX, axis=1)
    for number in range(_FRAMES):
        first = number * _STEP_PX
        left, right = (
            np.ascontiguousarray(wall[:height_px, at : at + width_px]) for at in (first, first + _DISPARITY_PX)
        )
        yield StereoFrame((number + 1) * _PERIOD_NS, left, right)


def _tracks(width_px: int, height_px: int) -> Iterator[StereoTracks]:
    size = np.array([width_px, height_px], dtype=np.float64)
    points = np.random.default_rng(0).uniform((0.5, 0.1), (0.9, 0.9), (_POINTS, 2)) * size
    disparity = np.column_stack((np.full(_POINTS, float(_DISPARITY_PX)), np.zeros(_POINTS)))
    for number in range(_FRAMES):
        left = points - [float(number * _STEP_PX), 0.0]
        yield StereoTracks((number + 1) * _PERIOD_NS, np.arange(_POINTS), left, left - disparity)
