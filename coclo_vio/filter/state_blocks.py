# SPDX-License-Identifier: BSD-3-Clause
"""The blocks of the filter's error state: each declared once, with all that the filter derives from it.

``StateLayout`` (``state``) derives the order of the errors, the sigmas at the start, random walks, decay, what is
remembered and what is reported. A further state is one more ``StateBlock`` in ``body_blocks``, or given to a profile.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from enum import Enum

from coclo_vio.filter.config import InitialConfig, PaperConfig, RobustConfig
from coclo_vio.values.calibration import ImuCalibration

ZERO_SIGMA = 1e-9
"""Sigma of what is zero by definition: position and yaw at the start, poses that are not remembered yet."""

KNOWN_SIGMA = 1e-12
"""Sigma of what is known and not estimated: not zero, so that the factor of the covariance has an inverse."""

KEYFRAME, FRAME, ANCHOR = "keyframe", "frame", "anchor"
"""Names of the remembered poses."""

HELD = "held_frame"
"""Name of the pose of a frame that waits until the one before it is processed, where there is one."""

FEW_LEGS = 4
"""Of a robot of at most so many legs two stand in a trot: they contradict each other with one sign for long."""

_LOAD_SLIP_PART = 0.5  # of the variance of slip, with more legs: feet stand long, and take over weight again and again


class Retraction(Enum):
    """How an error ``e`` of a block changes its mean.

    ``ROTATION``: ``R = exp(e) R_mean``, of the body; it turns the world. ``WORLD``: vectors in the world, which that
    rotation turns, ``x = exp(e_R) (x_mean + e)``. ``PLAIN``: ``x = x_mean + e``. ``POSE``: rotation, then position, of
    a remembered pose, which turns by its own rotation error.
    """

    ROTATION = "rotation"
    WORLD = "world"
    PLAIN = "plain"
    POSE = "pose"


class Curvature(Enum):
    """In which models a block is not linear, given the blocks before it; the value orders the blocks."""

    PROCESS_AND_MEASUREMENT = 0
    PROCESS = 1
    FLAT = 2


@dataclass(frozen=True, slots=True)
class StateBlock:
    """Some errors of the state that are handled alike.

    Attributes:
        name: unique.
        size: number of errors.
        retraction: how errors change the mean.
        curvature: in which models the block is curved.
        sigma: at the start, one for all errors or one each.
        moving_sigma: the same for a start without rest; None: as ``sigma``.
        walk: density of its random walk, its unit by sqrt(s).
        memory_s: time constant with which its mean decays to zero, s.
        is_reported: whether its value and sigma are reported by name.
        is_passive: whether neither process nor measurements of legs and IMU touch it: poses remembered, and cameras.
    """

    name: str
    size: int
    retraction: Retraction = Retraction.PLAIN
    curvature: Curvature = Curvature.FLAT
    sigma: float | tuple[float, ...] = ZERO_SIGMA
    moving_sigma: float | tuple[float, ...] | None = None
    walk: float = 0.0
    memory_s: float = math.inf
    is_reported: bool = False
    is_passive: bool = False


def body_blocks(
    robust: RobustConfig, initial: InitialConfig, imu: ImuCalibration, *, load_slip_part: float = 0.0
) -> tuple[StateBlock, ...]:
    """The blocks that every filter has, in their order: curved ones first; ``load_slip_part`` as it is resolved."""
    curved, moving_mps = Curvature.PROCESS_AND_MEASUREMENT, initial.moving_velocity_mps
    gyroscope_sigma, accelerometer_sigma = bias_sigmas(initial, imu)
    tilt, moving_tilt = ((rad, rad, ZERO_SIGMA) for rad in (initial.tilt_rad, initial.moving_tilt_rad))
    return (
        StateBlock("rotation", 3, Retraction.ROTATION, curved, sigma=tilt, moving_sigma=moving_tilt),
        StateBlock(
            "leg_scale",
            1,
            curvature=curved,
            sigma=robust.leg_scale_sigma if robust.estimates_leg_scale else KNOWN_SIGMA,
            walk=robust.leg_scale_walk * robust.estimates_leg_scale,
            is_reported=True,
        ),
        StateBlock("rate", 3, curvature=Curvature.PROCESS, sigma=initial.rest_rate_noise_radps, moving_sigma=1.0),
        StateBlock("gyroscope_bias", 3, sigma=gyroscope_sigma, walk=imu.gyroscope_bias_walk),
        StateBlock("accelerometer_bias", 3, sigma=accelerometer_sigma, walk=imu.accelerometer_bias_walk),
        StateBlock(
            "leg_compliance",
            1,
            sigma=robust.leg_compliance_sigma_m if robust.estimates_leg_compliance else KNOWN_SIGMA,
            walk=robust.leg_compliance_walk_m * robust.estimates_leg_compliance,
            is_reported=True,
        ),
        _slip("slip_turn", robust.slip_turn_per_m, robust.slip_memory_s),
        _slip("slip", robust.slip_share * math.sqrt(1.0 - load_slip_part), robust.slip_memory_s),
        _slip("load_slip", robust.slip_share * math.sqrt(load_slip_part), robust.slip_memory_s),
        StateBlock("gyroscope_scale", 3, sigma=max(imu.gyroscope_scale, KNOWN_SIGMA), is_reported=True),
        StateBlock("velocity", 3, Retraction.WORLD, sigma=initial.velocity_mps, moving_sigma=moving_mps),
        StateBlock("position", 3, Retraction.WORLD),
    )


def bias_sigmas(initial: InitialConfig, imu: ImuCalibration) -> tuple[float, float]:
    """One sigma of the biases of gyroscope, rad/s, and accelerometer, m/s^2: as configured, else those of the IMU."""
    gyroscope, accelerometer = initial.gyroscope_bias_radps, initial.accelerometer_bias_mps2
    return (
        imu.gyroscope_bias if gyroscope is None else gyroscope,
        imu.accelerometer_bias if accelerometer is None else accelerometer,
    )


def _slip(name: str, sigma: float, memory_s: float) -> StateBlock:
    """A slip that decays, with a walk that keeps its sigma."""
    if sigma == 0.0:  # it is known for ever: what decays without a walk leaves no covariance
        return StateBlock(name, 3, sigma=KNOWN_SIGMA, is_reported=True)
    walk = sigma * math.sqrt(2.0 / memory_s)
    return StateBlock(name, 3, sigma=sigma, walk=walk, memory_s=memory_s, is_reported=True)


def robust_blocks(
    legs: int,
    robust: RobustConfig,
    initial: InitialConfig,
    imu: ImuCalibration,
    *,
    has_frame: bool = False,
    extra: Sequence[StateBlock] = (),
) -> tuple[StateBlock, ...]:
    """The blocks of the ``robust`` profile.

    Args:
        legs: number of legs.
        robust: sigmas and walks.
        initial: sigmas at the start.
        imu: walks of the biases.
        has_frame: whether keyframe, frame, anchor and the cameras' errors are states.
        extra: further blocks.
    """
    feet = StateBlock("feet", 3 * legs, Retraction.WORLD)
    remembered = remembered_blocks(initial) if has_frame else ()
    held = [block for block in extra if block.name == HELD]
    others = [block for block in extra if block.name != HELD]
    part = robust.load_slip_part
    part = (_LOAD_SLIP_PART if legs > FEW_LEGS else 0.0) if part is None else part
    body = body_blocks(robust, initial, imu, load_slip_part=part)
    return (*body, feet, *held, *remembered, *others)  # poses: first of the passive ones


def paper_blocks(
    legs: int, paper: PaperConfig, initial: InitialConfig, imu: ImuCalibration, *, has_frame: bool = False
) -> tuple[StateBlock, ...]:
    """The blocks of the ``paper`` profile, arguments as in ``robust_blocks``.

    Every block has a random walk, contacts are states, what the paper does not estimate is known to be zero, and the
    prediction subtracts the gyroscope's bias from the rate.
    """
    walks = {
        "rotation": paper.rotation_walk,
        "rate": paper.rate_walk,
        "velocity": paper.velocity_walk,
        "position": paper.position_walk,
    }
    unknown_to_paper = {"gyroscope_scale", "leg_scale", "leg_compliance", "slip_turn", "slip", "load_slip"}
    body = []
    for block in body_blocks(RobustConfig(), initial, imu):
        if block.name in unknown_to_paper:
            body.append(replace(block, sigma=0.0, walk=0.0))
        else:
            curvature = Curvature.PROCESS if block.name == "gyroscope_bias" else block.curvature
            body.append(replace(block, curvature=curvature, walk=walks.get(block.name, block.walk)))
    feet = StateBlock("feet", 3 * legs, Retraction.WORLD, walk=paper.foot_walk)
    contacts = StateBlock("contacts", legs, sigma=0.5, walk=paper.contact_walk)
    remembered = remembered_blocks(initial) if has_frame else (_pose(KEYFRAME),)
    return (*body, feet, contacts, *remembered)


def remembered_blocks(initial: InitialConfig) -> tuple[StateBlock, ...]:
    """Keyframe, frame and anchor, and errors of the cameras: mounting (3, rad), relative error of stereo lengths."""
    sigmas = (*[initial.camera_rotation_sigma_rad] * 3, initial.stereo_scale_sigma)
    camera = StateBlock("camera", 4, sigma=sigmas, is_reported=True, is_passive=True)
    return (_pose(KEYFRAME), _pose(FRAME), _pose(ANCHOR), camera)


def held_frame_block() -> StateBlock:
    """The pose of a frame that waits, for ``Keyframe.hold_frame``."""
    return _pose(HELD)


def _pose(name: str) -> StateBlock:
    return StateBlock(name, 6, Retraction.POSE, is_passive=True)
