# SPDX-License-Identifier: BSD-3-Clause
"""Two cameras that are no stereo pair: impossible baselines, images interchanged, of another camera or another size."""

from collections.abc import Iterator
from functools import reduce

import numpy as np

from coclo_vio.diagnosis.evidence import Evidence
from coclo_vio.diagnosis.finding import Finding, Stage, error, warning
from coclo_vio.frontend.pair_match import PairMatch, pair_match
from coclo_vio.frontend.pair_rows import RowDifference, row_difference
from coclo_vio.frontend.rectification import Rectifier
from coclo_vio.values.calibration import CameraCalibration, StereoCalibration
from coclo_vio.values.errors import ConfigError
from coclo_vio.values.measurements import StereoFrame

_STREAMS = "stereo stereo_tracks"
_SHORTEST_M, _LONGEST_M = 0.005, 2.0  # of a baseline on a robot
_FRAMES, _EVERY = 4, 2
_FEWEST_CORNERS = 100  # over all frames
_SWAPPED = 2.0  # times as many matches with left and right interchanged
_SURE_PAIR = 0.45  # of the corners are matched: nothing else is searched
_NO_PAIR = 0.1  # of the corners are matched
_BY_CHANCE, _FEW = (
    1.6,
    0.03,
)  # of a true pair more corners are matched than this many times by chance, and than this share
_ROWS_PX, _SURE = 2.0, 2.0  # by which rows of a good calibration differ at most; sigmas beyond that
_SHIFTED = 1.6  # times as many matches some rows away
_FOCAL_PX = (0.2, 10.0)  # of the image's width
_CENTRE = 0.25  # of the width and the height that a principal point may lie off the middle


def find_calibration(evidence: Evidence) -> Iterator[Finding]:
    """Values of the cameras' calibration that cannot be."""
    stereo = evidence.calibrations.stereo
    if stereo is None:
        return
    yield from _baseline(stereo)
    of_lenses = (each for side, lens in (("left", stereo.left), ("right", stereo.right)) for each in _lens(side, lens))
    yield from {each.kind: each for each in of_lenses}.values()  # once where both have it


def _baseline(stereo: StereoCalibration) -> Iterator[Finding]:
    T_left_right = np.linalg.solve(stereo.T_body_left_camera, stereo.T_body_right_camera)
    x_m, length_m = float(T_left_right[0, 3]), float(np.linalg.norm(T_left_right[:3, 3]))
    kind = ("baseline", Stage.CAMERAS, _STREAMS)
    if length_m < _SHORTEST_M:
        yield error(
            *kind,
            f"the baseline of the cameras is {length_m:.4g} m, at least {_SHORTEST_M:g} is expected: both cameras "
            "have the same mounting; correct the transform from the left to the right camera in the calibration",
        )
    elif length_m > _LONGEST_M:
        yield error(
            *kind,
            f"the baseline of the cameras is {length_m:.4g} m, at most {_LONGEST_M:g} is expected on a robot: its "
            "unit may be millimetres; correct the transform from the left to the right camera in the calibration",
        )
    elif x_m < -0.5 * length_m:
        yield error(
            *kind,
            f"the right camera lies {-x_m:.4g} m to the left of the left one: the calibrations of the two cameras are "
            "interchanged, or the direction of their transform is; interchange cam0 and cam1 or invert the transform",
        )


def _lens(side: str, lens: CameraCalibration) -> Iterator[Finding]:
    share = lens.focal_px[0] / lens.width_px
    if not _FOCAL_PX[0] < share < _FOCAL_PX[1]:
        yield error(
            "focal_length",
            Stage.CAMERAS,
            _STREAMS,
            f"the focal length of the {side} camera is {lens.focal_px[0]:.4g} px where its images are "
            f"{lens.width_px} px "
            f"wide, {_FOCAL_PX[0]:g} to {_FOCAL_PX[1]:g} times that is expected; correct its calibration (unit: px)",
        )
    size = np.array([lens.width_px, lens.height_px])
    off = np.abs(np.array(lens.principal_point_px) - 0.5 * (size - 1)) / size
    if off.max() > _CENTRE:
        x, y = lens.principal_point_px
        yield warning(
            "principal_point",
            Stage.CAMERAS,
            _STREAMS,
            f"the principal point of the {side} camera is ({x:.4g}, {y:.4g}) px in images of {size[0]} x {size[1]} "
            "px: the calibration may be of another resolution; scale it to that of the images",
        )


