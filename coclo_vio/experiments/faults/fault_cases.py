# SPDX-License-Identifier: BSD-3-Clause
"""The faults of the matrix: settings of each, the streams that it is on, and how long it lasts.

Settings have places: START is when faults begin, REST what is left of the recording from there, LEG the second leg of
the robot and JOINT the middle joint of its third.
"""

from collections.abc import Mapping
from dataclasses import dataclass

from coclo_vio.datasets.read_report import STREAM_NAMES
from coclo_vio.robot.description import RobotDescription
from coclo_vio.values.measurements import CameraImuSample, FootForceSample, ImuSample, JointSample, StereoFrame

NOMINAL = "nominal"
MODES = ("coclo", "vins", "combined", "tight")
_IMAGES, _IMU, _CAMERA_IMU = STREAM_NAMES[StereoFrame], STREAM_NAMES[ImuSample], STREAM_NAMES[CameraImuSample]
_JOINTS, _FEET = STREAM_NAMES[JointSample], STREAM_NAMES[FootForceSample]
_LEGS = (_JOINTS, _FEET)
_ALL = (_JOINTS, _FEET, _IMU, _CAMERA_IMU, _IMAGES)


@dataclass(frozen=True, slots=True)
class FaultCase:
    """A fault.

    Attributes:
        name: what tables call it.
        streams: that it is on, by the names of ``STREAM_NAMES``.
        settings: of a run.
        seconds: its duration; None where it lasts to the end, or the whole time.
        step_s: the clock of all streams is off by this from START on, s; outputs follow it.
    """

    name: str
    streams: tuple[str, ...]
    settings: tuple[str, ...] = ()
    seconds: float | None = None
    step_s: float = 0.0

    @property
    def file_name(self) -> str:
        """The name without what not every file system allows."""
        return "".join(letter if letter.isalnum() or letter in ".-" else "_" for letter in self.name)

    def settings_on(self, robot: RobotDescription, start_s: float, end_s: float) -> list[str]:
        """The settings with their places filled.

        Args:
            robot: whose legs and joints they are.
            start_s: when faults begin, s.
            end_s: end of the recording, s.
        """
        legs = robot.legs
        joints = legs[2].joints
        places: Mapping[str, str] = {
            "START": f"{start_s:g}",
            "REST": f"{end_s - start_s + 1.0:g}",
            "LEG": legs[1].name,
            "JOINT": joints[len(joints) // 2],
        }
        filled = list(self.settings)
        for place, value in places.items():
            filled = [setting.replace(place, value) for setting in filled]
        return filled


def _case(name: str, streams: tuple[str, ...], fault: str, *more: str, seconds: float | None = None) -> FaultCase:
    """A fault of one setting; ``KEY=VALUE`` with VALUE quoted as a text where it has colons."""
    settings = []
    for each in (fault, *more):
        key, _, value = each.partition("=")
        settings.append(f"faults.{key}={[value]}" if ":" in value else f"faults.{key}={value}")
    return FaultCase(name, streams, tuple(settings), seconds)


def _images(name: str, fault: str, *, seconds: float | None = None) -> FaultCase:
    return _case(name, (_IMAGES,), fault, seconds=seconds)


def _imu(name: str, fault: str, *, seconds: float | None = None, of_camera: bool = False) -> FaultCase:
    streams = (_CAMERA_IMU,) if of_camera else (_IMU,)
    return _case(name, streams, fault, *(("faulty_imu=camera",) if of_camera else ()), seconds=seconds)


def _legs(name: str, fault: str, *, seconds: float | None = None) -> FaultCase:
    return _case(name, _LEGS, fault, seconds=seconds)


OF_CAMERAS = (
    _images("blackout 4 s", "blackouts=START:4", seconds=4.0),
    _images("frozen frame 4 s", "frozen_frames=START:4", seconds=4.0),
    _images("exposure x 5, 4 s", "exposure_jumps=START:4:5", seconds=4.0),
    _images("exposure x 0.1, 4 s", "exposure_jumps=START:4:0.1", seconds=4.0),
    _images("blur 4 px, 4 s", "blurred_images=START:4:4", seconds=4.0),
    _images("left and right swapped 4 s", "swapped_images=START:4", seconds=4.0),
    _images("half the frames lost", "frame_loss=0.5"),
    _images("half resolution 4 s, calibration stays", "halved_images=START:4", seconds=4.0),
    _images("half resolution with its calibration", "halved_cameras=true"),
    _images("mounting 3 deg off", "camera_turn_deg=[1.7, -1.7, 1.7]"),
    _images("mounting 5 cm off", "camera_shift_m=[0.03, 0.03, -0.03]"),
    _images("image stamps 40 ms late", "image_delay_s=0.04"),
    _images("image stamps 40 ms early", "image_delay_s=-0.04"),
    _images("image stamps 0.5 s late", "image_delay_s=0.5"),
    _images("image stamps 0.5 s early", "image_delay_s=-0.5"),
)
OF_IMUS = (
    _imu("IMU saturated at 0.1 rad/s, 10.5 m/s^2, 4 s", "imu_saturation=START:4:0.1:10.5", seconds=4.0),
    _imu("IMU constant 4 s", "constant_imu=START:4", seconds=4.0),
    _imu("IMU axes swapped", "imu_axes=START:REST:y -x z"),
    _imu("IMU signs reversed", "imu_axes=START:REST:-x -y -z"),
    _imu("gyroscope offset 0.05 rad/s", "gyroscope_offset=START:REST:0.05"),
    _imu("accelerometer offset 1 m/s^2", "accelerometer_offset=START:REST:1"),
    _imu("IMU silent 4 s", "silent_imu=START:4", seconds=4.0),
    _imu("IMU shocks 100 m/s^2, 4 s", "imu_shocks=START:4:100", seconds=4.0),
    _imu("camera IMU silent 4 s", "silent_imu=START:4", seconds=4.0, of_camera=True),
    _imu("camera IMU constant 4 s", "constant_imu=START:4", seconds=4.0, of_camera=True),
    _imu("camera IMU signs reversed", "imu_axes=START:REST:-x -y -z", of_camera=True),
    _imu("camera IMU shocks 100 m/s^2, 4 s", "imu_shocks=START:4:100", seconds=4.0, of_camera=True),
)
OF_LEGS = (
    _legs("joints silent 2 s", "silent_joints=START:2", seconds=2.0),
    _legs("leg frozen 3 s", "frozen_legs=LEG:START:3", seconds=3.0),
    _legs("leg without readings", "missing_legs=LEG:START:REST"),
    _legs("encoder frozen", "frozen_encoders=JOINT:START:REST"),
    _legs("encoder of wrong sign", "flipped_encoders=JOINT:START:REST"),
    _legs("encoder zero 5 deg off", "encoder_offsets=JOINT:START:REST:5"),
    _legs("encoder spikes of 20 deg", "encoder_spikes=JOINT:START:REST:20"),
    _legs("torques zero 4 s", "zero_torques=START:4", seconds=4.0),
    _legs("torques 5 Nm off", "torque_offsets=START:REST:5"),
    _legs("no load 3 s", "no_load=START:3", seconds=3.0),
    _legs("foot slides at 0.1 m/s", "sliding_legs=LEG:START:REST:0.1"),
)
OF_STREAMS = (
    _case("samples out of order by 30 ms", _ALL, "shuffled=0:1000:0.03"),
    _case("a fifth of the samples twice", _ALL, "repeated_samples=0:1000:0.2"),
    _legs("joint stamps an hour ahead, 1 in 20", "future_stamps=joints:START:REST:3600"),
    _images("image stamps an hour ahead, 1 in 20", "future_stamps=stereo:START:REST:3600"),
    _legs("joint clock steps back 0.3 s", "clock_steps=joints:START:REST:-0.3"),
    _images("camera clock steps ahead 0.3 s", "clock_steps=stereo:START:REST:0.3"),
    FaultCase("all clocks step ahead 1000 s", _ALL, ("faults.clock_steps=['all:START:REST:1000']",), None, 1000.0),
    FaultCase("all clocks step back 1000 s", _ALL, ("faults.clock_steps=['all:START:REST:-1000']",), None, -1000.0),
)
OF_TRUTH = (FaultCase("gaps of ground truth", ("truth",), ("faults.truth_gaps=['START:1', '4:0.6']",)),)
KINDS: Mapping[str, tuple[FaultCase, ...]] = {
    "cameras": OF_CAMERAS,
    "IMUs": OF_IMUS,
    "joints and feet": OF_LEGS,
    "streams": OF_STREAMS,
    "ground truth": OF_TRUTH,
}
"""The faults by kind."""
CASES: Mapping[str, FaultCase] = {
    case.name: case for case in (FaultCase(NOMINAL, ()), *(each for kind in KINDS.values() for each in kind))
}
"""All cases by name, the one without a fault first."""
