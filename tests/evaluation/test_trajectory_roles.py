# SPDX-License-Identifier: BSD-3-Clause
"""Order, leading trajectories and pairs follow from registered kinds."""

from coclo_vio.evaluation.trajectory_roles import featured, fused_pairs, in_order, is_fused, standalone_names
from coclo_vio.values.trajectory_kind import TrajectoryKind, register_trajectory_kind


def test_featured_ones_lead_then_others_as_registered_then_unregistered_as_given() -> None:
    register_trajectory_kind(TrajectoryKind("late", is_featured=True))
    assert in_order(["z", "naive", "a", "late", "vision", "legs", "z"]) == ["legs", "vision", "late", "naive", "z", "a"]


def test_baselines_lead_only_among_themselves() -> None:
    assert featured(["naive", "vision", "legs"]) == ["legs", "vision"]
    assert featured(["z", "naive"]) == ["z", "naive"]


def test_pairs_are_fused_trajectories_with_their_standalone_counterparts() -> None:
    assert fused_pairs() == [("fused_legs", "legs"), ("fused_vision", "vision")]
    assert fused_pairs(["fused_vision", "vision", "fused_legs"]) == [("fused_vision", "vision")]
    assert standalone_names() == ["legs", "vision"]
    assert [is_fused(name) for name in ("fused_legs", "legs", "unregistered")] == [True, False, False]
