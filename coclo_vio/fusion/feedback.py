# SPDX-License-Identifier: BSD-3-Clause
"""Feedback policies: what filter and window exchange at a keyframe, and how double counting is avoided.

A policy is a class with the two methods of ``FeedbackPolicy``, registered under a name that ``bridge.feedback`` can
take. Four come along; ``docs/bridge.md`` derives and compares them.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Protocol

from coclo_vio.fusion.information import end_evidence, evidence_beyond, intersection_weight, pair_evidence
from coclo_vio.values.errors import ConfigError
from coclo_vio.values.keyframes import KeyframeResult, PoseEvidence, PoseMarginal, PosePair


@dataclass(frozen=True, slots=True, eq=False)
class Feedback:
    """What the filter gets from the window at a keyframe.

    Attributes:
        evidence: of the keyframe before and of this one.
        inflation: factor on the filter's own sigmas of rotation and positions, before the gate decides on the evidence.
        fallback: all that the window knows of this keyframe: taken instead of the evidence where the filter has
            rejected the window so often that it widens to accept it; None for the evidence itself.
    """

    evidence: PoseEvidence
    inflation: float = 1.0
    fallback: PoseEvidence | None = None


class FeedbackPolicy(Protocol):
    """What filter and window exchange at a keyframe."""

    def evidence_for_window(self, pair: PosePair, known: PoseMarginal | None) -> PoseEvidence | None:
        """What the window gets besides the relative motion; None for the relative motion alone.

        Args:
            pair: the filter's poses of the last keyframe and of this frame.
            known: what both knew of the last keyframe.

        Raises:
            SmootherError: it cannot be worked out; the relative motion alone is used then.
        """

    def feedback_for_filter(self, pair: PosePair, known: PoseMarginal, result: KeyframeResult) -> Feedback | None:
        """What the filter gets once the window is solved; None for nothing.

        Args:
            pair: the filter's poses of the last keyframe and of this one.
            known: what the window knew of the last keyframe.
            result: what the window knows now; asked for only where it has evidence.

        Raises:
            SmootherError: it cannot be worked out; the filter gets nothing then.
        """


@dataclass(frozen=True, slots=True)
class PolicyParameters:
    """What the configuration gives to a policy.

    Attributes:
        min_novel_share: share of a marginal below which information does not count as novel.
        floor_m: smallest sigma of the filter's motion between keyframes, m and rad.
    """

    min_novel_share: float = 1e-4
    floor_m: float = 1e-4


class NoFeedback:
    """The window uses the filter's motion; the filter gets nothing."""

    def __init__(self, parameters: PolicyParameters) -> None:
        """Take parameters, of which none is used."""

    def evidence_for_window(self, pair: PosePair, known: PoseMarginal | None) -> PoseEvidence | None:
        """Nothing."""
        return None

    def feedback_for_filter(self, pair: PosePair, known: PoseMarginal, result: KeyframeResult) -> Feedback | None:
        """Nothing."""
        return None


class PaperFeedback(NoFeedback):
    """The smoothed pose updates the filter as if it were independent (paper, section IV); overconfident."""

    def feedback_for_filter(self, pair: PosePair, known: PoseMarginal, result: KeyframeResult) -> Feedback | None:
        """The marginal of the keyframe."""
        return Feedback(end_evidence(pair, result.marginal))


class CovarianceIntersection(NoFeedback):
    """The smoothed pose and the filter's are combined by covariance intersection; never overconfident."""

    def feedback_for_filter(self, pair: PosePair, known: PoseMarginal, result: KeyframeResult) -> Feedback | None:
        """A share of the marginal's information; the filter gives up the other share of its own."""
        weight = intersection_weight(pair.covariance[6:, 6:], result.marginal.covariance)
        return Feedback(end_evidence(pair, result.marginal, 1.0 - weight), float(weight**-0.5))


class DecorrelatedFeedback:
    """Each gets what the other knows beyond the common knowledge of the last keyframe; nothing is counted twice."""

    def __init__(self, parameters: PolicyParameters) -> None:
        """Take parameters."""
        self._parameters = parameters

    def evidence_for_window(self, pair: PosePair, known: PoseMarginal | None) -> PoseEvidence | None:
        """The filter's information of both keyframes without the common knowledge of the last one."""
        return pair_evidence(pair, known, self._parameters.min_novel_share, self._parameters.floor_m)

    def feedback_for_filter(self, pair: PosePair, known: PoseMarginal, result: KeyframeResult) -> Feedback | None:
        """The window's evidence of both keyframes without the common knowledge of the last one."""
        if result.evidence is None:
            return None
        novel = evidence_beyond(result.evidence, known, self._parameters.min_novel_share)
        return Feedback(novel, fallback=end_evidence(pair, result.marginal))


PolicyFactory = Callable[[PolicyParameters], FeedbackPolicy]


@dataclass(frozen=True, slots=True)
class _Registered:
    """A policy that configurations can name."""

    make: PolicyFactory
    description: str


_REGISTERED: dict[str, _Registered] = {}


def register_feedback_policy(name: str, make: PolicyFactory, description: str) -> None:
    """Make a policy available as ``bridge.feedback``.

    Args:
        name: of the policy.
        make: a fresh one from parameters; the class itself where its ``__init__`` takes them.
        description: in one line.

    Raises:
        ConfigError: the name is taken.
    """
    if name in _REGISTERED:
        raise ConfigError(f"there is a feedback policy {name!r} already; register yours under another name")
    _REGISTERED[name] = _Registered(make, description)


def unregister_feedback_policy(name: str) -> None:
    """Forget a policy, if there is one of this name."""
    _REGISTERED.pop(name, None)


def feedback_policies() -> Mapping[str, str]:
    """The descriptions of all policies by name."""
    return MappingProxyType({name: one.description for name, one in _REGISTERED.items()})


def make_feedback_policy(name: str, parameters: PolicyParameters) -> FeedbackPolicy:
    """A fresh policy.

    Raises:
        ConfigError: no policy has this name; lists those there are.
    """
    registered = _REGISTERED.get(name)
    if registered is None:
        raise ConfigError(f"bridge.feedback = {name!r} is no feedback policy; there are: {', '.join(_REGISTERED)}")
    return registered.make(parameters)


register_feedback_policy("off", NoFeedback, "nothing")
register_feedback_policy("paper", PaperFeedback, "the smoothed pose as if it were independent (section IV)")
register_feedback_policy("ci", CovarianceIntersection, "covariance intersection")
register_feedback_policy(
    "decorrelated", DecorrelatedFeedback, "what vision knows beyond what filter and window both know"
)
