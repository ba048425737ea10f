# SPDX-License-Identifier: BSD-3-Clause
"""A bag as drivers of foot sensors write it: joints without names, foot forces behind them in another order."""

from pathlib import Path

import numpy as np
import pytest
from rosbags.rosbag1 import Writer
from rosbags.typesys import Stores, get_typestore

import coclo_vio as cv
from coclo_vio.adoption.adopt import adopt
from coclo_vio.values.measurements import FootForceSample, ImuSample, JointSample, Measurement

JOINT_ORDER, FORCE_ORDER = ("FL", "FR", "RL", "RR"), ("FR", "FL", "RR", "RL")
LEGS = ("FR", "FL", "RR", "RL")  # of the packaged go1
STORE = get_typestore(Stores.ROS1_NOETIC)
PLACEHOLDERS = 4  # angles of the feet, always zero


def write_bag(path: Path, measurements: tuple[Measurement, ...], names: list[str]) -> Path:
    """IMU and joints in the order of ``JOINT_ORDER``, then placeholders; efforts are zero but for four foot forces."""
    joint_columns = [3 * LEGS.index(leg) + place for leg in JOINT_ORDER for place in range(3)]
    force_columns = [LEGS.index(leg) for leg in FORCE_ORDER]
    header, time = STORE.types["std_msgs/msg/Header"], STORE.types["builtin_interfaces/msg/Time"]
    vector, quaternion = (STORE.types[f"geometry_msgs/msg/{kind}"] for kind in ("Vector3", "Quaternion"))
    force = np.zeros(4)
    with Writer(path) as bag:
        topics = {kind: bag.add_connection(f"/{kind}", f"sensor_msgs/msg/{kind}", typestore=STORE)
                  for kind in ("Imu", "JointState")}  # fmt: skip
        for number, sample in enumerate(measurements):
            stamp_ns = sample.stamp_ns + 1_700_000_000_000_000_000
            at = header(number, time(*divmod(stamp_ns, 1_000_000_000)), "")
            match sample:
                case FootForceSample():
                    force = sample.force[force_columns]
                case ImuSample():
                    unknown = np.zeros(9)
                    kind, message = "Imu", STORE.types["sensor_msgs/msg/Imu"](
                        at, quaternion(0.0, 0.0, 0.0, 1.0), unknown, vector(*sample.angular_velocity), unknown,
                        vector(*sample.specific_force), unknown,
                    )  # fmt: skip
                    bag.write(topics[kind], stamp_ns, STORE.serialize_ros1(message, f"sensor_msgs/msg/{kind}"))
                case JointSample():
                    padding = np.zeros(PLACEHOLDERS)
                    position, velocity = (
                        np.concatenate((values[joint_columns], padding))
                        for values in (sample.position, sample.velocity)
                    )
                    effort = np.concatenate((np.zeros(8), force))
                    kind, message = "JointState", STORE.types["sensor_msgs/msg/JointState"](
                        at, names, position, velocity, effort
                    )  # fmt: skip
                    bag.write(topics[kind], stamp_ns, STORE.serialize_ros1(message, f"sensor_msgs/msg/{kind}"))
    return path


@pytest.mark.parametrize(
    "names", [[], [f"{leg}_{place}" for leg in JOINT_ORDER for place in range(3) if (leg, place) != ("FR", 1)]]
)
def test_entries_and_foot_forces_are_found_and_read_with_the_settings(names, walk, tmp_path) -> None:
    robot, measurements = walk("go1")
    path = write_bag(tmp_path / "walk.bag", measurements, names)
    adoption = adopt(Path(robot.urdf), path)
    joints, feet = adoption.settings
    found = adoption.description
    if names:  # they state the order of the legs
        assert found.leg_names == JOINT_ORDER
        wanted = {leg: 8 + place for place, leg in enumerate(FORCE_ORDER)}
        listed = ", ".join(f'{leg}: "effort[{wanted[leg]}]"' for leg in JOINT_ORDER)
        assert feet == f"dataset.rosbag.foot_force_entries={{{listed}}}"
        np.testing.assert_allclose(found.imu.T_body_imu, robot.imu.T_body_imu, atol=1e-6)
    else:
        assert {"joints"} <= {field.key for field in adoption.questions}
    assert joints.startswith("dataset.rosbag.joint_entries=[")
    assert joints.count("_joint") == 12
    recording = cv.open(path, robot=found, settings=adoption.settings)
    read = [sample for sample in recording.measurements() if isinstance(sample, JointSample)]
    written = [sample for sample in measurements if isinstance(sample, JointSample)]
    assert len(read) == len(written)
    columns = [3 * LEGS.index(leg) + place for leg in found.leg_names for place in range(3)]
    if names:
        np.testing.assert_array_equal(read[7].position, written[7].position[columns])
    forces = [sample for sample in recording.measurements() if isinstance(sample, FootForceSample)]
    assert len(forces) == len(read)
