# SPDX-License-Identifier: BSD-3-Clause
"""Parameters of the front end. Lengths are pixels of the rectified images."""

from typing import Annotated

from pydantic import Field

from coclo_vio.values.config import StageConfig


class DetectionConfig(StageConfig):
    """Where new points are looked for."""

    tracks: Annotated[int, Field(ge=20, le=1000, description="points to follow at a time")] = 150
    min_distance_px: Annotated[float, Field(ge=3, le=100, description="of a new point from every other one, px")] = 15.0
    cell_px: Annotated[int, Field(ge=24, le=400, description="side of the cells over which points are spread, px")] = 64
    cell_most: Annotated[int, Field(ge=1, le=50, description="most points in a cell")] = 7
    quality: Annotated[
        float, Field(gt=0, lt=1, description="least corner strength as a share of the strongest one of its cell")
    ] = 0.05
    noise_ratio: Annotated[
        float, Field(ge=0, description="least corner strength in those that the image's noise alone would make")
    ] = 6.0
    strong_ratio: Annotated[
        float, Field(ge=0, description="corners below this are only taken where there are not enough stronger ones")
    ] = 16.0
    refill_share: Annotated[
        float, Field(gt=0, le=1, description="new points are sought once fewer than this share of tracks is left")
    ] = 0.95
    border_px: Annotated[int, Field(ge=1, le=100, description="no point is this near to the image's edge, px")] = 8


class FlowConfig(StageConfig):
    """Pyramidal Lucas-Kanade from frame to frame: it only has to come near, patches make it exact."""

    window_px: Annotated[int, Field(ge=5, le=61, description="side of the window, px")] = 15
    levels: Annotated[int, Field(ge=0, le=8, description="halvings of the image when the motion is predicted")] = 2
    search_levels: Annotated[
        int, Field(ge=0, le=8, description="halvings of the image when it is not, or was wrong")
    ] = 4
    iterations: Annotated[int, Field(ge=1, le=200, description="most iterations at a level")] = 10
    precision_px: Annotated[float, Field(gt=0, le=1, description="a smaller step ends the iterations, px")] = 0.05
    round_trip_px: Annotated[
        float, Field(gt=0, le=10, description="most error of a point that is followed there and back, px")
    ] = 1.0
    retry_share: Annotated[
        float,
        Field(
            ge=0,
            le=1,
            description="fewer followed than this: the lost ones are sought again, farther and in evened light",
        ),
    ] = 0.35


class PatchConfig(StageConfig):
    """Alignment of patches that may stretch and shear: what makes places exact."""

    window_px: Annotated[int, Field(ge=5, le=61, description="side of a patch, px")] = 21
    stride_px: Annotated[int, Field(ge=1, le=5, description="every n-th row and column of it is looked at")] = 2
    taper_px: Annotated[float, Field(gt=1, description="sigma of the weight about its middle, px")] = 6.0
    blur_px: Annotated[float, Field(gt=0, le=3, description="sigma of the blur that images get before, px")] = 1.0
    iterations: Annotated[int, Field(ge=1, le=100, description="most iterations")] = 8
    precision_px: Annotated[float, Field(gt=0, le=1, description="a smaller step ends the iterations, px")] = 0.05
    noise: Annotated[float, Field(gt=0, description="of the images, against what is expected, grey levels")] = 2.0


class AnchorConfig(StageConfig):
    """Each point is compared with what it looked like when it was anchored, so that it does not creep away."""

    shape_spread: Annotated[
        float, Field(gt=0, lt=1, description="one sigma of stretch and shear against the predicted ones")
    ] = 0.01
    correction_px: Annotated[
        float, Field(gt=0, le=20, description="most correction of a place that Lucas-Kanade has found, px")
    ] = 2.0
    stretch: Annotated[
        float, Field(gt=1, le=10, description="beyond this factor of growth or shrinkage a point is anchored anew")
    ] = 1.5
    lost_share: Annotated[
        float, Field(gt=0, le=1, description="where more points than this do not look alike, all are anchored anew")
    ] = 0.5


class LikenessConfig(StageConfig):
    """When the same point in two images has been found."""

    score: Annotated[float, Field(ge=0, lt=1, description="least correlation of two patches")] = 0.8
    residual_ratio: Annotated[
        float, Field(gt=1, description="most residual of a stereo match in those of the middle one of the frame")
    ] = 1.6
    contrast_share: Annotated[
        float, Field(ge=0, lt=1, description="so much of its contrast may be left over besides")
    ] = 0.08


