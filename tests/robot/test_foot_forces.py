# SPDX-License-Identifier: BSD-3-Clause
"""Foot forces against whole-body dynamics, and against the force plate under a real leg."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from scipy.signal import savgol_filter

from coclo_vio.geometry import so3
from coclo_vio.robot.contact import ContactConfig, ContactDetector
from coclo_vio.robot.description import LegDescription, RobotDescription, load_robot, urdf_path
from coclo_vio.robot.model import RobotModel
from coclo_vio.values.arrays import Array, BoolArray

UP = np.array([0.0, 0.0, 9.81])
DAISY = RobotModel(load_robot("daisy"))
STANDING = np.tile([0.1, -0.35, -1.25], 6) * np.tile([1, 1, 1, -1, 1, 1], 3)


@dataclass(frozen=True)
class WholeBody:
    """The same URDF on a free base, through Pinocchio's plain inverse dynamics."""

    robot: RobotDescription

    def efforts(
        self, position, forces_body, *, velocity=0.0, acceleration=0.0, base_rate=0.0, base_acceleration=0.0
    ) -> Array:
        """[base wrench (6), motor torques (J)] of a body at the origin, level, under foot forces in body axes."""
        model = pin.buildModelFromUrdf(str(urdf_path(self.robot)), pin.JointModelFreeFlyer())
        data = model.createData()
        index = np.array([model.joints[model.getJointId(name)].idx_v for name in self.robot.joint_names])
        q, v, a = pin.neutral(model), np.zeros(model.nv), np.zeros(model.nv)
        q[index + 1], v[index], a[index] = position, velocity, acceleration
        v[3:6], a[:3] = base_rate, base_acceleration
        pin.framesForwardKinematics(model, data, q)
        external = pin.StdVec_Force(model.njoints, pin.Force.Zero())
        for leg, force in zip(self.robot.legs, forces_body, strict=True):
            frame = model.frames[model.getFrameId(leg.foot_frame)]
            centre = data.oMf[model.getFrameId(leg.foot_frame)].translation
            wrench = pin.Force(force, np.cross(centre, force))
            external[frame.parentJoint] = data.oMi[frame.parentJoint].actInv(wrench)
        torques = pin.rnea(model, data, q, v, a, external)
        return np.concatenate((torques[:6], torques[index]))


def balanced_forces(model: RobotModel, position: Array) -> Array:
    """Smallest foot forces (n, 3) under which the robot stands level without falling or tipping."""
    whole = WholeBody(model.description)
    count = len(model.leg_names)
    weight = whole.efforts(position, np.zeros((count, 3)))[:6]
    units = np.eye(3 * count).reshape(-1, count, 3)
    effects = np.array([whole.efforts(position, unit)[:6] - weight for unit in units]).T
    return np.linalg.lstsq(effects, -weight, rcond=None)[0].reshape(count, 3)


@pytest.mark.parametrize("name", ["daisy", "go1"])
def test_a_standing_robot_is_carried_by_its_own_weight(name, preset) -> None:
    model = preset(name)
    position = STANDING if name == "daisy" else np.tile([0.05, 0.9, -1.8], 4)
    zero = np.zeros_like(position)
    forces = balanced_forces(model, position)
    efforts = WholeBody(model.description).efforts(position, forces)
    np.testing.assert_allclose(efforts[:6], 0.0, atol=1e-9)
    measured = model.foot_forces(position, zero, efforts[6:], specific_force_body=UP)
    np.testing.assert_allclose(measured, forces, atol=1e-8)
    np.testing.assert_allclose(measured.sum(axis=0), [0.0, 0.0, 9.81 * model.mass_kg], atol=1e-8)
    assert (measured[:, 2] > 10.0).all()


