# SPDX-License-Identifier: BSD-3-Clause
"""Parameters of the filter. The noise of a robot's sensors is in its description, not here."""

import math
from collections.abc import Mapping
from typing import Annotated, Any, Literal, Self

from pydantic import Field

from coclo_vio.filter.leg_check_config import LegCheckConfig
from coclo_vio.robot.description import RobotDescription
from coclo_vio.robot.slip import SlipConfig
from coclo_vio.robot.standstill import StandstillConfig
from coclo_vio.values.config import StageConfig, merged

Noise = Annotated[float, Field(gt=0)]


class InitialConfig(StageConfig):
    """One-sigma uncertainties at the start from rest. Yaw and position are zero by definition of the world."""

    tilt_rad: Annotated[float, Field(gt=0, lt=1, description="before gravity has been measured, rad")] = 0.2
    moving_tilt_rad: Annotated[float, Field(gt=0, lt=1, description="tilt of a start without rest, rad")] = 0.1
    velocity_mps: Annotated[float, Field(gt=0, description="at rest, m/s")] = 0.01
    moving_velocity_mps: Annotated[float, Field(gt=0, description="of a start without rest, m/s")] = 1.0
    gyroscope_bias_radps: Annotated[
        float | None, Field(gt=0, description="before a standstill has been measured, rad/s; null: by the IMU's grade")
    ] = None
    accelerometer_bias_mps2: Annotated[
        float | None, Field(gt=0, description="of each axis, m/s^2; null: by the IMU's grade")
    ] = None
    rest_force_noise_mps2: Annotated[
        float, Field(gt=0, description="mean specific force at rest, beyond its bias, m/s^2")
    ] = 0.02
    rest_rate_noise_radps: Annotated[
        float, Field(gt=0, description="mean angular velocity at rest, beyond its bias, rad/s")
    ] = 0.003
    camera_rotation_sigma_rad: Annotated[
        float,
        Field(ge=0, lt=0.2, description="error of the cameras' mounting, each axis, where there are cameras, rad"),
    ] = 0.004
    stereo_scale_sigma: Annotated[
        float, Field(ge=0, lt=0.2, description="relative error of lengths by stereo, where there are cameras")
    ] = 0.005


class GroundConfig(StageConfig):
    """The plane of the ground under rolling feet, by the last footholds."""

    is_enabled: Annotated[
        bool, Field(description="whether feet roll on the plane of the last footholds, where they lie in one")
    ] = True
    evenness_m: Annotated[
        float, Field(gt=0, lt=0.1, description="one sigma of a foothold's distance from the plane of an even slope, m")
    ] = 0.004
    leg_height_sigma_m: Annotated[
        float, Field(gt=0, lt=0.2, description="one sigma of the constant error of height of a leg's kinematics, m")
    ] = 0.01
    least_stance_s: Annotated[float, Field(ge=0, description="a foot that stood for less leaves no foothold, s")] = 0.05


