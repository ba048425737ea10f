# SPDX-License-Identifier: BSD-3-Clause
"""Combined odometry on the analytic walk with each of the simulated faults."""

from collections.abc import Iterator

import numpy as np
import pytest
from walk_among_points import (
    DAISY,
    combined,
    error_m,
    outputs_of,
    states,
    stream,
    trial,
)

from coclo_vio.runs.faults import Faults, FaultsConfig
from coclo_vio.values.estimates import StateEstimate
from coclo_vio.values.measurements import Measurement


def estimates(**values: object) -> tuple[list[StateEstimate], list[StateEstimate]]:
    """Both trajectories of the walk with faults."""

    def read(sensors: frozenset[type]) -> Iterator[Measurement]:
        return (one for one in stream() if type(one) in sensors)

    faults = Faults(FaultsConfig.parse(values, "test"), DAISY.description)
    outputs = outputs_of(combined(), faults.measurements(read, frozenset(type(one) for one in stream())))
    return states(outputs, "combined_coclo"), states(outputs, "combined_vins")


@pytest.mark.long
@pytest.mark.parametrize(
    "faults", [{"frame_loss": 0.3}, {"frozen_legs": "leg2:2:1.5"}], ids=["lost frames", "frozen leg"]
)
def test_one_source_that_fails_is_made_up_for_by_the_other(faults: dict[str, object]) -> None:
    by_legs, by_vision = estimates(**faults)
    assert len(by_legs) > 400
    assert max(error_m(one) for one in (*by_legs, *by_vision)) < 0.02


def test_where_both_fail_at_once_estimates_go_on_and_their_covariance_covers_the_error() -> None:
    """A blackout begins while the joints are silent: for half a second there is a gyroscope and no more."""
    by_legs, by_vision = estimates(silent_joints="2:1", blackouts="2.5:1")
    for trajectory in (by_legs, by_vision):
        assert trajectory[-1].stamp_ns > trial().truth.stamps_ns[-1] - 100_000_000
        sigma_m = [float(np.sqrt(np.trace(one.covariance[3:6, 3:6]))) for one in trajectory]
        errors_m = [error_m(one) for one in trajectory]
        assert all(error < 3.0 * sigma + 0.01 for error, sigma in zip(errors_m, sigma_m, strict=True))
        assert sigma_m[-1] > 0.02
