# SPDX-License-Identifier: BSD-3-Clause
"""Simulated gaps of ground truth, as where motion capture loses its markers."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Annotated

import numpy as np
from pydantic import Field

from coclo_vio.runs.fault_kinds.fault_form import SPAN, Spans
from coclo_vio.values.config import StageConfig
from coclo_vio.values.errors import ConfigError
from coclo_vio.values.trajectory import GroundTruth


class TruthFaultsConfig(StageConfig):
    """What goes wrong with ground truth."""

    truth_gaps: Annotated[Spans, Field(description="START:SECONDS each: the ground truth has no pose")] = ()


def with_gaps(truth: GroundTruth, gaps: Sequence[str], first_ns: int) -> GroundTruth:
    """Ground truth without the poses in gaps.

    Args:
        truth: to cut.
        gaps: ``START:SECONDS`` each.
        first_ns: stamp of the recording's first measurement, from which time counts; that of the first pose counts
            where the ground truth has no stamps.

    Raises:
        ConfigError: no pose is left.
    """
    if not gaps:
        return truth
    stamps_ns = truth.trajectory.stamps_ns
    after_ns = stamps_ns - (first_ns if truth.has_stamps else stamps_ns[0])
    keep = np.ones(len(stamps_ns), dtype=np.bool_)
    for fault in SPAN.parsed(gaps):
        keep &= (after_ns < fault.span.start_ns) | (after_ns >= fault.span.end_ns)
    if not keep.any():
        raise ConfigError(f"faults.truth_gaps = {list(gaps)}: no pose of the ground truth is left; make them shorter")
    return replace(truth, trajectory=truth.trajectory.select(keep))
