# SPDX-License-Identifier: BSD-3-Clause
"""GTSAM's filter is made again from its last state without a stance and the calls since, to the last bit."""

from pathlib import Path

import numpy as np
import pytest

from coclo_vio.backend import filter_calls
from coclo_vio.backend.config import FootholdNoiseConfig
from coclo_vio.backend.foothold_filter import FootholdFilter
from coclo_vio.geometry import se3, so3
from coclo_vio.runs.checkpoint import Checkpoints, Position
from coclo_vio.values.object_fields import CheckpointPostponed
from coclo_vio.values.outputs import Output

FEET = np.array([[0.2, 0.2, -0.3], [0.2, -0.2, -0.3], [-0.2, 0.2, -0.3], [-0.2, -0.2, -0.3]])


class Holder:
    """An estimator that makes its filter at the first measurement."""

    def __init__(self) -> None:
        self.config, self.T_body_imu = FootholdNoiseConfig(), se3.transform(np.eye(3), np.array([0.1, 0.0, 0.05]))
        self.filter: FootholdFilter | None = None
        self.counts: dict[str, int] = {}

    def begin(self) -> FootholdFilter:
        self.filter = FootholdFilter(
            self.config,
            self.T_body_imu,
            ("a", "b", "c", "d"),
            rotation_world_body=so3.exp(np.array([0.03, 0.02, 0.0])),
            gyroscope_bias=np.array([0.01, 0.02, 0.0]),
            tilt_rad=0.01,
            velocity_mps=0.01,
        )
        return self.filter

    def push(self, measurement: object) -> tuple[Output, ...]:
        return ()

    def finish(self) -> tuple[Output, ...]:
        return ()


def _walk(core: FootholdFilter, rng: np.random.Generator, steps: range) -> None:
    for step in steps:
        for _ in range(3):
            force = np.array([0.0, 0.0, 9.81]) + rng.normal(size=3)
            core.predict(0.005, 0.3 * rng.normal(size=3), force)
        is_stance = np.array([True, step % 7 < 4, step % 11 < 6, step % 5 < 4]) & (step % 50 < 45)
        core.correct(FEET + 0.01 * rng.normal(size=(4, 3)), is_stance)


@pytest.mark.parametrize("stop", [1, 38, 45, 47, 51, 90])
def test_the_filter_that_is_made_again_goes_on_to_the_last_bit(stop: int, tmp_path: Path) -> None:
    one, other = Holder(), Holder()
    rng = np.random.default_rng(4)
    kept = Checkpoints(tmp_path, "one", one)
    _walk(one.begin(), rng, range(stop))
    kept.save(Position(1, 2, 3), {})
    Checkpoints(tmp_path, "one", other).load()
    assert one.filter is not None
    assert other.filter is not None
    again = np.random.default_rng()
    again.bit_generator.state = rng.bit_generator.state
    _walk(one.filter, rng, range(stop, stop + 30))
    _walk(other.filter, again, range(stop, stop + 30))
    for ours, theirs in zip(one.filter.state_at(np.ones(3)), other.filter.state_at(np.ones(3)), strict=True):
        assert repr(ours) == repr(theirs)
    np.testing.assert_array_equal(other.filter.T_world_body, one.filter.T_world_body)
    np.testing.assert_array_equal(other.filter.is_stance, one.filter.is_stance)


def test_after_too_many_calls_a_checkpoint_waits_until_no_foot_is_in_stance(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(filter_calls, "MOST_BYTES", 20 * (3 * 7 + 17) * 8)  # twenty steps
    holder = Holder()
    kept = Checkpoints(tmp_path, "one", holder)
    core = holder.begin()
    rng = np.random.default_rng(4)
    _walk(core, rng, range(20))
    kept.save(Position(1, 2, 3), {})
    _walk(core, rng, range(20, 21))
    with pytest.raises(CheckpointPostponed, match="filter: too long without a moment in which no foot"):
        kept.save(Position(2, 2, 3), {})
    _walk(core, rng, range(21, 46))  # the last one without a stance
    kept.save(Position(3, 2, 3), {})
    found = Checkpoints(tmp_path, "one", Holder()).load()
    assert found is not None
    assert found[0].measurements == 3


def test_what_is_learnt_at_rest_is_a_beginning_too() -> None:
    core = Holder().begin()
    _walk(core, np.random.default_rng(4), range(10))
    assert len(core.checkpoint_fields()["calls"]) == 10 * (3 * 7 + 17)
    core.set_gyroscope_bias(np.zeros(3))
    assert len(core.checkpoint_fields()["calls"]) == 0