@pytest.mark.parametrize("name", ["daisy", "go1"])
def test_the_weight_of_a_standing_robot_acts_at_its_centre_of_mass(name, preset) -> None:
    """The feet's forces have no moment about it."""
    model = preset(name)
    position = STANDING if name == "daisy" else np.tile([0.05, 0.9, -1.8], 4)
    position = position + np.random.default_rng(25).normal(0.0, 0.1, len(position))
    arms = model.feet(position, np.zeros_like(position)).position_body - model.centre_of_mass_body(position)
    moment = np.cross(arms, balanced_forces(model, position)).sum(axis=0)
    np.testing.assert_allclose(moment, 0.0, atol=1e-8)


def test_the_centre_of_mass_is_in_the_body_frame(preset) -> None:
    model = preset("go1")
    moved = RobotModel(model.description.model_copy(update={"body_frame": "imu_link"}))
    position = np.tile([0.05, 0.9, -1.8], 4)
    arm = model.centre_of_mass_body(position) - moved.centre_of_mass_body(position)
    np.testing.assert_allclose(arm, model.description.imu.position_body_m, atol=1e-12)
    assert np.abs(arm).max() > 0.005


def test_holding_torques_are_those_that_show_the_forces() -> None:
    """``foot_forces`` returns the forces whose holding torques it is given, on a tilted body too."""
    rng = np.random.default_rng(24)
    position = STANDING + rng.normal(0.0, 0.1, 18)
    forces, up = rng.normal(0.0, 30.0, (6, 3)), so3.exp(np.array([0.2, -0.3, 0.0])).T @ UP
    torques = DAISY.holding_torques(position, forces, up)
    shown = DAISY.foot_forces(position, np.zeros(18), torques, specific_force_body=up)
    np.testing.assert_allclose(shown, forces, atol=1e-8)
    level = DAISY.holding_torques(position, forces, UP)
    np.testing.assert_allclose(level, WholeBody(DAISY.description).efforts(position, forces)[6:], atol=1e-8)


def test_without_compensation_it_is_the_papers_equation_7() -> None:
    rng = np.random.default_rng(21)
    effort = rng.normal(0.0, 5.0, 18)
    measured = DAISY.foot_forces(STANDING, np.zeros(18), effort)
    jacobian = DAISY.feet(STANDING, np.zeros(18)).jacobian
    for leg, own in enumerate(DAISY.leg_joint_slices):
        by_inverse = -np.linalg.inv(jacobian[leg, 3:, own]).T @ effort[own]
        np.testing.assert_allclose(measured[leg], by_inverse, atol=1e-9)


@pytest.mark.parametrize("body_frame", ["trunk", "imu_link"])
def test_moving_legs_on_a_moving_body(body_frame, preset) -> None:
    """Inertia, Coriolis and the body's own motion are taken out, also when the body frame is not the root link."""
    model = preset("go1")
    rng = np.random.default_rng(22)
    position = np.tile([0.05, 0.9, -1.8], 4) + rng.normal(0.0, 0.2, 12)
    velocity, acceleration = rng.normal(0.0, 5.0, 12), rng.normal(0.0, 50.0, 12)
    rate, base_acceleration, forces = rng.normal(0.0, 2.0, 3), rng.normal(0.0, 5.0, 3), rng.normal(0.0, 30.0, (4, 3))
    efforts = WholeBody(model.description).efforts(
        position,
        forces,
        velocity=velocity,
        acceleration=acceleration,
        base_rate=rate,
        base_acceleration=base_acceleration,
    )
    specific_force = base_acceleration + UP
    if body_frame == "imu_link":  # away from the root link, with the same axes: its own specific force is another
        model = RobotModel(model.description.model_copy(update={"body_frame": "imu_link"}))
        arm = np.array(model.description.imu.position_body_m)
        specific_force = specific_force + np.cross(rate, np.cross(rate, arm))
    motion = {"specific_force_body": specific_force, "angular_velocity_body": rate, "acceleration": acceleration}
    np.testing.assert_allclose(model.foot_forces(position, velocity, efforts[6:], **motion), forces, atol=1e-8)
    motion["acceleration"] = None
    without = model.foot_forces(position, velocity, efforts[6:], **motion)
    assert np.abs(without - forces).max() > 1.0


