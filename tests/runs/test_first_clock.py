# SPDX-License-Identifier: BSD-3-Clause
"""Steps of a clock are undone output by output."""

import numpy as np
import pytest

from coclo_vio.runs.first_clock import FirstClock
from coclo_vio.values.estimates import NavState, StateEstimate
from coclo_vio.values.outputs import ClockStepEvent, Estimate, Event, Output

NS, MS = 1_000_000_000, 1_000_000
NAV = NavState(np.eye(4), *(np.zeros(3) for _ in range(4)))


def estimate(stamp_ns: int, name: str = "legs") -> Estimate:
    return Estimate(name, StateEstimate(stamp_ns, NAV, np.eye(9)))


def step(at_ns: int, step_ns: int, before_ns: int = 0) -> ClockStepEvent:
    return ClockStepEvent(at_ns + before_ns + step_ns, "clock_step", "", at_ns, step_ns)


def stamp_of(output: Output) -> int:
    return output.state.stamp_ns if isinstance(output, Estimate) else output.stamp_ns


def test_without_a_step_outputs_are_the_same_objects() -> None:
    clock = FirstClock()
    outputs = [estimate(5), Event(7, "vision_lost", ""), estimate(9)]
    assert [clock.undone(each) for each in outputs] == outputs
    assert all(clock.undone(each) is each for each in outputs)


@pytest.mark.parametrize("step_ns", [-1000 * NS, 1000 * NS, -2 * NS, 300 * MS])
def test_outputs_that_come_late_and_over_many_steps_get_their_first_stamps(step_ns: int) -> None:
    """Legs at 10 ms, vision at 100 ms that comes 130 ms late; steps at 2 s, and back again at 5 s."""
    clock = FirstClock()
    found: list[int] = []
    expected: list[int] = []

    def shift_ns(at_ns: int) -> int:
        return step_ns if 2 * NS <= at_ns < 5 * NS else 0

    def give(at_ns: int, name: str) -> None:
        found.append(stamp_of(clock.undone(estimate(at_ns + shift_ns(at_ns), name))))
        expected.append(at_ns)

    for at_ns in range(0, 8 * NS, 10 * MS):
        if at_ns == 2 * NS:
            assert stamp_of(clock.undone(step(at_ns, step_ns))) == at_ns
        if at_ns == 5 * NS:
            assert stamp_of(clock.undone(step(at_ns, -step_ns, step_ns))) == at_ns
        give(at_ns, "legs")
        if at_ns % (100 * MS) == 30 * MS and at_ns > 100 * MS:
            give(at_ns - 130 * MS, "vision")
    assert found == expected


def test_a_clock_that_comes_back_to_stamps_that_were_there_goes_on() -> None:
    """1000 s after a step back by 1000 s the stamps are those of the step again."""
    clock = FirstClock()
    for at_ns in range(0, 2 * NS, NS):
        clock.undone(estimate(at_ns))
    clock.undone(step(2 * NS, -1000 * NS))
    found = [stamp_of(clock.undone(estimate(at_ns - 1000 * NS))) for at_ns in range(2 * NS, 1010 * NS, NS)]
    assert found == list(range(2 * NS, 1010 * NS, NS))
