# SPDX-License-Identifier: BSD-3-Clause
"""The parameters of the room and of the simulated cameras.

The defaults are those of the infrared imagers of a RealSense D435i (OmniVision OV9282, global shutter) with its dot
projector switched off, as visual odometry requires.
"""

from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from coclo_vio.values.config import StageConfig


class SceneConfig(StageConfig):
    """The room around a trial: plain walls with posters, and clutter on the floor."""

    texture: Annotated[
        Literal["rich", "normal", "poor"],
        Field(description="amount of visual texture: contrast, posters, share of plain faces of the clutter"),
    ] = "normal"
    wall_distance_m: Annotated[
        tuple[float, float], Field(description="least and greatest distance of the walls from the walked area, m")
    ] = (2.5, 5.0)
    clutter: Annotated[int, Field(ge=0, le=100, description="boxes and pillars between walked area and walls")] = 14
    clearance_m: Annotated[
        float, Field(ge=0.1, le=5.0, description="least distance of clutter from the walked area, m")
    ] = 0.8
    texel_m: Annotated[
        float, Field(ge=2e-4, le=0.02, description="side of a texture's pixel on the surface, m; 1 px at 0.8 m")
    ] = 0.002
    texture_px: Annotated[int, Field(ge=64, le=4096, description="side of the square texture tiles, px")] = 1024
    contrast: Annotated[float, Field(gt=0, le=2, description="further factor on the contrast of all textures")] = 1.0
    pattern: Annotated[
        Literal["leaves", "tiles", "bricks"],
        Field(description="of ground and walls: random shapes, tiles of 17 cm with one motif, or bricks of 20 x 10 cm"),
    ] = "leaves"
    rubble: Annotated[int, Field(ge=0, le=1000, description="stones of 4 to 30 cm beside the way, at any attitude")] = 0
    wall_relief: Annotated[int, Field(ge=0, le=1000, description="boxes that stand out from the walls")] = 0
    moving: Annotated[int, Field(ge=0, le=20, description="persons that walk to and fro beside the way")] = 0
    mirrors: Annotated[int, Field(ge=0, le=20, description="specular patches of 1 m by 0.6 m on the ground")] = 0
    mirror_share: Annotated[float, Field(ge=0, le=1, description="of the light that these patches reflect")] = 0.6
    bare_from: Annotated[
        float | None,
        Field(ge=0, le=1, description="share of the recorded way from which all surfaces are bare; null: never"),
    ] = None

    @model_validator(mode="after")
    def _walls_are_beyond_the_clutter(self) -> Self:
        near, far = self.wall_distance_m
        if not 0.3 <= near <= far <= 50.0:
            raise ValueError(f"wall_distance_m = {self.wall_distance_m} must be [least, greatest], both in 0.3 to 50 m")
        return self


class ImagerConfig(StageConfig):
    """The sensor and its lens.

    Sources: OmniVision's data sheet of the OV9281/OV9282: greatest signal-to-noise ratio 38 dB, dynamic range 68 dB,
    analogue gain up to 15.9. At full well shot noise dominates, so the well holds 10^(38/10) = 6300 electrons,
    and the noise floor is sqrt(6300^2 / 10^(68/10)) = 2.5 electrons. Lens, vignetting and pattern are typical values
    of such modules, chosen, not measured.
    """

    full_well_e: Annotated[float, Field(ge=100, le=1e6, description="electrons of a white pixel at gain 1")] = 6300.0
    read_noise_e: Annotated[float, Field(ge=0, le=1000, description="noise floor, electrons rms")] = 2.5
    pattern_noise: Annotated[
        float, Field(ge=0, le=0.2, description="spread of the pixels' sensitivity, share, fixed for a camera")
    ] = 0.006
    vignetting: Annotated[float, Field(ge=0, le=0.9, description="loss of light in the image corners, share")] = 0.3
    lens_blur_px: Annotated[float, Field(ge=0, le=5, description="sigma of the lens's Gaussian blur, px")] = 0.7
    gain_mismatch: Annotated[
        float, Field(ge=0, le=0.5, description="spread of the two cameras' sensitivity, share, fixed by the seed")
    ] = 0.005
    readout_s: Annotated[
        float, Field(ge=0, le=0.05, description="from the first to the last row, s; 0: global shutter")
    ] = 0.0