def test_a_planar_leg_shows_the_force_in_its_plane(two_links) -> None:
    model = RobotModel(two_links())
    position = np.array([0.4, 0.9])
    jacobian = model.feet(position, np.zeros(2)).jacobian[0, 3:]
    effort = -jacobian.T @ np.array([3.0, 100.0, 20.0])
    np.testing.assert_allclose(model.foot_forces(position, np.zeros(2), effort)[0], [3.0, 0.0, 20.0], atol=1e-9)


@pytest.mark.parametrize("hip_radps", [-2.0, 2.0])
def test_joint_friction_of_the_urdf_is_taken_out(hip_radps, two_links) -> None:
    """A motor at the hip that only overcomes its own damping, 0.2 Nm s/rad, and dry friction, 0.5 Nm, lifts nothing."""
    model = RobotModel(two_links())
    position, velocity = np.array([0.4, 0.9]), np.array([hip_radps, 0.0])
    effort = np.array([0.2 * hip_radps + 0.5 * np.sign(hip_radps), 0.0])
    still = model.foot_forces(position, velocity, np.zeros(2), acceleration=np.zeros(2))
    lossless = without_friction_of(model)
    np.testing.assert_allclose(
        model.foot_forces(position, velocity, effort, acceleration=np.zeros(2)),
        lossless.foot_forces(position, velocity, np.zeros(2), acceleration=np.zeros(2)),
        atol=1e-9,
    )
    assert np.abs(still - lossless.foot_forces(position, velocity, np.zeros(2), acceleration=np.zeros(2))).max() > 1.0


def without_friction_of(model: RobotModel) -> RobotModel:
    """The same robot without joint friction."""
    urdf = Path(model.description.urdf)
    lossless = urdf.with_name("lossless.urdf")
    lossless.write_text(urdf.read_text().replace('<dynamics damping="0.2" friction="0.5"/>', ""), encoding="utf-8")
    return RobotModel(model.description.model_copy(update={"urdf": str(lossless)}))


def test_a_stretched_leg_gives_a_bounded_force(two_links) -> None:
    """The torques do not feel what presses along a straight leg: that force fades out instead of growing."""
    model = RobotModel(two_links())
    effort = np.array([1.0, 1.0])
    sizes = [np.linalg.norm(model.foot_forces(np.array([0.2, knee]), np.zeros(2), effort)) for knee in (0.05, 1e-3, 0)]
    assert np.isfinite(sizes).all()
    assert max(sizes) < 1.5 / 0.02
    bent = model.feet(np.array([0.2, 0.3]), np.zeros(2)).jacobian[0, 3:]
    assert np.linalg.svd(bent)[1][1] > 0.02
    force = model.foot_forces(np.array([0.2, 0.3]), np.zeros(2), -bent.T @ np.array([1.0, 0.0, 50.0]))
    np.testing.assert_allclose(force[0], [1.0, 0.0, 50.0], atol=1e-9)


@pytest.mark.parametrize("reading", ["position", "velocity", "effort", "acceleration"])
def test_a_missing_reading_blanks_its_own_leg_only(reading) -> None:
    rng = np.random.default_rng(23)
    readings = {"position": STANDING.copy(), **{name: rng.normal(size=18) for name in ("velocity", "effort")}}
    readings["acceleration"] = rng.normal(size=18)
    whole = DAISY.foot_forces(**readings, specific_force_body=UP)
    readings[reading][10] = np.nan
    forces = DAISY.foot_forces(**readings, specific_force_body=UP)
    assert np.isnan(forces[3]).all()
    np.testing.assert_allclose(np.delete(forces, 3, axis=0), np.delete(whole, 3, axis=0), atol=1e-12)


