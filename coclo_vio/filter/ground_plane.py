# SPDX-License-Identifier: BSD-3-Clause
"""The normal of the ground under each rolling foot, by the footholds themselves.

A spherical foot rolls about its point of contact, which lies below its centre by the radius along the ground's normal.
On a slope that is not the vertical: taken for it, the height of a climb is short by the radius times the rotation of
the foot link times the sine of the slope, half a per cent of the way and more for feet of 20 mm on 16 degrees. The
slope is that of a plane through the last footholds next to the foot. Where they do not lie in a plane, as on stairs,
the foot is taken to stand on level ground.
"""

from collections import deque

import numpy as np

from coclo_vio.filter.config import GroundConfig
from coclo_vio.geometry.array_types import Array, BoolArray, IntArray

UP = np.array([0.0, 0.0, 1.0])
_KEPT = 3  # footholds of each leg
_NEAREST = 9  # footholds of a plane
_LEAST_FREEDOM = 3.0  # a fit of fewer degrees of freedom shows nothing of planes
_SLOPE_SIGMA = 0.5  # prior of the slope in either direction
_MOST_MISFIT = 4.0  # of the squared residuals to their expectation, from which footholds are in no plane


class GroundPlane:
    """Keeps the last footholds of each leg and the normals of the ground there.

    Args:
        legs: their number.
        config: how even the plane is and how well legs measure it; the default if None.

    Attributes:
        normals: upward unit vector at each foot, world, (n, 3): the vertical until footholds lie in a plane.
    """

    def __init__(self, legs: int, config: GroundConfig | None = None) -> None:
        self._config = config or GroundConfig()
        self.normals = np.tile(UP, (legs, 1))
        self._footholds: list[deque[Array]] = [deque(maxlen=_KEPT) for _ in range(legs)]
        self._stood_s, self._feet = [0.0] * legs, np.zeros((legs, 3))

    def clear(self) -> None:
        """Forget all footholds: the ground is level again."""
        self.normals = np.tile(UP, (len(self._footholds), 1))
        self._stood_s = [0.0] * len(self._stood_s)
        for each in self._footholds:
            each.clear()

    def push(self, feet: Array, is_stance: BoolArray, dt_s: float) -> None:
        """Take the feet at a sample; a foot that lifts off leaves a foothold.

        Args:
            feet: centres of the feet, world, m, (n, 3).
            is_stance: legs that stand and were used, (n,).
            dt_s: time since the sample before, s.
        """
        has_left = False
        for leg, stands in enumerate(is_stance.tolist()):
            if stands:
                self._stood_s[leg] += dt_s
                self._feet[leg] = feet[leg]
                continue
            if self._stood_s[leg] >= self._config.least_stance_s:
                self._footholds[leg].append(self._feet[leg].copy())
                has_left = True
            self._stood_s[leg] = 0.0
        if has_left:
            self.normals = self._fitted_normals()

    def _fitted_normals(self) -> Array:
        """The normal at the last foothold of each leg; vertical where a leg has none."""
        legs = np.repeat(np.arange(len(self._footholds)), [len(each) for each in self._footholds])
        points = np.array([point for each in self._footholds for point in each])
        normals = np.tile(UP, (len(self._footholds), 1))
        for leg, own in enumerate(self._footholds):
            if own:
                nearest = np.argsort(np.linalg.norm(points - own[-1], axis=1), kind="stable")[:_NEAREST]
                normals[leg] = _normal(points[nearest], legs[nearest], self._config)
        return normals


def _normal(points: Array, legs: IntArray, config: GroundConfig) -> Array:
    """The normal (3,) of a plane through footholds, turned to the vertical as far as they depart from the plane."""
    slope, misfit, freedom = _plane(points - points.mean(axis=0), legs, config)
    if freedom < _LEAST_FREEDOM:
        return UP
    share = min(max((_MOST_MISFIT - misfit) / (_MOST_MISFIT - 1.0), 0.0), 1.0)
    normal = np.array([-share * slope[0], -share * slope[1], 1.0])
    return np.asarray(normal / np.linalg.norm(normal))


def _plane(points: Array, legs: IntArray, config: GroundConfig) -> tuple[Array, float, float]:
    """A plane through footholds, with an offset of height for each leg, whose kinematics are not exact.

    Args:
        points: footholds about their mean, m, (N, 3).
        legs: of each, (N,).
        config: sigmas.

    Returns:
        Slopes along the world's x and y, (2,), the squared residuals over their expectation, its degrees of freedom.
    """
    count = int(legs.max()) + 1
    design = np.concatenate((points[:, :2], np.ones((len(points), 1)), np.eye(count)[legs]), axis=1)
    sigmas = np.concatenate(([_SLOPE_SIGMA, _SLOPE_SIGMA, 1.0], np.full(count, config.leg_height_sigma_m)))
    rows = design / config.evenness_m
    gain = np.linalg.solve(rows.T @ rows + np.diag(sigmas**-2), rows.T)
    heights = points[:, 2] / config.evenness_m
    solution = gain @ heights
    freedom = len(points) - float(np.trace(rows @ gain))
    misfit = float(np.sum((heights - rows @ solution) ** 2)) / max(freedom, 1e-9)
    return solution[:2], misfit, freedom
