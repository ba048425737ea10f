# SPDX-License-Identifier: BSD-3-Clause
"""How messages of types that are not read can be: the setting for known ones, an example for others."""

from collections.abc import Mapping

from coclo_vio.values.errors import listing

_GO = (
    "imu: {{topic: {0}, gyroscope: imu_state.gyroscope, accelerometer: imu_state.accelerometer}}, "
    'joints: {{topic: {0}, position: "motor_state[0:12].q", velocity: "motor_state[0:12].dq", '
    'effort: "motor_state[0:12].tau_est"}}, '
    'foot_force: {{topic: {0}, force: "foot_force[0:4]", legs: [FR, FL, RR, RL]}}'
)
_LEGGED = (
    "imu: {{topic: {0}, gyroscope: imu.gyroscope, accelerometer: imu.accelerometer}}, "
    'joints: {{topic: {0}, position: "motorState[0:12].q", velocity: "motorState[0:12].dq", '
    'effort: "motorState[0:12].tauEst"}}, foot_force: {{topic: {0}, force: "footForce[0:4]", legs: [FR, FL, RR, RL]}}'
)
_KNOWN: Mapping[str, str] = {
    "unitree_go/msg/LowState": _GO,
    "unitree_legged_msgs/msg/LowState": _LEGGED,
    "ros2_unitree_legged_msgs/msg/LowState": _LEGGED,
}
_STANDARD = (
    "builtin_interfaces/", "diagnostic_msgs/", "geometry_msgs/", "nav_msgs/", "rcl_interfaces/", "rosgraph_msgs/",
    "sensor_msgs/", "std_msgs/", "tf/", "tf2_msgs/", "visualization_msgs/", "bond/", "dynamic_reconfigure/",
)  # fmt: skip
_MOST = 8


def hints(types: Mapping[str, str]) -> list[str]:
    """Sentences on topics whose types are not read, and how their fields can be; ``types`` by topic."""
    known = [(topic, _KNOWN[msgtype]) for topic, msgtype in types.items() if msgtype in _KNOWN]
    if known:
        return [
            f"{topic} is of the type {types[topic]}, whose fields are read with dataset.rosbag.fields="
            f"'{{{setting.format(topic)}}}'"
            for topic, setting in known
        ]
    others = [f"{topic} ({kind})" for topic, kind in types.items() if not kind.startswith(_STANDARD)]
    if not others:
        return []
    return [
        f"topics of other types are {listing(others, _MOST)}; their fields can be named in dataset.rosbag.fields, such "
        "as imu: {topic: /state, gyroscope: imu.rates, accelerometer: imu.forces}, joints: {topic: /state, position: "
        "'motors[0:12].q'}"
    ]
