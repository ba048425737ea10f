# SPDX-License-Identifier: BSD-3-Clause
"""Faults of joints and feet on samples made by hand, and a foot that slides."""

import numpy as np
import pytest
from fault_samples import BEGIN_NS, DAISY, JOINTS, changed_steps, of_kind, recorded, step_of, with_faults

from coclo_vio.robot.model import RobotModel
from coclo_vio.values.errors import ConfigError
from coclo_vio.values.measurements import FootForceSample, JointSample

ROWS = recorded()
LEG3 = [DAISY.joint_names.index(joint) for joint in DAISY.legs[2].joints]
OTHERS = np.setdiff1d(np.arange(JOINTS), LEG3)


def test_a_frozen_encoder_holds_its_angle_at_rest_and_its_torque_goes_on() -> None:
    faulty = with_faults(ROWS, frozen_encoders="leg3_shoulder:1:0.5")
    assert changed_steps(ROWS, faulty, JointSample) == {10, 11, 12, 13, 14}
    column = DAISY.joint_names.index("leg3_shoulder")
    one, plain = of_kind(faulty, JointSample)[12], of_kind(ROWS, JointSample)[12]
    assert one.position[column] == pytest.approx(0.10)
    assert one.velocity[column] == 0.0
    np.testing.assert_array_equal(one.effort, plain.effort)
    rest = np.arange(JOINTS) != column
    np.testing.assert_array_equal(one.position[rest], plain.position[rest])


def test_spikes_are_single_samples_of_one_joint() -> None:
    rows = of_kind(recorded(1000), JointSample)
    faulty = with_faults(rows, encoder_spikes="leg3_base:10:80:20", seed=2)
    steps = changed_steps(rows, faulty, JointSample)
    assert steps <= set(range(100, 900))
    assert len(steps) == pytest.approx(40, abs=20)
    one, plain = faulty[min(steps)], rows[min(steps)]
    off = np.degrees(one.position - plain.position)
    assert off[DAISY.joint_names.index("leg3_base")] == pytest.approx(20.0)
    assert np.count_nonzero(off) == 1
    np.testing.assert_array_equal(one.velocity, plain.velocity)


def test_torques_are_zero_or_off_and_angles_stay() -> None:
    zero = with_faults(ROWS, zero_torques="1:0.5")
    off = with_faults(ROWS, torque_offsets="1:0.5:-4")
    assert changed_steps(ROWS, zero, JointSample) == changed_steps(ROWS, off, JointSample) == {10, 11, 12, 13, 14}
    plain = of_kind(ROWS, JointSample)[12]
    np.testing.assert_array_equal(of_kind(zero, JointSample)[12].effort, 0.0)
    np.testing.assert_array_equal(of_kind(off, JointSample)[12].effort, plain.effort - 4.0)
    np.testing.assert_array_equal(of_kind(zero, JointSample)[12].position, plain.position)


def test_a_missing_leg_has_no_reading_of_joints_and_foot() -> None:
    faulty = with_faults(ROWS, missing_legs="leg3:1:0.5")
    one, feet = of_kind(faulty, JointSample)[12], of_kind(faulty, FootForceSample)[12]
    for part in (one.position, one.velocity, one.effort):
        assert np.isnan(part[LEG3]).all()
        assert np.isfinite(part[OTHERS]).all()
    assert np.isnan(feet.force).tolist() == [False, False, True, False, False, False]
    assert np.isfinite(of_kind(faulty, JointSample)[15].position).all()


def test_without_load_torques_and_foot_forces_are_zero_and_legs_go_on() -> None:
    faulty = with_faults(ROWS, no_load="1:0.5")
    one, feet = of_kind(faulty, JointSample)[12], of_kind(faulty, FootForceSample)[12]
    assert not one.effort.any()
    assert not feet.force.any()
    np.testing.assert_array_equal(one.position, of_kind(ROWS, JointSample)[12].position)
    assert of_kind(faulty, FootForceSample)[15] is of_kind(ROWS, FootForceSample)[15]


def test_a_sliding_foot_moves_back_at_its_speed_and_its_joints_agree_with_that() -> None:
    model, position = RobotModel(DAISY), np.tile([0.05, -0.4, 1.2], 6)
    leg = int(model.feet(position, np.zeros(JOINTS)).position_body[:, 2].argmin())  # the others are in the air
    none = np.zeros(JOINTS)
    rows = [JointSample(BEGIN_NS + row * 10_000_000, position, none, none) for row in range(200)]
    faulty = with_faults(rows, sliding_legs=f"{DAISY.legs[leg].name}:0.5:1:0.1")
    moved = [row for row in range(200) if faulty[row] is not rows[row]]
    assert moved[0] == 50
    assert moved[-1] < 190, "it comes back and is then as recorded"
    before, at, later = (model.feet(faulty[row].position, faulty[row].velocity) for row in (40, 100, 101))
    np.testing.assert_allclose(at.position_body[leg] - before.position_body[leg], [-0.051, 0.0, 0.0], atol=2e-3)
    np.testing.assert_allclose(at.velocity_body[leg], [-0.1, 0.0, 0.0], atol=1e-3)
    np.testing.assert_allclose((later.position_body[leg] - at.position_body[leg]) / 0.01, [-0.1, 0.0, 0.0], atol=1e-3)
    others = [column for column in range(JOINTS) if column // 3 != leg]
    np.testing.assert_array_equal(faulty[100].position[others], position[others])


def test_a_lifted_foot_does_not_slide() -> None:
    model, position = RobotModel(DAISY), np.tile([0.05, -0.4, 1.2], 6)
    heights = model.feet(position, np.zeros(JOINTS)).position_body[:, 2]
    leg = int(heights.argmax())
    assert heights[leg] > heights.min() + 0.02
    rows = [
        JointSample(BEGIN_NS + row * 10_000_000, position, np.zeros(JOINTS), np.zeros(JOINTS)) for row in range(100)
    ]
    faulty = with_faults(rows, sliding_legs=f"{DAISY.legs[leg].name}:0.2:0.5:0.1")
    np.testing.assert_allclose([one.position for one in faulty], np.tile(position, (100, 1)), atol=1e-12)


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ({"sliding_legs": "front:1:2:0.1"}, "daisy has no leg front; its legs are: leg1, "),
        ({"missing_legs": "front:1:2"}, "daisy has no leg front; its legs are: leg1, "),
        ({"frozen_encoders": "hip:1:2"}, "daisy has no joint hip; its joints are: "),
        ({"encoder_spikes": "hip:1:2:20"}, "daisy has no joint hip; its joints are: "),
        ({"encoder_spikes": "leg1_base:1:2"}, "is no JOINT:START:SECONDS:DEG, such as leg1_base:20:3:20"),
        ({"encoder_spikes": "leg1_base:1:2:200"}, "the size of DEG must be between 0 and 180"),
        ({"torque_offsets": [3]}, "must be text START:SECONDS:NM"),
    ],
)
def test_a_malformed_fault_of_a_joint_is_named(values: dict[str, object], words: str) -> None:
    with pytest.raises(ConfigError, match=words):
        with_faults(ROWS, **values)


def test_the_steps_of_a_recording_are_as_the_tests_take_them() -> None:
    assert [step_of(one) for one in of_kind(ROWS, JointSample)] == list(range(40))
