# SPDX-License-Identifier: BSD-3-Clause
"""Parameters of the front end. Lengths are pixels of the rectified images."""

from typing import Annotated

from pydantic import Field

from coclo_vio.values.config import StageConfig


class DetectionConfig(StageConfig):
    """Detection of new points."""

    tracks: Annotated[int, Field(ge=20, le=1000, description="number of points to track")] = 150
    min_distance_px: Annotated[
        float, Field(ge=3, le=100, description="minimum distance of a new point from every other one, px")
    ] = 15.0
    cell_px: Annotated[
        int, Field(ge=24, le=400, description="side of the grid cells over which points are spread, px")
    ] = 64
    max_per_cell: Annotated[int, Field(ge=1, le=50, description="maximum number of points in a cell")] = 7
    quality_level: Annotated[
        float, Field(gt=0, lt=1, description="minimum corner strength as a share of the strongest one of its cell")
    ] = 0.05
    noise_ratio: Annotated[
        float, Field(ge=0, description="minimum corner strength as a multiple of what image noise alone produces")
    ] = 6.0
    strong_ratio: Annotated[
        float,
        Field(ge=0, description="corners below this multiple are used only where there are too few stronger ones"),
    ] = 16.0
    refill_share: Annotated[
        float, Field(gt=0, le=1, description="new points are detected when fewer than this share of tracks is left")
    ] = 0.95
    border_px: Annotated[int, Field(ge=1, le=100, description="minimum distance from the image border, px")] = 8


class FlowConfig(StageConfig):
    """Pyramidal Lucas-Kanade from frame to frame: an initial position that the patch alignment refines."""

    window_px: Annotated[int, Field(ge=5, le=61, description="side of the window, px")] = 15
    levels: Annotated[int, Field(ge=0, le=8, description="pyramid levels when the motion is predicted")] = 2
    search_levels: Annotated[
        int, Field(ge=0, le=8, description="pyramid levels when it is not predicted, or the prediction was wrong")
    ] = 4
    iterations: Annotated[int, Field(ge=1, le=200, description="maximum number of iterations per level")] = 10
    precision_px: Annotated[float, Field(gt=0, le=1, description="iterations end at a smaller step, px")] = 0.05
    forward_backward_px: Annotated[
        float, Field(gt=0, le=10, description="maximum error of a point tracked forward and backward, px")
    ] = 1.0
    retry_share: Annotated[
        float,
        Field(
            ge=0,
            le=1,
            description="if fewer than this share are tracked, the lost ones are searched again in equalised images",
        ),
    ] = 0.35


class PatchConfig(StageConfig):
    """Alignment of patches under an affine warp: it makes positions accurate."""

    window_px: Annotated[int, Field(ge=5, le=61, description="side of a patch, px")] = 21
    stride_px: Annotated[int, Field(ge=1, le=5, description="every n-th row and column of the patch is used")] = 2
    weight_sigma_px: Annotated[
        float, Field(gt=1, description="sigma of the Gaussian weight about the patch centre, px")
    ] = 6.0
    blur_sigma_px: Annotated[
        float, Field(gt=0, le=3, description="sigma of the Gaussian blur of the images before alignment, px")
    ] = 1.0
    iterations: Annotated[int, Field(ge=1, le=100, description="maximum number of iterations")] = 8
    precision_px: Annotated[float, Field(gt=0, le=1, description="iterations end at a smaller step, px")] = 0.05
    noise: Annotated[
        float, Field(gt=0, description="image noise against which the priors of the warp are weighted, grey levels")
    ] = 2.0


class DriftConfig(StageConfig):
    """Alignment of each point with its reference template, so that tracks do not drift."""

    warp_sigma: Annotated[
        float, Field(gt=0, lt=1, description="one sigma of stretch and shear about the predicted warp")
    ] = 0.01
    max_correction_px: Annotated[
        float, Field(gt=0, le=20, description="maximum correction of the position from Lucas-Kanade, px")
    ] = 2.0
    max_stretch: Annotated[
        float, Field(gt=1, le=10, description="beyond this change of scale a point gets a new reference template")
    ] = 1.5
    dissimilar_share: Annotated[
        float,
        Field(gt=0, le=1, description="if more points than this are dissimilar, all get a new reference template"),
    ] = 0.5


class SimilarityConfig(StageConfig):
    """When an aligned patch shows the same as its template."""

    min_correlation: Annotated[float, Field(ge=0, lt=1, description="minimum correlation of the two patches")] = 0.8
    max_residual_ratio: Annotated[
        float, Field(gt=1, description="maximum residual as a multiple of the frame's median residual")
    ] = 1.6
    contrast_share: Annotated[
        float, Field(ge=0, lt=1, description="share of the patch's contrast that the residual may have in addition")
    ] = 0.08


