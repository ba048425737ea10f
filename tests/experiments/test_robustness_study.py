# SPDX-License-Identifier: BSD-3-Clause
"""What the robustness benchmark calls recovery, on errors known by hand."""

import numpy as np
import pytest

from coclo_vio.experiments.studies import robustness
from coclo_vio.geometry import se3
from coclo_vio.values.trajectory import Trajectory

MOMENTS = np.arange(0, 201) / 10.0
USUAL_M = 0.01


def errors(**wrong_from_to: tuple[float, float]) -> np.ndarray:
    """Small errors, and large ones from one moment to another, both included."""
    wrong = np.full(len(MOMENTS), 0.5 * USUAL_M)
    for start_s, end_s in wrong_from_to.values():
        first, last = np.searchsorted(MOMENTS, [start_s - 1e-9, end_s + 1e-9])
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
def test_recovery_is_when_the_error_is_usual_and_stays_so_for_a_second(
    wrong: dict[str, tuple[float, float]], recovery_s: float | None
) -> None:
    told = robustness.recovery_s(MOMENTS, errors(**wrong), 9.0, USUAL_M)
    assert told == (None if recovery_s is None else pytest.approx(recovery_s))


def test_the_error_of_a_moment_is_that_of_the_second_before_it() -> None:
    """A jump of 5 cm at 3 s is in the windows that hold it, and in no other."""
    stamps = np.arange(0, 6_000_000_001, 10_000_000)
    true = np.array([se3.transform(np.eye(3), np.array([0.1 * stamp * 1e-9, 0.0, 0.0])) for stamp in stamps])
    jumped = true.copy()
    jumped[stamps >= 3_000_000_000, 1, 3] += 0.05
    moments_s, errors_m = robustness.moments(Trajectory(stamps[7:], jumped[7:]), Trajectory(stamps, true))
    np.testing.assert_allclose(moments_s, np.arange(11, 61) / 10.0)
    is_in_it = (moments_s > 2.95) & (moments_s < 3.95)
    np.testing.assert_allclose(errors_m[is_in_it], 0.05, atol=1e-12)
    np.testing.assert_allclose(errors_m[~is_in_it], 0.0, atol=1e-12)
