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
from coclo_vio.diagnosis.diagnose import Check, Cost
from coclo_vio.diagnosis.finding import Stage

CHECKS: tuple[Check, ...] = (
    Check("joint angles", Stage.JOINTS, Cost.SAMPLES, joint_positions.find),
    Check("joint velocities", Stage.JOINTS, Cost.SAMPLES, joint_velocities.find),
    Check("order and signs of joints", Stage.JOINTS, Cost.SAMPLES, joint_order.find),
    Check("joint torques", Stage.JOINTS, Cost.SAMPLES, joint_torques.find),
    Check("contacts", Stage.CONTACT, Cost.SAMPLES, contacts.find),
    Check("order of foot loads", Stage.CONTACT, Cost.SAMPLES, contact_order.find),
    Check("motion of the ground truth", Stage.GROUND_TRUTH, Cost.SAMPLES, truth_motion.find),
    Check("rotation of the ground truth", Stage.GROUND_TRUTH, Cost.SAMPLES, truth_rotation.find),
)
