# SPDX-License-Identifier: BSD-3-Clause
"""Recovery in the robustness study, on errors known by hand."""

import numpy as np
import pytest

from coclo_vio.experiments.studies import robustness_study
from coclo_vio.geometry import se3
from coclo_vio.values.trajectory import Trajectory
from coclo_vio.values.units import NS_PER_S

TIMES_S = np.arange(0, 201) / 10.0
USUAL_M = 0.01


def errors(**wrong_from_to: tuple[float, float]) -> np.ndarray:
    """Small errors, and large ones from a time to another, both included."""
    wrong = np.full(len(TIMES_S), 0.5 * USUAL_M)
    for start_s, end_s in wrong_from_to.values():
        first, last = np.searchsorted(TIMES_S, [start_s - 1e-9, end_s + 1e-9])
        wrong[first:last] = 3.0 * USUAL_M
    return wrong


@pytest.mark.parametrize(
    ("wrong", "recovery_s"),
    [
        ({}, 0.0),
        ({"fault": (5.0, 8.9)}, 0.0),
        ({"fault": (5.0, 9.9)}, 1.0),
        ({"fault": (5.0, 9.4), "again": (10.4, 10.4)}, 1.5),
        ({"fault": (5.0, 9.4), "again": (10.5, 10.5), "far_off": (12.0, 12.0)}, 1.6),
        ({"fault": (5.0, 9.4), "long_after": (10.6, 10.6)}, 0.5),
        ({"fault": (5.0, 20.0)}, None),
        ({"fault": (5.0, 19.5)}, None),
    ],
)
def test_recovery_is_when_the_error_stays_within_the_nominal_limit_for_a_second(
    wrong: dict[str, tuple[float, float]], recovery_s: float | None
) -> None:
    found_s = robustness_study.recovery_s(TIMES_S, errors(**wrong), 9.0, USUAL_M)
    assert found_s == (None if recovery_s is None else pytest.approx(recovery_s))


def test_the_error_at_a_time_is_that_of_the_second_before_it() -> None:
    """A jump of 5 cm at 3 s is in the windows that hold it, and in no other."""
    stamps = np.arange(0, 6 * NS_PER_S + 1, NS_PER_S // 100)
    true = np.array([se3.transform(np.eye(3), np.array([0.1 * stamp / NS_PER_S, 0.0, 0.0])) for stamp in stamps])
    jumped = true.copy()
    jumped[stamps >= 3 * NS_PER_S, 1, 3] += 0.05
    times_s, errors_m = robustness_study.error_history(Trajectory(stamps[7:], jumped[7:]), Trajectory(stamps, true))
    np.testing.assert_allclose(times_s, np.arange(11, 61) / 10.0)
    holds_jump = (times_s > 2.95) & (times_s < 3.95)
    np.testing.assert_allclose(errors_m[holds_jump], 0.05, atol=1e-12)
    np.testing.assert_allclose(errors_m[~holds_jump], 0.0, atol=1e-12)
