# SPDX-License-Identifier: BSD-3-Clause
"""What follows from a mode's declaration: sensors, trajectories, roles."""

import pytest

from coclo_vio.runs.equipment import Equipment
from coclo_vio.runs.modes.mode import Compared, Mode, Need
from coclo_vio.runs.run_config import RunConfig
from coclo_vio.values.errors import ConfigError
from coclo_vio.values.measurements import (
    IMAGE_SENSORS,
    IMU_SENSORS,
    LEG_SENSORS,
    BodyTwistSample,
    CameraImuSample,
    ImuSample,
    StereoFrame,
)
from coclo_vio.values.outputs import Estimator
from coclo_vio.values.trajectory_kind import TrajectoryKind


def unmade(equipment: Equipment, config: RunConfig) -> Estimator:
    raise ConfigError("it is only declared")


@pytest.mark.parametrize(
    ("needs", "uses", "sensors"),
    [
        ({Need.LEGS}, set(), LEG_SENSORS),
        ({Need.CAMERAS}, set(), IMAGE_SENSORS),
        ({Need.CAMERAS}, {Need.IMU}, IMAGE_SENSORS | IMU_SENSORS),
        ({Need.BODY_TWIST}, set(), {BodyTwistSample}),
        ({Need.LEGS, Need.CAMERAS}, set(), LEG_SENSORS | IMAGE_SENSORS),
        (set(), set(), set()),
    ],
)
def test_a_mode_reads_the_sensors_of_what_it_needs_and_uses(
    needs: set[Need], uses: set[Need], sensors: set[type]
) -> None:
    mode = Mode("toy", "", frozenset(needs), unmade, uses=frozenset(uses))
    assert mode.sensors == sensors
    assert mode.has_legs == (Need.LEGS in needs)
    assert mode.has_cameras == (Need.CAMERAS in needs)


def test_a_mode_without_trajectories_gives_one_of_its_own_name() -> None:
    mode = Mode("toy", "", frozenset(), unmade)
    assert mode.trajectories == (TrajectoryKind("toy"),)
    assert mode.trajectory_names == ("toy",)
    assert Mode("toy", "", frozenset(), unmade, (TrajectoryKind("a"), TrajectoryKind("b"))).trajectory_names == (
        "a",
        "b",
    )


def test_a_mode_is_compared_but_is_no_default_and_in_no_table_unless_declared() -> None:
    mode = Mode("toy", "", frozenset(), unmade)
    assert (mode.compared, mode.default_rank, mode.table, mode.has_feedback) == (Compared.ALWAYS, None, False, False)


def test_a_mode_that_uses_an_imu_reads_none_whose_mounting_is_not_known() -> None:
    mode = Mode("toy", "", frozenset({Need.CAMERAS}), unmade, uses=frozenset({Need.IMU}))
    equipment = Equipment(sensors=frozenset({StereoFrame, ImuSample, CameraImuSample}))
    assert mode.sensors_of(equipment) == {StereoFrame}
