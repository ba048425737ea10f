# SPDX-License-Identifier: BSD-3-Clause
"""Where the feet of a recording are and which of them stand, without any IMU."""

from dataclasses import dataclass

import numpy as np

from coclo_vio.diagnosis.records import ForceRecord, JointRecord
from coclo_vio.robot.contact import ContactDetector
from coclo_vio.robot.foot_load import FootLoad
from coclo_vio.robot.foot_motion_model import FootMotionModel
from coclo_vio.robot.model import RobotModel
from coclo_vio.values.arrays import Array, BoolArray, IntArray
from coclo_vio.values.measurements import FootForceSample, JointSample
from coclo_vio.values.units import NS_PER_S

_RATE_HZ = 100.0
_FORCE_TIMEOUT_S = 0.1
_UP_BODY = np.array([0.0, 0.0, 1.0])  # about: loads hardly depend on the tilt of a body


@dataclass(frozen=True, slots=True, eq=False)
class FeetRecord:
    """The feet at about 100 Hz.

    Attributes:
        stamps_ns: (N,).
        position_body: foot centres, m, body frame, (N, legs, 3); NaN where a joint is not known.
        is_stance: by contact as the robot's description has it, (N, legs).
        load: what decided on it, in the unit of the thresholds, (N, legs); NaN where it is not known.
    """

    stamps_ns: IntArray
    position_body: Array
    is_stance: BoolArray
    load: Array

    @property
    def up_body(self) -> Array | None:
        """The direction from the standing feet to the body, mean over time, body frame, (3,): about up."""
        stands = self.is_stance & np.isfinite(self.position_body[:, :, 0])
        rows = stands.sum(axis=1) >= min(3, self.position_body.shape[1])
        if np.count_nonzero(rows) < 10:
            return None
        weights = stands[rows, :, None]
        middle = (np.nan_to_num(self.position_body[rows]) * weights).sum(axis=1) / weights.sum(axis=1)
        mean = -np.asarray(middle.mean(axis=0))
        return np.asarray(mean / np.linalg.norm(mean))


def feet_of(robot: RobotModel, record: JointRecord, forces: ForceRecord | None) -> FeetRecord:
    """The feet of a recording, contact as the robot's description has it.

    Args:
        robot: the legs.
        record: the joints.
        forces: the foot sensors, None where there are none.
    """
    spacing_ns = NS_PER_S / _RATE_HZ
    cell = np.floor((record.stamps_ns - record.stamps_ns[0]) / spacing_ns)
    kept = np.flatnonzero(np.append(True, np.diff(cell) > 0))
    config = robot.description.contact
    load_of, detector = FootLoad(robot, config, _FORCE_TIMEOUT_S), ContactDetector(config, len(robot.leg_names))
    motion_of = FootMotionModel(robot)
    next_force = 0
    positions, stances, loads = [], [], []
    for index in kept:
        stamp_ns = int(record.stamps_ns[index])
        while forces is not None and next_force < len(forces.stamps_ns) and forces.stamps_ns[next_force] <= stamp_ns:
            load_of.push(FootForceSample(int(forces.stamps_ns[next_force]), forces.force[next_force]))
            next_force += 1
        sample = JointSample(stamp_ns, record.position[index], record.velocity[index], record.effort[index])
        feet = robot.feet(sample.position, sample.velocity)
        load = load_of.loads_at(sample, _UP_BODY, None, feet.jacobian)
        positions.append(feet.position_body)
        motion = motion_of.at(stamp_ns, feet, None, None, _UP_BODY, is_stationary=False)
        stances.append(detector.update(stamp_ns, load, motion).is_stance)
        loads.append(load)
    return FeetRecord(record.stamps_ns[kept], np.array(positions), np.array(stances), np.array(loads))
