# SPDX-License-Identifier: BSD-3-Clause
"""A feedback policy: the paper's, its covariance inflated as the same landmarks are evidence at many keyframes."""

import coclo_vio as cv
from coclo_vio.fusion.feedback import PolicyParameters
from coclo_vio.fusion.information import end_evidence
from coclo_vio.values.keyframes import KeyframeResult, PoseMarginal, PosePair

KEYFRAMES = 10.0  # over so many of them the evidence of one landmark is counted again


class InflatedFeedback:
    """The smoothed pose updates the filter with ``KEYFRAMES`` times the covariance that the window claims."""

    def __init__(self, parameters: PolicyParameters) -> None:
        self._floor_m = parameters.floor_m

    def evidence_for_window(self, pair: PosePair, known: PoseMarginal | None) -> None:
        """Nothing: the relative motion alone ties the keyframes."""

    def feedback_for_filter(self, pair: PosePair, known: PoseMarginal, result: KeyframeResult) -> cv.Feedback:
        """A share of the information of the new keyframe's marginal."""
        return cv.Feedback(end_evidence(pair, result.marginal, share=1.0 / KEYFRAMES))


cv.register_feedback_policy(
    "inflated", InflatedFeedback, f"the paper's feedback with {KEYFRAMES:.0f} times its covariance"
)
