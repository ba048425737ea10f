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
from coclo_vio.diagnosis.checks.clocks import (
    find_apart,
    find_offset_of_camera_imu,
    find_offset_of_truth,
    find_offsets,
    find_units,
)
from coclo_vio.diagnosis.checks.imu_axes import find_body_axes, find_camera_imu_axes
from coclo_vio.diagnosis.checks.imu_readings import find_readings
from coclo_vio.diagnosis.checks.mountings import find_mountings
from coclo_vio.diagnosis.checks.robot_description import find_description
from coclo_vio.diagnosis.checks.two_sources import find_conflicts
from coclo_vio.diagnosis.diagnose import Check, Cost
from coclo_vio.diagnosis.finding import Stage

CHECKS: tuple[Check, ...] = (
    Check("description against its URDF", Stage.ROBOT, Cost.REPORT, find_description, "robot"),
    Check("unit of stamps", Stage.CLOCKS, Cost.REPORT, find_units),
    Check("streams at the same time", Stage.CLOCKS, Cost.REPORT, find_apart),
    Check("offsets by angular velocities", Stage.CLOCKS, Cost.IMAGES, find_offsets, "imu"),
    Check("offset of images to their IMU", Stage.CLOCKS, Cost.IMAGES, find_offset_of_camera_imu, "camera_imu stereo"),
    Check("units and gravity", Stage.IMU, Cost.SAMPLES, find_readings, "imu|camera_imu"),
    Check("body IMU against the legs", Stage.IMU, Cost.SAMPLES, find_body_axes, "imu joints robot"),
    Check("camera IMU against body IMU", Stage.IMU, Cost.SAMPLES, find_camera_imu_axes, "imu camera_imu"),
    Check("calibration of the cameras", Stage.CAMERAS, Cost.REPORT, find_calibration, "stereo|stereo_tracks"),
    Check("one number from two sources", Stage.CAMERAS, Cost.REPORT, find_conflicts, "stereo|imu"),
    Check("images as a pair", Stage.CAMERAS, Cost.SAMPLES, find_pairs, "stereo"),
    Check(
        "mountings by angular velocities", Stage.MOUNTING, Cost.IMAGES, find_mountings, "imu|camera_imu joints|stereo"
    ),
    Check("joint angles", Stage.JOINTS, Cost.SAMPLES, joint_positions.find, "joints robot"),
    Check("joint velocities", Stage.JOINTS, Cost.SAMPLES, joint_velocities.find, "joints robot"),
    Check("order and signs of joints", Stage.JOINTS, Cost.SAMPLES, joint_order.find, "joints robot"),
    Check("joint torques", Stage.JOINTS, Cost.SAMPLES, joint_torques.find, "joints robot"),
    Check("contacts", Stage.CONTACT, Cost.SAMPLES, contacts.find, "joints robot"),
    Check("order of foot loads", Stage.CONTACT, Cost.SAMPLES, contact_order.find, "joints robot"),
    Check("motion of the ground truth", Stage.GROUND_TRUTH, Cost.SAMPLES, truth_motion.find, "ground_truth"),
    Check("rotation of the ground truth", Stage.GROUND_TRUTH, Cost.SAMPLES, truth_rotation.find, "ground_truth"),
    Check("clock of the ground truth", Stage.GROUND_TRUTH, Cost.IMAGES, find_offset_of_truth, "ground_truth"),
)