def find_pairs(evidence: Evidence) -> Iterator[Finding]:
    """Images that do not fit their calibration, by the corners of one that are found in the other."""
    stereo = evidence.calibrations.stereo
    if stereo is None or any(finding.is_error for finding in find_calibration(evidence)):
        return
    frames = evidence.frames(_FRAMES, _EVERY)
    if not frames:
        return
    rows, columns = frames[0].left.shape
    if (columns, rows) != (stereo.left.width_px, stereo.left.height_px):
        yield _other_size(stereo, columns, rows)
        return
    try:
        rectifier = Rectifier(stereo)
    except ConfigError as problem:
        yield error("no_rectification", Stage.CAMERAS, "stereo", f"the cameras cannot be rectified: {problem}")
        return
    as_is = _joined([pair_match(rectifier, frame) for frame in frames])
    if as_is.corners < _FEWEST_CORNERS:
        return
    if as_is.matched > _SURE_PAIR * as_is.corners:
        yield from _rows_off(row_difference(stereo, frames))
        return
    as_is = _joined([pair_match(rectifier, frame, searches_rows=True) for frame in frames])
    swapped = _joined([pair_match(rectifier, StereoFrame(f.stamp_ns, f.right, f.left)) for f in frames])
    setting = f"dataset.corrections.stereo.is_swapped={str(not evidence.corrections.stereo.is_swapped).lower()}"
    yield from _no_pair(as_is, swapped, len(frames), setting)


def _rows_off(found: RowDifference) -> Iterator[Finding]:
    if abs(found.rows_px) - _SURE * found.sigma_px > _ROWS_PX:
        yield warning(
            "pair_calibration",
            Stage.CAMERAS,
            "stereo",
            f"the rows of the rectified images differ by up to {abs(found.rows_px):.1f} +- {found.sigma_px:.1f} px, in "
            f"a corner; at most {_ROWS_PX:g} px is expected: by its images the right camera is rolled by "
            f"{1e3 * abs(found.roll_rad):.1f} mrad against its calibration, and its rows are off by "
            f"{abs(found.offset_px):.1f} px in the middle; the front end corrects what rows show, and distances stay "
            "wrong by the rest: calibrate the cameras again",
        )


def _joined(matches: list[PairMatch]) -> PairMatch:
    return reduce(PairMatch.joined_by, matches)


def _other_size(stereo: StereoCalibration, columns: int, rows: int) -> Finding:
    wide, high = stereo.left.width_px, stereo.left.height_px
    is_scaled = abs(columns * high - rows * wide) <= max(columns, wide)
    scale = f"scale its focal lengths and principal points by {columns / wide:.4g}" if is_scaled else "calibrate again"
    return error(
        "image_size",
        Stage.CAMERAS,
        "stereo",
        f"the images have {columns} x {rows} px, the calibration is of {wide} x {high}: {scale}, or record that size",
    )


def _no_pair(as_is: PairMatch, swapped: PairMatch, frames: int, setting: str) -> Iterator[Finding]:
    found = f"of {as_is.corners} corners in {frames} frames {as_is.matched} are found in the right image"
    if swapped.matched > _SWAPPED * max(as_is.matched, 1) and swapped.matched > _NO_PAIR * swapped.corners:
        yield error(
            "images_swapped",
            Stage.CAMERAS,
            "stereo",
            f"left and right images are interchanged: {found}, and {swapped.matched} of {swapped.corners} with the two "
            f"interchanged; set {setting}",
            setting,
            is_certain=swapped.matched > 0.3 * swapped.corners,
        )
    elif as_is.shifted > _SHIFTED * max(as_is.matched, 1) and as_is.shifted > _NO_PAIR * as_is.corners:
        yield warning(
            "rows_differ",
            Stage.CAMERAS,
            "stereo",
            f"the rows of the rectified images differ by about {abs(as_is.rows_px)} px: {found}, and {as_is.shifted} "
            "that many rows away; calibrate the cameras again, and check whether the images are rectified already "
            "(dataset.rosbag.is_rectified)",
        )
    elif as_is.matched < _BY_CHANCE * as_is.by_chance or as_is.matched < _FEW * as_is.corners:
        yield warning(
            "no_stereo_pair",
            Stage.CAMERAS,
            "stereo",
            f"the images are no stereo pair by their calibration: {found}, and {as_is.by_chance} half an image away, "
            "by chance; check that both topics are of these two cameras, and that the calibration is theirs",
        )
