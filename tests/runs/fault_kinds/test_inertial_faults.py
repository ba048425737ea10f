# SPDX-License-Identifier: BSD-3-Clause
"""Faults of IMUs on readings made by hand: what is changed, on which IMU, and when."""

import numpy as np
import pytest
from fault_samples import BEGIN_NS, FORCE, changed_steps, of_kind, recorded, step_of, with_faults

from coclo_vio.runs.fault_kinds.inertial_faults import SHOCKS, _shock
from coclo_vio.values.errors import ConfigError
from coclo_vio.values.measurements import CameraImuSample, ImuSample

ROWS = recorded()


def test_a_silent_imu_gives_nothing_and_the_other_one_goes_on() -> None:
    faulty = with_faults(ROWS, silent_imu="1:0.5")
    assert {step_of(one) for one in of_kind(faulty, ImuSample)} == set(range(40)) - {10, 11, 12, 13, 14}
    assert len(of_kind(faulty, CameraImuSample)) == 40


@pytest.mark.parametrize(("which", "kind"), [("body", ImuSample), ("camera", CameraImuSample)])
def test_a_constant_imu_repeats_its_last_reading(which: str, kind: type) -> None:
    faulty = with_faults(ROWS, constant_imu="1:0.5", faulty_imu=which)
    assert changed_steps(ROWS, faulty, kind) == {10, 11, 12, 13, 14}
    assert of_kind(faulty, kind)[13].angular_velocity[2] == pytest.approx(0.1)
    assert of_kind(faulty, kind)[15].angular_velocity[2] == pytest.approx(0.16)


def test_faults_are_on_both_imus_where_both_are_named() -> None:
    faulty = with_faults(ROWS, silent_imu="0:100", faulty_imu="both")
    assert not of_kind(faulty, ImuSample)
    assert not of_kind(faulty, CameraImuSample)


@pytest.mark.parametrize(
    ("axes", "expected"),
    [("y -x z", [0.2, -0.1, 0.13]), ("-x -y -z", [-0.1, -0.2, -0.13]), ("y x z", [0.2, 0.1, 0.13])],
)
def test_other_axes_are_read_by_gyroscope_and_accelerometer_alike(axes: str, expected: list[float]) -> None:
    faulty = with_faults(ROWS, imu_axes=f"1:0.5:{axes}")
    assert changed_steps(ROWS, faulty, ImuSample) == {10, 11, 12, 13, 14}
    one = of_kind(faulty, ImuSample)[12]
    np.testing.assert_allclose(one.angular_velocity, expected)
    assert sorted(np.abs(one.specific_force)) == pytest.approx(sorted(FORCE))
    assert np.sign(one.specific_force[2]) == (-1.0 if axes.startswith("-") else 1.0)


def test_an_offset_of_the_accelerometer_leaves_the_gyroscope() -> None:
    faulty = with_faults(ROWS, accelerometer_offset="1:0.5:-0.7")
    assert changed_steps(ROWS, faulty, ImuSample) == {10, 11, 12, 13, 14}
    np.testing.assert_allclose(of_kind(faulty, ImuSample)[12].specific_force, FORCE - 0.7)
    np.testing.assert_allclose(of_kind(faulty, ImuSample)[12].angular_velocity, [0.1, 0.2, 0.13])


def test_a_saturated_imu_reads_no_more_than_its_range() -> None:
    one = of_kind(with_faults(ROWS, imu_saturation="1:0.5:0.15:5"), ImuSample)[12]
    np.testing.assert_allclose(one.angular_velocity, [0.1, 0.15, 0.13])
    np.testing.assert_allclose(one.specific_force, [1.0, 2.0, 5.0])


def test_shocks_come_five_times_a_second_and_leave_no_velocity() -> None:
    fault = SHOCKS.parse("1:10:100")
    times_ns = np.arange(1_000_000_000, 2_000_000_000, 100_000)
    forces = np.array([_shock(fault, int(at), 7) for at in times_ns])
    sizes = np.linalg.norm(forces, axis=1)
    assert sizes.max() == pytest.approx(100.0)
    assert ((sizes[1:] > 99.0) & (sizes[:-1] < 1.0)).sum() == 4  # and one at the beginning
    assert np.linalg.norm(forces.sum(axis=0) * 1e-4) < 0.05 < 0.002 * sizes.sum() * 1e-4 + 0.05


def test_shocks_are_in_their_span_and_leave_the_gyroscope() -> None:
    faulty = with_faults(ROWS, imu_shocks="1:0.5:100")
    assert changed_steps(ROWS, faulty, ImuSample) <= {10, 11, 12, 13, 14}
    one = of_kind(faulty, ImuSample)[10]
    assert np.linalg.norm(one.specific_force - FORCE) == pytest.approx(100.0)
    np.testing.assert_allclose(one.angular_velocity, [0.1, 0.2, 0.11])
    assert one.stamp_ns == BEGIN_NS + 1_000_000_000


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ({"imu_axes": "1:2:x y"}, "is no START:SECONDS:AXES with each axis once"),
        ({"imu_axes": "1:2:x x z"}, "is no START:SECONDS:AXES with each axis once"),
        ({"imu_saturation": "1:2:0.3"}, "is no START:SECONDS:RADPS:MPS2, such as 20:5:0.3:12"),
        ({"imu_saturation": "1:2:0.3:0"}, "the size of MPS2 must be between 0.1 and 10000"),
        ({"accelerometer_offset": "1:2:x"}, "is no START:SECONDS:MPS2"),
        ({"faulty_imu": "left"}, "faulty_imu"),
    ],
)
def test_a_malformed_fault_of_an_imu_is_named(values: dict[str, str], words: str) -> None:
    with pytest.raises(ConfigError, match=words):
        with_faults(ROWS, **values)
