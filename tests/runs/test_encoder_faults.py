# SPDX-License-Identifier: BSD-3-Clause
"""Encoders that read a wrong angle: which, by how much, and when."""

import numpy as np
import pytest

from coclo_vio.robot.description import load_robot
from coclo_vio.runs.encoder_faults import EncoderFaults
from coclo_vio.runs.run_config import resolve
from coclo_vio.values.errors import ConfigError
from coclo_vio.values.measurements import JointSample
from coclo_vio.values.units import NS_PER_S

DAISY = load_robot("daisy")
COLUMN = DAISY.joint_names.index("leg2_elbow")
OTHERS = np.arange(len(DAISY.joint_names)) != COLUMN


def sample() -> JointSample:
    values = np.linspace(0.1, 0.9, len(DAISY.joint_names))
    return JointSample(0, values, 2.0 * values, 3.0 * values)


def read_at(after_s: float, *, flipped: tuple[str, ...] = (), offsets: tuple[str, ...] = ()) -> JointSample:
    return EncoderFaults(flipped, offsets, DAISY).applied(sample(), round(after_s * NS_PER_S))


def test_a_flipped_encoder_reads_angle_and_velocity_with_a_wrong_sign_during_its_span() -> None:
    faulty, true = read_at(1.2, flipped=("leg2_elbow:1:0.5",)), sample()
    assert (faulty.position[COLUMN], faulty.velocity[COLUMN]) == (-true.position[COLUMN], -true.velocity[COLUMN])
    np.testing.assert_array_equal(faulty.position[OTHERS], true.position[OTHERS])
    np.testing.assert_array_equal(faulty.velocity[OTHERS], true.velocity[OTHERS])
    np.testing.assert_array_equal(faulty.effort, true.effort)
    for after_s in (0.9, 1.5):
        np.testing.assert_array_equal(read_at(after_s, flipped=("leg2_elbow:1:0.5",)).position, true.position)


def test_an_offset_is_added_to_the_angle_and_leaves_the_velocity() -> None:
    faulty, true = read_at(1.2, offsets=("leg2_elbow:1:0.5:-5",)), sample()
    assert faulty.position[COLUMN] - true.position[COLUMN] == pytest.approx(-np.pi / 36.0)
    np.testing.assert_array_equal(faulty.position[OTHERS], true.position[OTHERS])
    np.testing.assert_array_equal(faulty.velocity, true.velocity)


@pytest.mark.parametrize(
    ("setting", "words"),
    [
        ("faults.flipped_encoders=[leg1_base]", "'leg1_base' is no JOINT:START:SECONDS, such as leg1_base:20:3"),
        ("faults.flipped_encoders=[7]", "must be text JOINT:START:SECONDS"),
        ("faults.encoder_offsets=['leg1_base:20:3']", "is no JOINT:START:SECONDS:DEG, such as leg1_base:20:3:5"),
        ("faults.encoder_offsets=['leg1_base:20:3:0']", "DEG must be between -180 and 180 and not 0"),
        ("faults.encoder_offsets=['leg1_base:20:3:nan']", "DEG must be between -180 and 180 and not 0"),
    ],
)
def test_a_malformed_encoder_fault_is_named_in_one_sentence(setting: str, words: str) -> None:
    with pytest.raises(ConfigError) as caught:
        resolve("daisy", settings=[setting])
    assert words in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_joint_that_the_robot_does_not_have_lists_those_it_has() -> None:
    with pytest.raises(ConfigError, match=r"daisy has no joint knee; its joints are: leg1_base, .*leg6_shoulder$"):
        EncoderFaults(("knee:1:1",), (), DAISY)
    with pytest.raises(ConfigError, match=r"no robot is given; name it with --robot$"):
        EncoderFaults((), ("leg1_base:1:1:5",), None)
