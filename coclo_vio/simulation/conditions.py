# SPDX-License-Identifier: BSD-3-Clause
"""Named conditions of legs, vision and IMUs: changes to the configuration of a trial, from the best to the worst.

Without a condition a trial has the defaults: an imperfect robot, cameras mounted 0.2 deg and 2 mm off, good IMUs.
Several conditions are applied in the order in which they are named; where two change one value, the later one holds.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

from coclo_vio.simulation.trial.imperfection import IDEAL
from coclo_vio.values.errors import ConfigError, listing

ConditionKind = Literal["legs", "vision", "imu"]

_DEG = 0.017453292519943295
_OF_CAMERAS = ("camera_position_m", "camera_rotation_rad", "baseline_m", "baseline_rotation_rad")


@dataclass(frozen=True, slots=True)
class Condition:
    """A condition.

    Attributes:
        kind: what it is about.
        description: what is the case, in a phrase.
        changes: to the configuration of a simulated recording.
    """

    kind: ConditionKind
    description: str
    changes: Mapping[str, Any]


def _imperfection(*, of_cameras: bool, **more: float) -> Mapping[str, Any]:
    """No imperfection of the legs, or of the cameras, or another value of one."""
    values = IDEAL.model_dump(exclude={"camera_turn_rad", "wrong_zero_rad"})
    zero = {name: value for name, value in values.items() if (name in _OF_CAMERAS) == of_cameras}
    return {"trial": {"imperfection": {**zero, **more}}}


def _slip(**values: float) -> Mapping[str, Any]:
    return {"trial": {"slip": values}}


def _scene(**values: Any) -> Mapping[str, Any]:
    return {"scene": values}


def _camera(**values: Any) -> Mapping[str, Any]:
    return {"camera": values}


def _cheap(imu: str) -> Mapping[str, Any]:
    return {"trial": {imu: {"accelerometer_bias": 0.15, "gyroscope_bias": 0.01}}}


_LEGS: Mapping[str, Condition] = {
    "legs_exact": Condition("legs", "legs equal their description", _imperfection(of_cameras=False)),
    "legs_slippery": Condition(
        "legs",
        "patches, step edges and touch-downs of low friction",
        _slip(
            patches_per_m2=0.4,
            patch_friction=0.35,
            edge_m=0.15,
            edge_friction=0.12,
            touch_down_s=0.2,
            touch_down_friction=0.3,
        ),
    ),
    "encoder_off": Condition(
        "legs", "the zero of one encoder is 5 deg off", {"trial": {"imperfection": {"wrong_zero_rad": 5.0 * _DEG}}}
    ),
}
_MOUNTING: Mapping[str, Condition] = {
    "vision_exact": Condition("vision", "cameras equal their calibration", _imperfection(of_cameras=True)),
    "mounting_3_deg": Condition(
        "vision",
        "the stereo camera is turned by 3 deg on the robot",
        {"trial": {"imperfection": {"camera_turn_rad": 3.0 * _DEG}}},
    ),
    "images_late": Condition("vision", "stamps of images are 30 ms late", {"trial": {"frame_delay_s": 0.03}}),
}
_SURFACES: Mapping[str, Condition] = {
    "poor_texture": Condition("vision", "little texture", _scene(texture="poor", contrast=1.0)),
    "weak_texture": Condition("vision", "hardly any texture", _scene(texture="poor", contrast=0.45)),
    "textureless_end": Condition("vision", "no texture on the last third of the way", _scene(bare_from=2.0 / 3.0)),
    "tiles": Condition("vision", "ground and walls of tiles that look the same", _scene(pattern="tiles")),
    "bricks": Condition("vision", "ground and walls of bricks", _scene(pattern="bricks")),
    "relief": Condition("vision", "stones beside the way, uneven walls", _scene(rubble=200, wall_relief=60)),
    "far_walls": Condition("vision", "walls 12 to 20 m away", _scene(wall_distance_m=(12.0, 20.0), clutter=0)),
    "mirrors": Condition("vision", "specular patches on the ground", _scene(mirrors=12)),
    "moving_persons": Condition("vision", "persons walk beside the way", _scene(moving=5)),
}
_LIGHT: Mapping[str, Condition] = {
    "motion_blur": Condition(
        "vision", "exposures of 30 ms instead of 8.5 ms", _camera(exposure={"nominal_s": 0.03, "longest_s": 0.05})
    ),
    "rolling_shutter": Condition("vision", "rows are read within 30 ms", _camera(imager={"readout_s": 0.03})),
    "exposure_jumps": Condition("vision", "the gain jumps by 50 % every 2 s", _camera(exposure={"jump": 0.5})),
    "shadows": Condition(
        "vision",
        "broad stripes of shade, and the robot's own shadow",
        _camera(lighting={"bars": 0.6, "own_shadow": 0.6}),
    ),
    "lamp": Condition("vision", "a lamp on the robot gives most of the light", _camera(lighting={"lamp": 0.8})),
}
_IMUS: Mapping[str, Condition] = {
    "cheap_body_imu": Condition("imu", "biases of sigma 0.15 m/s^2 and 0.01 rad/s in the body's IMU", _cheap("imu")),
    "cheap_camera_imu": Condition("imu", "the same in the camera's IMU", _cheap("camera_imu")),
}

CONDITIONS: Mapping[str, Condition] = {**_LEGS, **_MOUNTING, **_SURFACES, **_LIGHT, **_IMUS}
"""All conditions by name."""


def condition_changes(names: Sequence[str]) -> Iterator[Mapping[str, Any]]:
    """The changes of the conditions of these names, in order.

    Raises:
        ConfigError: a name that no condition has.
    """
    for name in names:
        if name not in CONDITIONS:
            raise ConfigError(f"there is no condition {name!r}; choose from {listing(CONDITIONS)}")
        yield CONDITIONS[name].changes