class RobustConfig(StageConfig):
    """The ``robust`` profile."""

    angular_acceleration_density: Annotated[
        float, Field(gt=0, description="white angular acceleration of the body, rad/s^2/sqrt(Hz)")
    ] = 3.0
    acceleration_density: Annotated[
        float,
        Field(gt=0, description="white acceleration of the body without its accelerometer, m/s^2/sqrt(Hz)"),
    ] = 1.0
    acceleration_input_density: Annotated[
        float,
        Field(
            gt=0,
            description="least noise of the velocity by the accelerometer, m/s^2/sqrt(Hz); a value of half of "
            "acceleration_density or more: it is not used",
        ),
    ] = 0.1
    settling_s: Annotated[
        float,
        Field(
            ge=0,
            lt=0.2,
            description="a foot that has touched down deflects and rebounds for so long: it is not used, where the "
            "accelerometer has the velocity meanwhile, s",
        ),
    ] = 0.04
    foothold_creep: Annotated[
        float, Field(gt=0, description="random walk of a foot in stance (slip, soft ground), m/sqrt(s)")
    ] = 0.003
    weighs_feet: Annotated[
        bool | None,
        Field(
            description="whether a standing foot weighs less the further its velocity departs from the body's; "
            "null: with at most four legs, none of them with a flat foot"
        ),
    ] = None
    stepping_creep: Annotated[
        float,
        Field(
            gt=0,
            description="random walk of a foot in stance where feet are weighed and the robot moves (deflection, "
            "roll-off, slip), m/sqrt(s)",
        ),
    ] = 0.02
    foot_departure_mps: Annotated[
        float,
        Field(
            gt=0, description="departure of a foot's velocity from which it weighs less, where feet are weighed, m/s"
        ),
    ] = 0.05
    holds_soles: Annotated[
        bool, Field(description="whether a flat foot that rests holds its orientation, not its place alone")
    ] = True
    foot_rotation_noise_rad: Annotated[
        float, Field(gt=0, lt=0.5, description="one sigma of a flat foot's rotation beyond its encoders, rad")
    ] = 0.003
    foot_rotation_memory_s: Annotated[
        float, Field(ge=0, description="that error lasts so long: rotations within this time count as one, s")
    ] = 1.0
    sole_creep_rad: Annotated[
        float, Field(gt=0, description="random walk of the orientation of a resting sole, rad/sqrt(s)")
    ] = 0.0005
    sole_steady_radps: Annotated[
        float, Field(gt=0, le=10, description="a sole that rotates faster stands on its heel, toe or edge, rad/s")
    ] = 0.15
    foot_position_noise_m: Annotated[
        float, Field(gt=0, description="one sigma of a foot position beyond its encoders (bending), m")
    ] = 0.0005
    foot_velocity_noise_mps: Annotated[
        float, Field(gt=0, description="one sigma of a stance foot's velocity (slip, bending), m/s")
    ] = 0.05
    step_deflection_s: Annotated[
        float,
        Field(
            ge=0,
            lt=0.1,
            description="one sigma of the body's displacement within a step that legs do not measure (bending, "
            "roll-off), m per m/s of its speed: noise of the pose at a camera frame, each axis",
        ),
    ] = 0.002
    no_contact_velocity_density: Annotated[
        float, Field(gt=0, description="white velocity of any foot while no foot carries the body, m/s/sqrt(Hz)")
    ] = 0.2
    gravity_noise_mps2: Annotated[
        float, Field(gt=0, description="one sigma of a window's specific force less the body's acceleration, m/s^2")
    ] = 0.1
    gravity_dwell_s: Annotated[
        float, Field(ge=0, description="a foot must have stood this long before gravity is measured, s")
    ] = 0.03
    gravity_window_s: Annotated[
        float, Field(gt=0, le=2, description="gravity is the mean over windows of this length, s")
    ] = 0.5
    gravity_least_scale: Annotated[
        float,
        Field(
            gt=0, le=1, description="the noise of gravity follows its innovations down to this share; 1: it does not"
        ),
    ] = 0.35
    rolls_feet: Annotated[bool, Field(description="whether spherical feet roll about their contact point")] = True
    ground: GroundConfig = GroundConfig()
    estimates_leg_scale: Annotated[
        bool, Field(description="whether the effective leg length is estimated, from the gyroscope against the legs")
    ] = False
    leg_scale_sigma: Annotated[
        float, Field(gt=0, lt=0.5, description="relative error of the effective leg length at the start")
    ] = 0.05
    leg_scale_walk: Annotated[float, Field(ge=0, description="its random walk, 1/sqrt(s)")] = 0.001
    estimates_leg_compliance: Annotated[
        bool, Field(description="whether leg compliance under load is estimated, by comparing legs with each other")
    ] = True
    leg_compliance_sigma_m: Annotated[
        float,
        Field(gt=0, lt=0.1, description="one sigma of the compression of a leg under the load from which it stands, m"),
    ] = 0.002
    leg_compliance_walk_m: Annotated[float, Field(ge=0, description="its random walk, m/sqrt(s)")] = 1e-5
    slip_share: Annotated[
        float,
        Field(
            ge=0, lt=1, description="one sigma of the common slip of all standing feet, as a share of the body's speed"
        ),
    ] = 0.015
    load_slip_part: Annotated[
        float | None,
        Field(
            ge=0,
            le=1,
            description="part of the variance of that slip that comes while standing feet take over the weight of one "
            "that lifts off; null: half with more than four legs, otherwise none",
        ),
    ] = None
    slip_turn_per_m: Annotated[
        float,
        Field(
            ge=0, lt=1, description="one sigma of the rotation of the body by that slip for each metre walked, rad/m"
        ),
    ] = 0.01
    slip_memory_s: Annotated[float, Field(gt=0, description="time constant of that slip, s")] = 10.0
    takes_slip_for_known: Annotated[
        bool | None,
        Field(
            description="whether legs correct the state as if that slip, which they do not measure, were known; "
            "null: with at most four legs and without cameras"
        ),
    ] = None
    learns_slip: Annotated[
        bool,
        Field(
            description="whether the sizes of that slip and of the creep of feet are learnt where vision corrects the "
            "filter"
        ),
    ] = True
    gyroscope_noise_density: Annotated[
        float,
        Field(
            ge=0, description="least white noise, rad/s/sqrt(Hz), also with a better calibration: impacts, scale, axes"
        ),
    ] = 5e-4
    imu_delay_s: Annotated[
        float,
        Field(gt=-0.03, lt=0.03, description="expected delay of the gyroscope behind the joints (its low-pass), s"),
    ] = 0.003
    imu_delay_sigma_s: Annotated[
        float, Field(ge=0, lt=0.03, description="one sigma of that, s; 0: it is known, otherwise it is estimated")
    ] = 0.003
    gate_probability: Annotated[
        float, Field(gt=0.5, lt=1, description="share of correct leg measurements that pass the innovation gate")
    ] = 0.997
    leg_check: Annotated[LegCheckConfig, Field(description="comparison of each leg with the others")] = LegCheckConfig()
    recovery_s: Annotated[
        float, Field(gt=0, description="time without any accepted stance leg after which all are accepted again, s")
    ] = 0.02
    standstill_velocity_noise_mps: Annotated[
        float, Field(gt=0, description="one sigma of the body velocity at standstill, m/s")
    ] = 0.02
    standstill_rate_noise_radps: Annotated[
        float, Field(gt=0, description="one sigma of the body rate at standstill, rad/s")
    ] = 0.002


