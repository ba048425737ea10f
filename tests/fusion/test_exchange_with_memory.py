# SPDX-License-Identifier: BSD-3-Clause
"""What the exchange loses where both sides remember more than the newest pose: a bias, and landmarks that persist."""

import pytest
from world_with_memory import World


def run(world: World) -> list[tuple[float, float, float]]:
    """At each keyframe: true over claimed variance of the filter's pose and of the window's, and loss of accuracy."""
    rows = []
    for number in range(world.keyframes):
        world.step(number)
        (true_f, claimed_f), (true_w, claimed_w) = world.filter.variances(0), world.window.variances(0)
        rows.append((true_f / claimed_f, true_w / claimed_w, (true_f / world.joint.variances(0)[0]) ** 0.5))
    return rows


def test_the_joint_estimator_is_what_it_claims() -> None:
    world = World(keyframes=20)
    for number in range(world.keyframes):
        world.step(number)
    true, claimed = world.joint.variances(0)
    assert true == pytest.approx(claimed, rel=1e-5)


def test_without_a_bias_the_exchange_is_exact_however_long_landmarks_persist() -> None:
    for by_filter, by_window, loss in run(World(bias=1e-6, life=20)):
        assert by_filter == pytest.approx(1.0, abs=1e-4)
        assert by_window == pytest.approx(1.0, abs=1e-4)
        assert loss == pytest.approx(1.0, abs=1e-4)


@pytest.mark.parametrize(
    "changes",
    [{}, {"life": 2}, {"life": 20}, {"life": 30, "bias": 0.1, "legs": 0.002, "camera": 0.01}, {"camera": 0.1}],
)
def test_with_a_bias_and_landmarks_that_persist_it_is_nearly_the_joint_estimate(changes: dict[str, float]) -> None:
    rows = run(World(**changes))  # type: ignore[arg-type]
    for by_filter, by_window, loss in rows:
        assert 0.9 < by_filter < 1.08
        assert 0.9 < by_window < 1.08
        assert loss < 1.03
