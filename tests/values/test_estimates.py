# SPDX-License-Identifier: BSD-3-Clause
import numpy as np
import pytest

from coclo_vio.values.estimates import FootState, NavState, StateEstimate
from coclo_vio.values.keyframes import OdometryDelta


def _nav(**changes: object) -> NavState:
    zero = np.zeros(3)
    parts: dict[str, object] = {
        "T_world_body": np.eye(4),
        "velocity_world": zero,
        "angular_velocity_body": zero,
        "gyroscope_bias": zero,
        "accelerometer_bias": zero,
    }
    return NavState(**(parts | changes))  # type: ignore[arg-type]


@pytest.mark.parametrize("name", ["velocity_world", "angular_velocity_body", "gyroscope_bias", "accelerometer_bias"])
def test_every_vector_of_a_state_is_checked(name: str) -> None:
    with pytest.raises(ValueError, match=rf"NavState.{name} must have shape \(3,\), got \(4,\)"):
        _nav(**{name: np.zeros(4)})
    with pytest.raises(ValueError, match=rf"NavState.{name} must be finite"):
        _nav(**{name: np.full(3, np.nan)})
    with pytest.raises(ValueError, match="read-only"):
        getattr(_nav(), name)[0] = 1.0


def test_a_pose_is_four_by_four() -> None:
    with pytest.raises(ValueError, match=r"NavState.T_world_body must have shape \(4, 4\), got \(3, 4\)"):
        _nav(T_world_body=np.eye(4)[:3])


def test_covariances_have_their_size() -> None:
    with pytest.raises(ValueError, match=r"StateEstimate.covariance must have shape \(9, 9\), got \(6, 6\)"):
        StateEstimate(0, _nav(), np.eye(6))
    with pytest.raises(ValueError, match=r"OdometryDelta.covariance must have shape \(6, 6\), got \(9, 9\)"):
        OdometryDelta(0, 1, np.eye(4), np.eye(9))


def test_feet_belong_together() -> None:
    feet = FootState(np.zeros((4, 3)), np.full(4, 0.5), np.array([True, False, True, False]))
    assert feet.is_stance.dtype == np.bool_
    for array in (feet.position_world, feet.contact_probability, feet.is_stance):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 0
    with pytest.raises(ValueError, match=r"contact_probability must have shape \(4,\), got \(3,\)"):
        FootState(np.zeros((4, 3)), np.zeros(3), np.zeros(4, dtype=np.bool_))
    with pytest.raises(ValueError, match=r"is_stance must have shape \(4,\), got \(6,\)"):
        FootState(np.zeros((4, 3)), np.zeros(4), np.zeros(6, dtype=np.bool_))


def test_a_delta_cannot_end_before_it_starts() -> None:
    with pytest.raises(ValueError, match="ends at 4 ns before it starts at 5 ns"):
        OdometryDelta(5, 4, np.eye(4), np.eye(6))
    assert OdometryDelta(5, 5, np.eye(4), np.eye(6)).end_ns == 5