class PaperConfig(StageConfig):
    """The ``paper`` profile: sections III-B to III-E as printed. The paper gives no numbers for Q and R."""

    swing_probability: Annotated[
        float, Field(gt=0, lt=1, description="isSwing: a foot swings below this contact probability")
    ] = 0.5
    certain_stance_probability: Annotated[
        float, Field(gt=0, le=1, description="from here on a stance is certain and its Q entries shrink")
    ] = 0.9
    certain_stance_ratio: Annotated[
        float, Field(gt=0, le=1, description="what Q of a foot in certain stance is multiplied by (section III-E)")
    ] = 0.01
    position_walk: Annotated[float, Field(gt=0, description="Q of position, m/sqrt(s)")] = 0.01
    velocity_walk: Annotated[float, Field(gt=0, description="Q of velocity, m/s/sqrt(s)")] = 1.0
    rotation_walk: Annotated[float, Field(gt=0, description="Q of rotation, rad/sqrt(s)")] = 0.01
    rate_walk: Annotated[float, Field(gt=0, description="Q of angular velocity, rad/s/sqrt(s)")] = 10.0
    foot_walk: Annotated[float, Field(gt=0, description="Q of a foot, m/sqrt(s)")] = 0.1
    contact_walk: Annotated[float, Field(gt=0, description="Q of a contact probability, 1/sqrt(s)")] = 5.0
    gravity_noise_mps2: Annotated[float, Field(gt=0, description="R of the gravity rows, m/s^2")] = 0.5
    velocity_noise_mps: Annotated[float, Field(gt=0, description="R of the body velocity rows, m/s")] = 0.05
    rate_noise_radps: Annotated[float, Field(gt=0, description="R of the angular velocity rows, rad/s")] = 0.05
    foot_noise_m: Annotated[float, Field(gt=0, description="R of the relative foot positions, m")] = 0.002
    contact_noise: Annotated[float, Field(gt=0, description="R of the contact probabilities")] = 0.1