class ExposureConfig(StageConfig):
    """Exposure time and gain: automatic, as the D435i's, with a first-order lag.

    The controller measures the light in the room, not the image; the reaction of a real one to the image's content is
    modelled by the slow drift, an Ornstein-Uhlenbeck process of the logarithm of the gain.
    """

    nominal_s: Annotated[
        float,
        Field(gt=0, le=0.05, description="exposure time in normal light, s (librealsense's long-standing default)"),
    ] = 0.0085
    longest_s: Annotated[float, Field(gt=0, le=0.1, description="longest exposure time, s")] = 0.02
    nominal_gain: Annotated[
        float, Field(ge=1, le=16, description="analogue gain in normal light; 1.5 gives 2.5 grey levels rms at 100")
    ] = 1.5
    largest_gain: Annotated[float, Field(ge=1, le=64, description="largest analogue gain (OV9282: 15.9)")] = 15.9
    white_level: Annotated[
        float,
        Field(gt=0, le=4, description="white wall at nominal exposure, share of full scale; > 1 saturates"),
    ] = 1.25
    lag_s: Annotated[float, Field(gt=0, le=10, description="time constant of the controller, s")] = 0.12
    drift: Annotated[float, Field(ge=0, le=1, description="standard deviation of the gain's slow drift, share")] = 0.06
    drift_time_s: Annotated[float, Field(gt=0, le=1000, description="time constant of that drift, s")] = 8.0
    jump: Annotated[
        float, Field(ge=0, le=2, description="standard deviation of the logarithm of the gain after each jump")
    ] = 0.0
    jump_every_s: Annotated[float, Field(gt=0, le=1000, description="mean time between jumps, s")] = 2.0

    @model_validator(mode="after")
    def _limits_hold_the_nominal_values(self) -> Self:
        if self.longest_s < self.nominal_s or self.largest_gain < self.nominal_gain:
            raise ValueError(
                f"longest_s = {self.longest_s} and largest_gain = {self.largest_gain} must not be below "
                f"nominal_s = {self.nominal_s} and nominal_gain = {self.nominal_gain}"
            )
        return self


class Blackout(StageConfig):
    """A time without light."""

    start_s: Annotated[float, Field(ge=0, le=1e5, description="start, s after the first image")]
    duration_s: Annotated[float, Field(gt=0, le=1e5, description="duration, s")]


class LightingConfig(StageConfig):
    """The light in the room."""

    level: Annotated[Literal["normal", "dark"], Field(description="light of an office, or of an emergency lamp")] = (
        "normal"
    )
    dark_share: Annotated[float, Field(gt=0, le=1, description="light of a dark room, share of normal light")] = 0.05
    blackouts: Annotated[tuple[Blackout, ...], Field(description="times without light")] = ()
    bars: Annotated[
        float, Field(ge=0, le=1, description="share of the light that bars before a window take away, in stripes")
    ] = 0.0
    bar_m: Annotated[float, Field(gt=0.02, le=10, description="distance from stripe to stripe, m")] = 1.2
    bar_edge_m: Annotated[
        float, Field(gt=0, le=5, description="breadth of a stripe's edge, m; soft edges are no landmarks")
    ] = 0.15
    own_shadow: Annotated[
        float, Field(ge=0, le=1, description="share of the light that the robot's own shadow takes away")
    ] = 0.0
    lamp: Annotated[
        float, Field(ge=0, le=1, description="share of the light that comes from a lamp beside the camera")
    ] = 0.0


class CameraConfig(StageConfig):
    """Sensor, exposure, light and encoding: from the scene to the image file."""

    imager: Annotated[ImagerConfig, Field(description="sensor and lens")] = ImagerConfig()
    exposure: Annotated[ExposureConfig, Field(description="exposure time and gain")] = ExposureConfig()
    lighting: Annotated[LightingConfig, Field(description="light in the room")] = LightingConfig()
    encoding: Annotated[Literal["png", "jpeg"], Field(description="png keeps every bit, jpeg is a third as large")] = (
        "png"
    )
    jpeg_quality: Annotated[int, Field(ge=1, le=100, description="quality of jpeg files, percent")] = 90
