# SPDX-License-Identifier: BSD-3-Clause
"""Landmarks and poses that the factors do not determine: which they are, and the little information they need.

GTSAM does not eliminate a variable if, once its other dimensions are eliminated, one of them keeps less than
``2^-24`` of its information: a standard deviation 4,096 times as large. So a landmark far away without a disparity, at
the epipole of the motion, or behind the cameras stops the elimination of the whole window; and so does a pose whose
rotation is measured by far points and whose place by next to nothing.
"""

import re
from collections.abc import Sequence

import gtsam
import numpy as np

from coclo_vio.backend.window.factors import landmark_id, ordered
from coclo_vio.backend.window.variables import POSE
from coclo_vio.values.arrays import Array
from coclo_vio.values.errors import SmootherError

_LEAST_SHARE = 2.0**-24  # of a variable's information, in each direction: GTSAM's limit
_ADDED_SHARE = 2.0**-20  # in every direction: well above the limit, and next to nothing
_LEAST_INFORMATION = 1e-6  # 1/m^2: of a point without any
_ROUNDING = 1e-15  # of a pose's largest information: less in another direction is none
_POSE_SHARE = 2.0**-22  # of a pose's largest information: above the limit, and far below any measurement
_NAMED_VARIABLE = re.compile(r"near variable\s+(\d+)")


class IndeterminateError(SmootherError):
    """A linear system that cannot be eliminated.

    Attributes:
        points: keys of the landmarks that are not determined; empty where it is a keyframe that is not.
        pose: key of the pose at which the elimination stopped although there is information on all of it; None where
            there is not, or where it was another variable.
        pose_information: that makes it solvable, in each direction, 1/rad^2 and 1/m^2.
    """

    def __init__(
        self, message: str, points: Sequence[int], pose: int | None = None, pose_information: float = 0.0
    ) -> None:
        super().__init__(message)
        self.points, self.pose, self.pose_information = tuple(points), pose, pose_information


def indeterminate(message: str, linear: gtsam.GaussianFactorGraph, keys: Sequence[int], error: Exception) -> Exception:
    """The error of a system that GTSAM did not eliminate.

    Args:
        message: what was to be solved.
        linear: the factors, linearised.
        keys: of all variables.
        error: of GTSAM's elimination.
    """
    points = indeterminate_points(linear, [key for key in keys if landmark_id(key) is not None], error)
    named = _named_key(error)
    if named is None or chr(gtsam.Symbol(named).chr()) != POSE.letter:
        return IndeterminateError(message, points)
    information = np.asarray(linear.hessian(ordered([named]))[0])[: POSE.dimensions, : POSE.dimensions]
    axes = np.linalg.eigvalsh(information)
    if not axes[0] > _ROUNDING * axes[-1]:
        return IndeterminateError(message, points)
    return IndeterminateError(message, points, named, _POSE_SHARE * float(axes[-1]))


def indeterminate_points(
    linear: gtsam.GaussianFactorGraph, points: Sequence[int], error: Exception | None = None
) -> list[int]:
    """The points without information in some direction, all other variables taken as known.

    Args:
        linear: the factors, linearised; each point has some.
        points: keys of variables of three dimensions.
        error: of GTSAM's elimination: the variable that it names belongs to the result if it is one of the points.
    """
    named = None if error is None else _named_key(error)
    return [
        key
        for key, information in zip(points, _information(linear, points), strict=True)
        if key == named or not _is_determined(information)
    ]


def supports(linear: gtsam.GaussianFactorGraph, points: Sequence[int]) -> list[gtsam.JacobianFactor]:
    """A factor on each point that makes it solvable: 2^-20 of its information, in every direction, about its value."""
    unit = gtsam.noiseModel.Unit.Create(3)
    return [
        gtsam.JacobianFactor(key, np.sqrt(_supporting(information)) * np.eye(3), np.zeros(3), unit)
        for key, information in zip(points, _information(linear, points), strict=True)
    ]


def _supporting(information: Array) -> float:
    return max(_LEAST_INFORMATION, _ADDED_SHARE * float(np.trace(information)))


def _information(linear: gtsam.GaussianFactorGraph, points: Sequence[int]) -> Array:
    """Information of each point, all other variables taken as known, (N, 3, 3)."""
    size = 3 * len(points)
    whole = np.asarray(linear.hessian(ordered(points))[0])[:size, :size]  # the other variables follow these
    rows = np.arange(size).reshape(-1, 3)
    return np.asarray(whole[rows[:, :, None], rows[:, None, :]])


def _is_determined(information: Array) -> bool:
    if not np.isfinite(information).all():
        return False
    axes = np.linalg.eigvalsh(information)
    return bool(axes[0] > _LEAST_SHARE * axes[-1])


def _named_key(error: Exception) -> int | None:
    """The variable at which GTSAM's elimination stopped, as its message names it."""
    named = _NAMED_VARIABLE.search(str(error))
    return None if named is None else int(named.group(1))
