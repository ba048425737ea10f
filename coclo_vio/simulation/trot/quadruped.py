# SPDX-License-Identifier: BSD-3-Clause
"""The simulated quadrupeds: what their URDF does not hold, and where their cameras are.

Torque limits are the URDF's. Rotor inertia seen at the joint, damping and dry friction are of the order that MuJoCo
Menagerie gives for these robots; the places of the cameras are chosen.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal, get_args

from coclo_vio.values.calibration import Triple

QuadrupedName = Literal["go1", "go2", "a1", "anymal_b"]
QUADRUPEDS: tuple[QuadrupedName, ...] = get_args(QuadrupedName)


@dataclass(frozen=True, slots=True)
class Quadruped:
    """One kind of quadruped.

    Attributes:
        height_m: of the trunk's origin over the ground when it trots.
        are_knees_opposed: front knees bend backwards and rear knees forwards; otherwise all bend backwards.
        armature_kgm2: rotor inertia of hip, thigh and knee, seen at the joint.
        damping: viscous, Nm/(rad/s).
        dry_friction_nm: of a joint, not measured by its motor.
        camera_position_m: left camera, body frame.
        has_foot_sensors: whether its recordings hold raw counts of foot sensors.
    """

    height_m: float
    are_knees_opposed: bool
    armature_kgm2: Triple
    damping: float
    dry_friction_nm: float
    camera_position_m: Triple
    has_foot_sensors: bool


_UNITREE: Triple = (0.01, 0.01, 0.02)

QUADRUPED_PARTS: Mapping[QuadrupedName, Quadruped] = {
    "go1": Quadruped(0.29, False, _UNITREE, 0.1, 0.2, (0.28, 0.025, 0.05), True),
    "go2": Quadruped(0.30, False, _UNITREE, 0.1, 0.2, (0.32, 0.025, 0.06), False),
    "a1": Quadruped(0.28, False, _UNITREE, 0.1, 0.2, (0.27, 0.025, 0.06), False),
    "anymal_b": Quadruped(0.46, True, (0.1, 0.1, 0.1), 0.5, 0.5, (0.42, 0.025, 0.10), False),
}
"""All simulated quadrupeds by the name of their description."""