class StereoConfig(StageConfig):
    """The same point in the right image."""

    least_disparity_px: Annotated[
        float, Field(gt=0, le=20, description="points with less are too far to be matched, px")
    ] = 0.3
    nearest_m: Annotated[float, Field(gt=0, description="depth of the nearest point that is believed, m")] = 0.2
    row_spread_px: Annotated[
        float, Field(gt=0, le=5, description="one sigma of the difference of rows after rectification, px")
    ] = 0.3
    row_difference_px: Annotated[
        float, Field(gt=0, le=20, description="most difference of rows after rectification, px")
    ] = 1.5
    slant_spread: Annotated[
        float, Field(gt=0, le=2, description="one sigma of the change of disparity from pixel to pixel")
    ] = 0.3
    correction_px: Annotated[
        float, Field(gt=0, le=20, description="most correction of the disparity that was expected or found, px")
    ] = 2.5
    retry_frames: Annotated[
        int, Field(ge=1, le=1000, description="a point that was not found is sought again every so many frames")
    ] = 4
    block_px: Annotated[int, Field(ge=5, le=41, description="side of the block that finds new points, px")] = 17
    block_score: Annotated[
        float, Field(ge=0, lt=1, description="least correlation of that block with the right image")
    ] = 0.6
    block_rival: Annotated[
        float, Field(gt=0, le=1, description="a second place with this share of the best score makes it ambiguous")
    ] = 0.98


class MotionCheckConfig(StageConfig):
    """One rigid motion must explain the tracks (RANSAC)."""

    error_px: Annotated[float, Field(gt=0, le=50, description="most error of a track against that motion, px")] = 2.0
    fine_error_px: Annotated[
        float, Field(gt=0, le=50, description="the same of one whose patch has been aligned, px")
    ] = 1.0
    iterations: Annotated[int, Field(ge=10, le=10000, description="most samples of three points")] = 200
    confidence: Annotated[float, Field(gt=0.5, lt=1, description="of having drawn a sample without a fault")] = 0.999
    least_points: Annotated[int, Field(ge=4, le=100, description="fewer points are not judged")] = 8
    least_share: Annotated[
        float, Field(gt=0, lt=1, description="where fewer agree on a motion, none is dropped for it")
    ] = 0.4
    sure_share: Annotated[
        float,
        Field(gt=0, lt=1, description="a motion that fewer of all points share says nothing of the others"),
    ] = 0.25


class SightConfig(StageConfig):
    """When the cameras see well, badly, or not at all."""

    lost_tracks: Annotated[int, Field(ge=0, description="blind with fewer stereo tracks than this")] = 8
    degraded_tracks: Annotated[int, Field(ge=0, description="degraded with fewer stereo tracks than this")] = 40
    dark_level: Annotated[
        float, Field(ge=0, le=255, description="mean brightness below which it is too dark, grey levels")
    ] = 8.0
    bright_level: Annotated[
        float, Field(ge=0, le=255, description="mean brightness above which it is overexposed, grey levels")
    ] = 247.0
    least_contrast: Annotated[
        float, Field(ge=0, le=128, description="standard deviation below which an image is featureless, grey levels")
    ] = 2.0
    kept_share: Annotated[
        float, Field(ge=0, le=1, description="degraded where fewer tracks than this share were followed")
    ] = 0.25
    patience_frames: Annotated[
        int, Field(ge=0, le=1000, description="after so many blind frames the tracks from before are given up")
    ] = 5


class FrontendConfig(StageConfig):
    """Stereo images to tracks of points."""

    detection: Annotated[DetectionConfig, Field(description="new points")] = DetectionConfig()
    flow: Annotated[FlowConfig, Field(description="from frame to frame")] = FlowConfig()
    patch: Annotated[PatchConfig, Field(description="alignment of patches")] = PatchConfig()
    likeness: Annotated[LikenessConfig, Field(description="when patches show the same thing")] = LikenessConfig()
    anchor: Annotated[AnchorConfig, Field(description="against creeping away")] = AnchorConfig()
    stereo: Annotated[StereoConfig, Field(description="from left to right")] = StereoConfig()
    motion: Annotated[MotionCheckConfig, Field(description="rejection of wrong tracks")] = MotionCheckConfig()
    sight: Annotated[SightConfig, Field(description="what counts as seeing")] = SightConfig()