class GateConfig(StageConfig):
    """The innovation gate of evidence from outside."""

    probability: Annotated[
        float, Field(gt=0.5, lt=1, description="share of correct evidence that passes the innovation gate")
    ] = 0.9999
    max_rejections: Annotated[
        int,
        Field(ge=1, description="after so many rejections in a row the covariance is inflated and evidence accepted"),
    ] = 3


class CameraImuConfig(StageConfig):
    """The camera's IMU beside the body's, in the ``robust`` profile."""

    is_used: Annotated[bool, Field(description="whether the filter uses it where it is there and calibrated")] = True
    rotation_sigma_rad: Annotated[
        float, Field(gt=0, lt=0.2, description="error of its mounting against the body's IMU, each axis, rad")
    ] = 0.004
    delay_sigma_s: Annotated[
        float, Field(gt=0, lt=1, description="delay of its readings behind those of the body's IMU, s")
    ] = 0.005
    window_s: Annotated[float, Field(gt=0.02, le=1, description="length of a comparison of the two, s")] = 0.1
    rate_noise_radps: Annotated[
        float, Field(gt=0, description="one sigma of a difference of angular velocities beyond the gyroscopes', rad/s")
    ] = 0.001
    force_noise_mps2: Annotated[
        float, Field(gt=0, description="one sigma of a difference of specific forces (shocks, bending), m/s^2")
    ] = 0.1
    gate_probability: Annotated[
        float, Field(gt=0.5, lt=1, description="share of correct differences that pass the innovation gate")
    ] = 0.9999
    max_rejections: Annotated[
        int, Field(ge=1, description="after so many rejected differences in a row all biases count as unknown again")
    ] = 10


class FilterConfig(StageConfig):
    """COCLO: the profile, its parameters, the start, and gaps in the data."""

    @classmethod
    def of_robot(cls, robot: RobotDescription, changes: Mapping[str, Any] | None = None) -> Self:
        """The defaults, changed by ``filter`` in the robot's description, then by ``changes``.

        Raises:
            ConfigError: a key that does not exist, or a value out of bounds.
        """
        return cls.parse(merged(robot.filter, changes or {}), f"filter of robot {robot.name!r}")

    @property
    def rolls_feet(self) -> bool:
        """Whether feet roll about their point of contact: spheres, and flat feet on heel and toe."""
        return self.profile == "robust" and self.robust.rolls_feet

    def gyroscope_noise_radps(self, density: float, dt_s: float) -> float:
        """One sigma of a gyroscope of a noise density, rad/s/sqrt(Hz), averaged over a step, rad/s."""
        density = max(density, self.robust.gyroscope_noise_density) if self.profile == "robust" else density
        return density / math.sqrt(dt_s)

    profile: Annotated[
        Literal["robust", "paper"], Field(description="paper: section III as printed; robust: recommended")
    ] = "robust"
    robust: Annotated[RobustConfig, Field(description="parameters of the robust profile")] = RobustConfig()
    paper: Annotated[PaperConfig, Field(description="parameters of the paper profile")] = PaperConfig()
    initial: Annotated[InitialConfig, Field(description="uncertainty at the start")] = InitialConfig()
    camera_imu: Annotated[CameraImuConfig, Field(description="the camera's IMU beside the body's")] = CameraImuConfig()
    feedback_gate: Annotated[GateConfig, Field(description="innovation gate of evidence from outside (vision)")] = (
        GateConfig()
    )
    standstill: Annotated[StandstillConfig, Field(description="limits of a standstill")] = StandstillConfig()
    slip: Annotated[SlipConfig, Field(description="feet that slip, looked for and reported")] = SlipConfig()
    rest_timeout_s: Annotated[
        float, Field(ge=0, description="time to wait for a standstill before starting on the move, s")
    ] = 0.45
    max_gap_s: Annotated[
        float,
        Field(gt=0, description="a longer gap between joint samples ends every foothold; the IMU goes on alone, s"),
    ] = 0.1
    max_frame_delay_s: Annotated[
        float, Field(ge=0, le=5, description="a camera frame that comes later after the joint samples is left out, s")
    ] = 1.1
    force_timeout_s: Annotated[float, Field(gt=0, description="foot forces older than this count as missing, s")] = 0.1
