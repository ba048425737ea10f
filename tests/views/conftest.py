# SPDX-License-Identifier: BSD-3-Clause
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from view_rows import view_rows

from coclo_vio.geometry import se3, so3
from coclo_vio.robot.description import load_robot
from coclo_vio.values.estimates import FootState, NavState, StateEstimate
from coclo_vio.values.measurements import JointSample
from coclo_vio.values.outputs import Estimate
from coclo_vio.values.units import NS_PER_S

START_NS = 1_700_000_000 * NS_PER_S + 7


@pytest.fixture(scope="session")
def rows() -> Callable[[Path], dict[str, list[tuple[int, dict[str, object]]]]]:
    """Reads a file of either view back: by topic or entity, the stamp (ns) and the components of each row in order."""
    return view_rows


@pytest.fixture
def walk() -> tuple[list[JointSample], list[Estimate]]:
    """A second of a Daisy: joints at 100 Hz, and the estimate at each; it turns, and two feet are in swing."""
    joints, estimates = [], []
    description = load_robot("daisy")
    legs, angle = len(description.leg_names), np.linspace(0.0, 0.3, len(description.joint_names))
    contact = np.array([1.0, 0.0, 0.5] + [1.0] * (legs - 3))
    for index in range(100):
        stamp_ns = START_NS + index * 10_000_000
        effort = np.full(len(angle), 3.0)
        joints.append(JointSample(stamp_ns, angle * np.cos(0.03 * index), np.zeros_like(angle), effort))
        T = se3.transform(so3.about_z(0.01 * index), np.array([0.004 * index, 0.0, 0.3]))
        nav = NavState(T, np.array([0.4, 0.1, 0.0]), np.zeros(3), np.zeros(3), np.zeros(3))
        covariance = np.diag([1e-4] * 3 + [0.01**2, 0.02**2, 0.03**2] + [1e-4] * 3)
        feet = FootState(np.zeros((legs, 3)), contact, contact > 0.5)
        estimates.append(Estimate("coclo", StateEstimate(stamp_ns, nav, covariance, feet)))
    return joints, estimates
