# SPDX-License-Identifier: BSD-3-Clause
"""Unitree's ``rt/lowstate``: the definitions of its messages, and which field is which reading.

Source: the IDL of unitree_sdk2 (``unitree_go::msg::dds_::LowState_`` of Go2, B2 and H1; ``unitree_hg`` of G1).
"""

from typing import Any

from coclo_vio.robot.description import RobotDescription

LOW_STATE = "unitree_go/msg/LowState"
HUMANOID_LOW_STATE = "unitree_hg/msg/LowState"
TOPIC = "/lowstate"
_RULE = "=" * 80 + "\n"
_FEET = ("FR", "FL", "RR", "RL")

DEFINITIONS = {
    LOW_STATE: f"""\
uint8[2] head
uint8 level_flag
uint8 frame_reserve
uint32[2] sn
uint32[2] version
uint16 bandwidth
unitree_go/IMUState imu_state
unitree_go/MotorState[20] motor_state
unitree_go/BmsState bms_state
int16[4] foot_force
int16[4] foot_force_est
uint32 tick
uint8[40] wireless_remote
uint8 bit_flag
float32 adc_reel
uint8 temperature_ntc1
uint8 temperature_ntc2
float32 power_v
float32 power_a
uint16[4] fan_frequency
uint32 reserve
uint32 crc
{_RULE}MSG: unitree_go/IMUState
float32[4] quaternion
float32[3] gyroscope
float32[3] accelerometer
float32[3] rpy
uint8 temperature
{_RULE}MSG: unitree_go/MotorState
uint8 mode
float32 q
float32 dq
float32 ddq
float32 tau_est
float32 q_raw
float32 dq_raw
float32 ddq_raw
uint8 temperature
uint32 lost
uint32[2] reserve
{_RULE}MSG: unitree_go/BmsState
uint8 version_high
uint8 version_low
uint8 status
uint8 soc
int32 current
uint16 cycle
uint8[2] bq_ntc
uint8[2] mcu_ntc
uint16[15] cell_vol
""",
    HUMANOID_LOW_STATE: f"""\
uint32[2] version
uint8 mode_pr
uint8 mode_machine
uint32 tick
unitree_hg/IMUState imu_state
unitree_hg/MotorState[35] motor_state
uint8[40] wireless_remote
uint32[4] reserve
uint32 crc
{_RULE}MSG: unitree_hg/IMUState
float32[4] quaternion
float32[3] gyroscope
float32[3] accelerometer
float32[3] rpy
int16 temperature
{_RULE}MSG: unitree_hg/MotorState
uint8 mode
float32 q
float32 dq
float32 ddq
float32 tau_est
int16[2] temperature
float32 vol
uint32[2] sensor
uint32 motorstate
uint32[4] reserve
""",
}
"""The definition of each type by its name, those of nested types below it."""


def fields_of(robot: RobotDescription) -> dict[str, Any]:
    """``dataset.rosbag.fields`` for the messages on ``/lowstate``: IMU, motors in the robot's order, feet by name.

    The motors are numbered in the order of the robot's description, which for Unitree's own robots is theirs. Feet are
    read where the robot's legs are the four of Unitree's quadrupeds.
    """
    count = len(robot.joint_names)
    motors = f"motor_state[0:{count}]"
    fields: dict[str, Any] = {
        "imu": {"topic": TOPIC, "gyroscope": "imu_state.gyroscope", "accelerometer": "imu_state.accelerometer"},
        "joints": {
            "topic": TOPIC,
            "position": f"{motors}.q",
            "velocity": f"{motors}.dq",
            "effort": f"{motors}.tau_est",
            "names": list(robot.joint_names),
        },
    }
    if set(robot.leg_names) == set(_FEET):
        fields["foot_force"] = {"topic": TOPIC, "force": "foot_force[0:4]", "legs": list(_FEET)}
    return fields