def test_gravity_alone_does_not_need_the_joint_velocity() -> None:
    velocity = np.full(18, np.nan)
    assert np.isfinite(DAISY.foot_forces(STANDING, velocity, np.ones(18), specific_force_body=UP)).all()


def test_hanging_legs_of_a_tilted_robot_press_on_nothing() -> None:
    """With the body rolled by 0.3 rad, "up" is tilted in the body frame, and so is the weight of the legs."""
    tilt = so3.exp(np.array([0.3, 0.0, 0.0]))
    hanging = WholeBody(DAISY.description).efforts(STANDING, np.zeros((6, 3)), base_acceleration=tilt.T @ UP - UP)
    forces = DAISY.foot_forces(STANDING, np.zeros(18), hanging[6:], specific_force_body=tilt.T @ UP)
    np.testing.assert_allclose(forces, 0.0, atol=1e-9)


# --- the hopper: one leg of two joints on a force plate, 1 kHz (../shared/data/hopper_leg) ---

LINK_M = 0.16
LINK_KG = (0.15, 0.05)  # guesses for a printed leg: they shift the force by 0.7 N and are not fitted


@dataclass(frozen=True)
class Hopper:
    """Three seconds of a hopping leg.

    ``clearance_m`` is how high the foot is by the rail's height sensor and the joint angles, up to a constant: the
    force plate has no part in it. ``is_flight`` is where it is 10 mm above where it stood at the start.
    """

    position: Array
    velocity: Array
    torque: Array
    plate_n: Array
    is_flight: BoolArray


@pytest.fixture(scope="module")
def hopper(shared_data) -> Hopper:
    names = ("joint_positions", "joint_velocities", "joint_torques", "height_sensors", "ati_force")
    tables = [np.loadtxt(shared_data / "hopper_leg" / f"dg_hopper_teststand-{name}.dat") for name in names]
    rows = min(len(table) for table in tables)
    counters = np.array([table[:rows, 0] for table in tables])
    assert (counters == counters[0]).all()
    position, velocity, torque, height, plate = (table[:rows, 1:] for table in tables)
    leg_height = LINK_M * (np.cos(position[:, 0]) + np.cos(position.sum(axis=1)))
    clearance = savgol_filter(height[:, 0] - leg_height, 21, 1)
    is_flight = clearance > np.median(clearance[:200]) + 0.010
    return Hopper(position, velocity, torque, plate[:, 2], is_flight)


def hopper_model(folder: Path, damping: Array) -> RobotModel:
    links = [
        f'<link name="{name}"><inertial><origin xyz="0 0 {-LINK_M / 2}"/><mass value="{mass}"/>'
        f'<inertia ixx="{mass * LINK_M**2 / 12}" iyy="{mass * LINK_M**2 / 12}" izz="1e-5" ixy="0" ixz="0" iyz="0"/>'
        "</inertial></link>"
        for name, mass in zip(("upper", "lower"), LINK_KG, strict=True)
    ]
    joints = [
        f'<joint name="{name}" type="revolute"><parent link="{parent}"/><child link="{child}"/>'
        f'<origin xyz="0 0 {height}"/><axis xyz="0 1 0"/><limit lower="-3" upper="3" effort="3" velocity="50"/>'
        f'<dynamics damping="{friction}" friction="0"/></joint>'
        for name, parent, child, height, friction in (
            ("hip", "base", "upper", 0.0, damping[0]),
            ("knee", "upper", "lower", -LINK_M, damping[1]),
        )
    ]
    ankle = f'<joint name="ankle" type="fixed"><parent link="lower"/><child link="foot"/><origin xyz="0 0 {-LINK_M}"/>'
    body = "".join((*links, *joints, ankle, "</joint>"))
    urdf = folder / "hopper.urdf"
    urdf.write_text(f'<robot name="hopper"><link name="base"/><link name="foot"/>{body}</robot>', encoding="utf-8")
    leg = LegDescription(name="leg", joints=("hip", "knee"), foot_frame="foot")
    return RobotModel(RobotDescription(name="hopper", urdf=str(urdf), legs=(leg,)))


