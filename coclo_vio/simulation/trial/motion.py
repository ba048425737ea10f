# SPDX-License-Identifier: BSD-3-Clause
"""The true motion of a walk: states and forces at 1 kHz, from which every sensor is drawn, and their file.

It does not depend on cameras, IMUs or encoders. So a walk is simulated once and read with other sensors again; a motion
from a file gives the same bytes as one that has just been simulated.
"""

import os
import zipfile
from dataclasses import dataclass, fields
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from coclo_vio.geometry import so3
from coclo_vio.values.arrays import Array, IntArray
from coclo_vio.values.errors import DatasetError
from coclo_vio.values.units import GRAVITY_MPS2


@dataclass(frozen=True, eq=False)
class Motion:
    """The true motion, sampled at the physics' step.

    Attributes:
        time_s: since the beginning, (N,).
        qpos: MuJoCo's coordinates: trunk position, quaternion wxyz, joints and foot springs, (N, nq).
        qvel: MuJoCo's velocities, (N, nv).
        trunk_acceleration: of the trunk's origin, world, m/s^2, and angular, body frame, rad/s^2, (N, 6).
        joint_columns: columns of ``qpos`` with the joints, in the description's order, (J,).
        joint_velocity_columns: those of ``qvel``, (J,).
        spring_torque: Nm, (N, J).
        foot_force: normal force on each foot, N, (N, legs).
        self_contacts: control periods at whose end a leg touched another leg.
        ground_contacts: control periods at whose end a leg, not a foot, touched the ground; the trunk touches nothing.
        max_penetration_m: largest penetration of two bodies in contact then, m.
        on_tile_s: first and last time of a foot on the slippery tile, s; None without.
    """

    time_s: Array
    qpos: Array
    qvel: Array
    trunk_acceleration: Array
    joint_columns: IntArray
    joint_velocity_columns: IntArray
    spring_torque: Array
    foot_force: Array
    self_contacts: int
    ground_contacts: int
    max_penetration_m: float
    on_tile_s: tuple[float, float] | None = None

    @property
    def joint_position(self) -> Array:
        """True angles, rad, (N, J)."""
        return self.qpos[:, self.joint_columns]

    @property
    def joint_velocity(self) -> Array:
        """True rates of the joints, rad/s, (N, J)."""
        return self.qvel[:, self.joint_velocity_columns]

    @property
    def velocity_world(self) -> Array:
        """Velocity of the trunk's origin, m/s, (N, 3)."""
        return self.qvel[:, :3]

    @cached_property
    def T_world_body(self) -> Array:
        """Poses of the trunk, (N, 4, 4)."""
        poses = np.tile(np.eye(4), (len(self.qpos), 1, 1))
        poses[:, :3, :3], poses[:, :3, 3] = so3.from_quat_wxyz(self.qpos[:, 3:7]), self.qpos[:, :3]
        return poses

    def inertial(self, T_body_imu: Array) -> Array:
        """Rate (rad/s) and specific force (m/s^2) of a point of the trunk in its own axes, without noise, (N, 6).

        With w and a the trunk's rate and angular acceleration, body frame, and r the point: its acceleration is that of
        the origin plus a x r + w x (w x r); specific force is acceleration less gravity.

        Args:
            T_body_imu: pose of the IMU on the trunk, (4, 4).
        """
        lever, R_body_imu = T_body_imu[:3, 3], T_body_imu[:3, :3]
        rate, turning = self.qvel[:, 3:6], self.trunk_acceleration[:, 3:]
        upward = self.trunk_acceleration[:, :3] + np.array([0.0, 0.0, GRAVITY_MPS2])
        force = np.einsum("nji,nj->ni", self.T_world_body[:, :3, :3], upward)
        force += np.cross(turning, lever) + np.cross(rate, np.cross(rate, lever))
        return np.hstack((rate @ R_body_imu, force @ R_body_imu))


def write_motion(motion: Motion, path: Path) -> None:
    """Write a motion to a file that appears at once and whole.

    Raises:
        DatasetError: it cannot be written.
    """
    half = path.with_name(f".{path.name}.{os.getpid()}.npz")
    values = {each.name: getattr(motion, each.name) for each in fields(motion)}
    values["on_tile_s"] = np.array(motion.on_tile_s or (), dtype=np.float64)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        np.savez(half, **values)
        half.replace(path)
    except OSError as error:
        raise DatasetError(f"cannot write the motion {path}: {error.strerror}; choose another folder") from error
    finally:
        half.unlink(missing_ok=True)


def read_motion(path: Path) -> Motion:
    """The motion of a file.

    Raises:
        DatasetError: there is none, or it is damaged.
    """
    try:
        with np.load(path) as stored:
            values: dict[str, Any] = {name: stored[name] for name in stored.files}
        values |= {name: int(values[name]) for name in ("self_contacts", "ground_contacts")}
        values["max_penetration_m"] = float(values["max_penetration_m"])
        on_tile_s = values["on_tile_s"].tolist()
        values["on_tile_s"] = tuple(on_tile_s) if on_tile_s else None
        return Motion(**values)
    except (OSError, KeyError, TypeError, ValueError, zipfile.BadZipFile) as error:
        raise DatasetError(f"cannot read the motion {path} ({error}); remove it, it is simulated again") from error