class StereoConfig(StageConfig):
    """Matching from the left image to the right one."""

    min_disparity_px: Annotated[float, Field(gt=0, le=20, description="minimum disparity of a match, px")] = 0.3
    min_depth_m: Annotated[float, Field(gt=0, description="minimum depth of a match, m")] = 0.2
    row_sigma_px: Annotated[
        float, Field(gt=0, le=5, description="one sigma of the row difference after rectification, px")
    ] = 0.3
    max_row_difference_px: Annotated[
        float, Field(gt=0, le=20, description="maximum row difference after rectification, px")
    ] = 1.5
    slant_sigma: Annotated[
        float, Field(gt=0, le=2, description="one sigma of the change of disparity from pixel to pixel")
    ] = 0.3
    max_correction_px: Annotated[
        float, Field(gt=0, le=20, description="maximum correction of the disparity predicted or searched, px")
    ] = 2.5
    retry_frames: Annotated[
        int, Field(ge=1, le=1000, description="an unmatched point is searched again once in so many frames")
    ] = 4
    block_px: Annotated[int, Field(ge=5, le=41, description="side of the block for the search of new points, px")] = 17
    min_block_correlation: Annotated[
        float, Field(ge=0, lt=1, description="minimum correlation of that block with the right image")
    ] = 0.6
    uniqueness_ratio: Annotated[
        float, Field(gt=0, le=1, description="a match is ambiguous if another place has this share of its correlation")
    ] = 0.98


class PairConfig(StageConfig):
    """Errors of the right camera's calibration against the left one, which the rows of matches show."""

    is_estimated: Annotated[bool, Field(description="whether they are estimated and corrected")] = True
    rotation_sigma_rad: Annotated[
        float, Field(ge=0, le=0.1, description="one sigma of the rotation about each axis, rad")
    ] = 0.001
    displacement_sigma: Annotated[
        float, Field(ge=0, le=0.2, description="one sigma of the displacement across the baseline, as a share of it")
    ] = 0.005
    focal_sigma: Annotated[float, Field(ge=0, le=0.1, description="one sigma of the ratio of focal lengths")] = 0.001
    row_offset_px: Annotated[float, Field(ge=0, le=20, description="one sigma of a difference of all rows, px")] = 1.0
    row_sigma_px: Annotated[
        float, Field(gt=0, le=5, description="one sigma of the row of a match at first; then learnt, px")
    ] = 0.3
    least_row_sigma_px: Annotated[
        float, Field(gt=0, le=5, description="least of that: errors that all matches have in common do not show, px")
    ] = 0.15
    largest_row_share: Annotated[
        float,
        Field(
            gt=0,
            le=1,
            description="matches count whose row is surer than this share of stereo.row_sigma_px: along an edge the "
            "row is the expected one, and says nothing",
        ),
    ] = 0.3
    memory_matches: Annotated[
        float, Field(gt=10, description="matches are forgotten after about so many, as calibrations change with warmth")
    ] = 3000.0


class MotionCheckConfig(StageConfig):
    """One rigid motion must explain the tracks (RANSAC)."""

    max_error_px: Annotated[
        float, Field(gt=0, le=50, description="maximum reprojection error of a track from Lucas-Kanade, px")
    ] = 2.0
    max_aligned_error_px: Annotated[
        float, Field(gt=0, le=50, description="maximum reprojection error of a track after patch alignment, px")
    ] = 1.0
    iterations: Annotated[int, Field(ge=10, le=10000, description="maximum number of three-point samples")] = 200
    confidence: Annotated[float, Field(gt=0.5, lt=1, description="probability of a sample without outliers")] = 0.999
    min_points: Annotated[int, Field(ge=4, le=100, description="no motion is estimated from fewer points")] = 8
    min_inlier_share: Annotated[
        float, Field(gt=0, lt=1, description="no track is rejected if fewer than this share are inliers")
    ] = 0.4
    confident_share: Annotated[
        float,
        Field(gt=0, lt=1, description="the motion predicts lost points only if this share of all points are inliers"),
    ] = 0.25


class QualityConfig(StageConfig):
    """When tracking is healthy, degraded or lost."""

    lost_tracks: Annotated[int, Field(ge=0, description="lost with fewer stereo tracks than this")] = 8
    degraded_tracks: Annotated[int, Field(ge=0, description="degraded with fewer stereo tracks than this")] = 40
    dark_level: Annotated[
        float, Field(ge=0, le=255, description="mean brightness below which an image is dark, grey levels")
    ] = 8.0
    bright_level: Annotated[
        float, Field(ge=0, le=255, description="mean brightness above which an image is overexposed, grey levels")
    ] = 247.0
    min_contrast: Annotated[
        float, Field(ge=0, le=128, description="standard deviation below which an image is featureless, grey levels")
    ] = 2.0
    tracked_share: Annotated[
        float, Field(ge=0, le=1, description="degraded if fewer than this share of tracks continue")
    ] = 0.25
    max_lost_frames: Annotated[
        int, Field(ge=0, le=1000, description="after more lost frames than this the earlier tracks are dropped")
    ] = 5


class FrontendConfig(StageConfig):
    """Stereo images to tracks of points."""

    detection: Annotated[DetectionConfig, Field(description="new points")] = DetectionConfig()
    flow: Annotated[FlowConfig, Field(description="optical flow from frame to frame")] = FlowConfig()
    patch: Annotated[PatchConfig, Field(description="alignment of patches")] = PatchConfig()
    similarity: Annotated[SimilarityConfig, Field(description="comparison of aligned patches with their templates")] = (
        SimilarityConfig()
    )
    drift: Annotated[DriftConfig, Field(description="correction of drift by reference templates")] = DriftConfig()
    stereo: Annotated[StereoConfig, Field(description="matching from left to right")] = StereoConfig()
    pair: Annotated[PairConfig, Field(description="estimated errors of the pair")] = PairConfig()
    motion: Annotated[MotionCheckConfig, Field(description="rejection of outliers by RANSAC")] = MotionCheckConfig()
    quality: Annotated[QualityConfig, Field(description="healthy, degraded or lost tracking")] = QualityConfig()
