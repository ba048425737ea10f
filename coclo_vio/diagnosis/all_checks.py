# SPDX-License-Identifier: BSD-3-Clause
"""The checks there are: a further one is one function in ``checks`` and one row here."""

from coclo_vio.diagnosis.checks import (
    contact_order,
    contacts,
    joint_order,
    joint_positions,
    joint_torques,
    joint_velocities,
    truth_motion,
    truth_rotation,
)
from coclo_vio.diagnosis.checks.camera_pairs import find_calibration, find_pairs
from coclo_vio.diagnosis.checks.clocks import find_apart, find_offset_of_camera_imu, find_offsets, find_units
from coclo_vio.diagnosis.checks.imu_axes import find_body_axes, find_camera_imu_axes
from coclo_vio.diagnosis.checks.imu_readings import find_readings
from coclo_vio.diagnosis.checks.mountings import find_mountings
from coclo_vio.diagnosis.checks.robot_description import find_description
from coclo_vio.diagnosis.checks.two_sources import find_conflicts
from coclo_vio.diagnosis.diagnose import Check, Cost
from coclo_vio.diagnosis.finding import Stage

CHECKS: tuple[Check, ...] = (
    Check("description against its URDF", Stage.ROBOT, Cost.REPORT, find_description),
    Check("unit of stamps", Stage.CLOCKS, Cost.REPORT, find_units),
    Check("streams at the same time", Stage.CLOCKS, Cost.REPORT, find_apart),
    Check("offsets by angular velocities", Stage.CLOCKS, Cost.IMAGES, find_offsets),
    Check("offset of images to their IMU", Stage.CLOCKS, Cost.IMAGES, find_offset_of_camera_imu),
    Check("units and gravity", Stage.IMU, Cost.SAMPLES, find_readings),
    Check("body IMU against the legs", Stage.IMU, Cost.SAMPLES, find_body_axes),
    Check("camera IMU against body IMU", Stage.IMU, Cost.SAMPLES, find_camera_imu_axes),
    Check("calibration of the cameras", Stage.CAMERAS, Cost.REPORT, find_calibration),
    Check("one number from two sources", Stage.CAMERAS, Cost.REPORT, find_conflicts),
    Check("images as a pair", Stage.CAMERAS, Cost.SAMPLES, find_pairs),
    Check("mountings by angular velocities", Stage.MOUNTING, Cost.IMAGES, find_mountings),
    Check("joint angles", Stage.JOINTS, Cost.SAMPLES, joint_positions.find),
    Check("joint velocities", Stage.JOINTS, Cost.SAMPLES, joint_velocities.find),
    Check("order and signs of joints", Stage.JOINTS, Cost.SAMPLES, joint_order.find),
    Check("joint torques", Stage.JOINTS, Cost.SAMPLES, joint_torques.find),
    Check("contacts", Stage.CONTACT, Cost.SAMPLES, contacts.find),
    Check("order of foot loads", Stage.CONTACT, Cost.SAMPLES, contact_order.find),
    Check("motion of the ground truth", Stage.GROUND_TRUTH, Cost.SAMPLES, truth_motion.find),
    Check("rotation of the ground truth", Stage.GROUND_TRUTH, Cost.SAMPLES, truth_rotation.find),
)
