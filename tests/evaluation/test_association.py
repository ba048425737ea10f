# SPDX-License-Identifier: BSD-3-Clause
"""Poses without ground truth beside them are left out and counted."""

import numpy as np
import pytest

from coclo_vio.evaluation.association import coverage, gaps_ns, in_gap, match
from coclo_vio.values.errors import EvaluationError

NS = 1_000_000_000


def test_gaps_are_intervals_longer_than_the_limit():
    stamps = np.array([0, 1, 2, 5, 6, 10]) * NS
    assert gaps_ns(stamps, 1.0).tolist() == [[2 * NS, 5 * NS], [6 * NS, 10 * NS]]
    assert gaps_ns(stamps, 4.0).shape == (0, 2)
    stamps_ns = np.array([0, 2, 3, 5, 6, 9, 10, 12]) * NS
    assert in_gap(stamps_ns, gaps_ns(stamps, 1.0)).tolist() == [False, False, True, False, False, True, False, False]
    assert not in_gap(stamps_ns, gaps_ns(stamps, 9.0)).any()


def test_poses_in_holes_and_outside_are_left_out_and_counted(line):
    estimate = line(10.0, 10.0)
    reference = line(10.0, 10.0).between(NS, 9 * NS)
    reference = reference.select((reference.stamps_ns <= 4 * NS) | (reference.stamps_ns >= 5 * NS))
    pair = match(estimate, reference, 0.25)
    assert (pair.outside_count, pair.in_gap_count) == (200, 99)
    assert len(pair.estimate) == len(pair.reference) == 1001 - 299
    np.testing.assert_allclose(pair.reference.positions, pair.estimate.positions, atol=1e-12)
    assert match(estimate, reference, 2.0).in_gap_count == 0


def test_reference_is_interpolated_at_the_estimate(line):
    pair = match(line(10.0), line(10.0).select(np.arange(0, 1001, 20)), 0.25)
    np.testing.assert_allclose(pair.reference.positions, line(10.0).positions, atol=1e-12)


def test_no_overlap_names_both_spans(line):
    late = line(1.0).restamped(line(1.0).stamps_ns + 100 * NS)
    with pytest.raises(EvaluationError, match=r"100\.000 to 110\.000 s.*0\.000 to 10\.000 s.*clock offset"):
        match(late, line(1.0), 0.25)


def test_ground_truth_sparser_than_the_limit_names_the_limit(line):
    with pytest.raises(EvaluationError, match=r"max_ground_truth_gap_s = 0\.25"):
        match(line(1.0).select(np.array([50, 150, 250])), line(1.0).select(np.arange(0, 1001, 100)), 0.25)


def test_coverage_counts_what_lies_between_close_poses(line):
    estimate = line(10.0)
    assert coverage(estimate, 0, 10 * NS, 0.5) == 1.0
    assert coverage(estimate, 0, 20 * NS, 0.5) == pytest.approx(0.5)
    assert coverage(estimate, -5 * NS, 5 * NS, 0.5) == pytest.approx(0.5)
    holed = estimate.select((estimate.stamps_ns <= 4 * NS) | (estimate.stamps_ns >= 6 * NS))
    assert coverage(holed, 0, 10 * NS, 0.5) == pytest.approx(0.8)
    assert coverage(holed, 0, 10 * NS, 2.5) == 1.0
    assert coverage(estimate, 3, 3, 0.5) is None