def vertical_force(model: RobotModel, hopper: Hopper, *, friction: bool) -> Array:
    """Torque-derived vertical force, N, (rows,), without the leg's weight; joint friction compensated or not."""
    acceleration = np.zeros(2) if friction else None  # not logged; taken as zero
    rows = zip(hopper.position, hopper.velocity, hopper.torque, strict=True)
    return np.array([model.foot_forces(*row, specific_force_body=UP, acceleration=acceleration)[0, 2] for row in rows])


def damping_in_flight(hopper: Hopper) -> Array:
    """Viscous friction of each joint, Nm s/rad, (2,): in the air the motors move nothing but the leg itself.

    Least squares of torque over velocity and acceleration while the foot is high: the plate has no part in it.
    """
    acceleration = savgol_filter(hopper.velocity, 15, 2, deriv=1, delta=1e-3, axis=0)
    flight = hopper.is_flight
    return np.array(
        [
            np.linalg.lstsq(
                np.stack((hopper.velocity[flight, joint], acceleration[flight, joint]), axis=1),
                hopper.torque[flight, joint],
                rcond=None,
            )[0][0]
            for joint in (0, 1)
        ]
    )


def test_torque_shows_the_force_on_a_real_leg(hopper, tmp_path, record_property) -> None:
    """Gear friction costs 0.02 of correlation; what it is shows in flight. Measured: 0.934 plain, 0.955 without it."""
    damping = damping_in_flight(hopper)
    assert (damping > 0.005).all()
    assert (damping < 0.05).all()
    model = hopper_model(tmp_path, damping)
    plain, without_friction = (vertical_force(model, hopper, friction=friction) for friction in (False, True))
    correlations = [np.corrcoef(force, hopper.plate_n)[0, 1] for force in (plain, without_friction)]
    assert correlations[0] > 0.93
    assert correlations[1] > 0.95
    scale = without_friction @ hopper.plate_n / (without_friction @ without_friction)
    assert scale == pytest.approx(1.0, abs=0.1)
    record_property("hopper_correlation", f"{correlations[0]:.3f} plain, {correlations[1]:.3f} without friction")


def test_torque_shows_the_contact_of_a_real_leg(hopper, tmp_path, record_property) -> None:
    """Thresholds from what the torques show while the foot is in the air: 3 and 1.5 sigma above the median.

    Measured: on 2.21 N, off 1.72 N, balanced accuracy 0.934.
    """
    force = vertical_force(hopper_model(tmp_path, np.zeros(2)), hopper, friction=False)
    flight = force[hopper.is_flight]
    median = float(np.median(flight))
    sigma = 1.4826 * float(np.median(np.abs(flight - median)))
    config = ContactConfig(on_force=median + 3.0 * sigma, off_force=median + 1.5 * sigma)
    detector = ContactDetector(config, legs=1)
    is_stance = np.array([detector.update(row * 1_000_000, force[[row]]).is_stance[0] for row in range(len(force))])
    truth = hopper.plate_n > 2.0
    assert 0.9 < truth.mean() < 0.95
    accuracy = 0.5 * (is_stance[truth].mean() + (~is_stance)[~truth].mean())
    record_property(
        "hopper_balanced_accuracy", f"{accuracy:.3f} (on {config.on_force:.2f}, off {config.off_force:.2f} N)"
    )
    assert accuracy >= 0.9


def test_the_flight_of_the_hopper_is_detected_without_the_plate(hopper) -> None:
    """A check on the two tests above: where the rail and the angles say flight, the plate measures next to nothing."""
    assert hopper.is_flight.sum() > 100
    assert np.abs(hopper.plate_n[hopper.is_flight]).max() < 2.0
