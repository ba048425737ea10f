# SPDX-License-Identifier: BSD-3-Clause
"""Our Daisy against the maker's own kinematics and masses, read offline by hebi-py."""

import numpy as np
import pinocchio as pin
import pytest

from coclo_vio.geometry import se3, so3
from coclo_vio.robot.description import load_robot, urdf_path
from coclo_vio.robot.model import RobotModel
from coclo_vio.values.arrays import Array

hebi = pytest.importorskip("hebi", reason="hebi-py (development only) is the oracle", exc_type=ImportError)

MOUNTS_DEG_M = [(30, 0.2375), (-30, 0.2375), (90, 0.1875), (-90, 0.1875), (150, 0.2375), (-150, 0.2375)]


@pytest.fixture(scope="module")
def maker_legs(shared_data) -> list[tuple[Array, object]]:
    """``T_body_base`` and the maker's model of each leg, from leg 1 to leg 6."""
    folder = shared_data / "daisy" / "hrdf"
    models = [hebi.robot_model.import_from_hrdf(str(folder / f"daisyLeg-{side}.hrdf")) for side in ("Left", "Right")]
    legs = []
    for number, (degrees, radius) in enumerate(MOUNTS_DEG_M):
        rotation = so3.about_z(np.radians(degrees))
        legs.append((se3.transform(rotation, rotation @ np.array([radius, 0.0, 0.0])), models[number % 2]))
    return legs


def test_feet_are_those_of_the_maker_s_kinematics(maker_legs) -> None:
    model = RobotModel(load_robot("daisy"))
    rng = np.random.default_rng(11)
    for _ in range(50):
        joints = rng.uniform(-np.pi, np.pi, 18)
        expected = [
            (T_body_base @ leg.get_end_effector(joints[3 * number : 3 * number + 3]))[:3, 3]
            for number, (T_body_base, leg) in enumerate(maker_legs)
        ]
        np.testing.assert_allclose(model.feet(joints, np.zeros(18)).position_body, expected, atol=1e-6)


def test_mass_and_its_centre_are_the_makers(maker_legs) -> None:
    urdf = pin.buildModelFromUrdf(str(urdf_path(load_robot("daisy"))), pin.JointModelFreeFlyer())
    order = [urdf.joints[urdf.getJointId(name)].idx_q for name in load_robot("daisy").joint_names]
    rng = np.random.default_rng(12)
    for _ in range(10):
        joints = rng.uniform(-np.pi, np.pi, 18)
        masses, points = [5.0], [np.array([0.05, 0.0, 0.075])]
        for number, (T_body_base, leg) in enumerate(maker_legs):
            frames = leg.get_forward_kinematics("com", joints[3 * number : 3 * number + 3])
            masses.extend(leg.masses)
            points.extend((T_body_base @ frame)[:3, 3] for frame in frames)
        configuration = pin.neutral(urdf)
        configuration[order] = joints
        centre = pin.centerOfMass(urdf, urdf.createData(), configuration)
        np.testing.assert_allclose(centre, np.average(points, axis=0, weights=masses), atol=1e-4)
        assert pin.computeTotalMass(urdf) == pytest.approx(sum(masses), abs=1e-3)
