# SPDX-License-Identifier: BSD-3-Clause
"""Gauss-Newton for the window with its landmarks eliminated one by one: the steps of ``solver.minimise``, faster.

Observations are linearised by compiled kernels, every other factor by GTSAM. Landmarks that no other factor contains
are eliminated by Schur's complement (Triggs et al., "Bundle adjustment - a modern synthesis", 2000, section 6); the
rest is solved densely. Whatever is not plain, such as a system that GTSAM would not eliminate or a step that does not
lower the cost, is left to GTSAM: there is no solution then.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import gtsam
import numpy as np
from scipy.linalg.lapack import dpotrf, dpotrs, dtrtrs

from coclo_vio.backend.window.config import PixelNoiseConfig
from coclo_vio.backend.window.factors import Term, landmark_key, ordered
from coclo_vio.backend.window.observation_table import ObservationTable
from coclo_vio.backend.window.pixel_noise import PixelNoise
from coclo_vio.backend.window.reprojection_kernels import reprojection_cost
from coclo_vio.backend.window.schur_kernels import back_substituted, is_determined, linearise
from coclo_vio.backend.window.solver import LENGTHS, is_lower
from coclo_vio.geometry import se3
from coclo_vio.values.arrays import Array
from coclo_vio.values.calibration import RectifiedStereo

_POINT = 3  # dimensions


@dataclass(frozen=True, slots=True, eq=False)
class WindowProblem:
    """What is solved for, and what measures it.

    Attributes:
        values: of the keyframes' variables, and of the points that other terms than observations contain.
        terms: those other terms.
        keys: of ``values``, such points first, then the keyframes' variables, those last that a result is about.
        sizes: dimensions of each key.
        pose_keys: of the keyframes, in the order of the table's numbers.
        table: observations; its landmarks are first those in no other term, then those of ``keys``, in their order.
        points: of all landmarks of the table, m, world frame, (P, 3).
        kept: how many of the landmarks, the last ones, are in ``keys``.
    """

    values: gtsam.Values
    terms: Sequence[Term]
    keys: Sequence[int]
    sizes: Sequence[int]
    pose_keys: Sequence[int]
    table: ObservationTable
    points: Array
    kept: int

    @property
    def elimination(self) -> list[int]:
        """Keys of all variables: landmarks that no other term contains first, then ``keys``."""
        free = self.table.landmark_ids[: len(self.points) - self.kept]
        return [*(landmark_key(each) for each in free), *self.keys]

    def all_values(self) -> gtsam.Values:
        """Of all variables."""
        values = gtsam.Values(self.values)
        for landmark_id, point in zip(self.table.landmark_ids, self.points, strict=True):
            values.insert_or_assign(landmark_key(landmark_id), point)
        return values


@dataclass(frozen=True, slots=True, eq=False)
class WindowMinimum:
    """The minimum of the cost.

    Attributes:
        values: as those of the problem.
        points: as those of the problem.
        iterations: linear systems solved.
        covariances: of the groups of keys that were asked for.
    """

    values: gtsam.Values
    points: Array
    iterations: int
    covariances: Sequence[Array]


class SchurSolver:
    """Solves windows of one camera rig."""

    def __init__(self, rig: RectifiedStereo, noise: PixelNoiseConfig | PixelNoise) -> None:
        self._optics = np.array([*rig.focal_px, *rig.principal_point_px, rig.baseline_m])
        self._T_camera_body = np.ascontiguousarray(se3.inverse(rig.T_body_camera))
        self._noise = noise

    def minimise(
        self, problem: WindowProblem, groups: Sequence[Sequence[int]], *, most_iterations: int, tolerance: float
    ) -> WindowMinimum | None:
        """The least cost near the problem's values, by the rules of ``solver.minimise``; None: GTSAM has to solve it.

        Args:
            problem: what is solved for.
            groups: of keys that follow each other in the problem, whose covariances are returned.
            most_iterations: the result after so many is returned, converged or not.
            tolerance: relative to the cost.
        """
        run = self.run(problem)
        values, points = problem.values, problem.points
        cost = run.cost(values, points)
        for iteration in range(1, most_iterations + 1):
            step = run.step(values, points)
            if step is None:
                return None
            length, values, points, proposed_cost = run.shortened(values, points, cost, step)
            if length == 0.0:
                return None
            is_settled = length == 1.0 and abs(cost - proposed_cost - step.predicted) <= tolerance * proposed_cost
            cost = proposed_cost
            if is_settled or iteration == most_iterations:
                covariances = [run.covariance(step.root, group) for group in groups]
                return WindowMinimum(values, points, iteration, covariances)
        return None

    def run(self, problem: WindowProblem) -> "Iterations":
        """The iterations of one problem."""
        return Iterations(problem, self._optics, self._T_camera_body, self._noise)


@dataclass(frozen=True, slots=True, eq=False)
class Step:
    """A solved linear system: steps of keys (D,) and points (P, 3), the predicted decrease, and the root (D, D)."""

    keys: Array
    points: Array
    predicted: float
    root: Array


class Iterations:
    """One problem with the arrays that its iterations share."""

    def __init__(
        self, problem: WindowProblem, optics: Array, T_camera_body: Array, noise: PixelNoiseConfig | PixelNoise
    ) -> None:
        self._problem, self._camera = problem, (T_camera_body, optics, noise.huber)
        table = problem.table
        sigmas = np.full((len(table), 2), noise.track_px)
        sigmas[:, 1] = np.where(table.is_first, noise.disparity_px, noise.repeated_disparity_px)
        self._observed = (table.landmark, table.keyframe, table.pixels, sigmas)
        self._blocks = np.concatenate((np.zeros(1, dtype=np.int64), np.cumsum(problem.sizes, dtype=np.int64)))
        self._first_row = dict(zip(problem.keys, self._blocks.tolist(), strict=False))
        poses = np.array([self._first_row[key] for key in problem.pose_keys], dtype=np.int64)
        self._free = len(problem.points) - problem.kept
        own = np.maximum(_POINT * (np.arange(len(problem.points)) - self._free), 0)
        self._offsets = (poses[table.keyframe], own)
        self._ordering = ordered(problem.keys)
        self._graph = gtsam.NonlinearFactorGraph()
        for term in problem.terms:
            self._graph.push_back(term.factor)
        measured = {key for term in problem.terms for key in term.keys}
        sizes = zip(problem.keys, problem.sizes, strict=True)
        self._unmeasured = [_nothing(key, size) for key, size in sizes if key not in measured]

    def cost(self, values: gtsam.Values, points: Array) -> float:
        """The cost of all terms and observations."""
        observed = reprojection_cost(points, self._observed, self._poses(values), self._camera)
        return float(self._graph.error(values)) + observed

    def step(self, values: gtsam.Values, points: Array) -> Step | None:
        """The step of Gauss and Newton; None where GTSAM would call a variable indeterminate."""
        system = self._system(values, points)
        if system is None:
            return None
        information, vector, free = system
        upper, failure = dpotrf(information.T, lower=0, clean=0, overwrite_a=1)
        root = upper.T
        if failure or not is_determined(root, self._blocks):
            return None
        keys, starts = dpotrs(upper, vector, lower=0)[0], self._problem.table.starts
        moved = np.empty((len(points), 3))
        back_substituted(*free, starts, self._offsets[0], keys, moved[: self._free])
        moved[self._free :] = keys[: _POINT * self._problem.kept].reshape(-1, 3)
        predicted = 0.5 * float(vector @ keys + np.sum(np.square(free[1])))
        return Step(keys, moved, predicted, root) if np.isfinite(predicted) else None

    def covariance(self, root: Array, group: Sequence[int]) -> Array:
        """Covariance of keys that follow each other, from Cholesky's root of everything that is not eliminated, (D, D).

        Of information L L^T it is Y^T Y, with L Y = those columns of the unit matrix.
        """
        begin, index = self._first_row[group[0]], self._problem.keys.index(group[-1])
        size = int(self._blocks[index + 1]) - begin
        unit = np.zeros((len(root) - begin, size))
        unit[:size] = np.eye(size)
        columns = dtrtrs(root[begin:, begin:].T, unit, lower=0, trans=1)[0]
        return np.asarray(columns.T @ columns)

    def reduced(self, values: gtsam.Values, points: Array, last: int) -> tuple[Array, Array] | None:
        """Information (M, M) and vector (M,) of the ``last`` keys once everything else is eliminated.

        Directions of those keys may hold no information. None where GTSAM would call another variable indeterminate.
        """
        system = self._system(values, points)
        if system is None:
            return None
        information, vector, _ = system
        first = int(self._blocks[-1 - last])
        own = np.tril(information[first:, first:])
        own += np.tril(own, -1).T
        if first == 0:
            return own, vector
        upper, failure = dpotrf(information[:first, :first].T, lower=0, clean=0)
        if failure or not is_determined(upper.T, self._blocks[:-last]):
            return None
        cross = np.column_stack((information[first:, :first].T, vector[:first]))
        gain = dtrtrs(upper, cross, lower=0, trans=1)[0]
        return own - gain[:, :-1].T @ gain[:, :-1], vector[first:] - gain[:, :-1].T @ gain[:, -1]

    def _system(self, values: gtsam.Values, points: Array) -> tuple[Array, Array, tuple[Array, Array, Array]] | None:
        """Information, lower triangle, and vector of all keys, and what ``back_substituted`` needs of the points."""
        linear = self._graph.linearize(values)
        for factor in self._unmeasured:
            linear.push_back(factor)
        information, vector = (np.ascontiguousarray(each) for each in linear.hessian(self._ordering))
        free = np.empty((self._free, 3, 3)), np.empty((self._free, 3)), np.empty((len(self._observed[0]), 3, 6))
        starts, system, poses = self._problem.table.starts, (information, vector), self._poses(values)
        is_solvable = linearise(points, self._observed, poses, self._camera, starts, self._offsets, system, free)
        return (information, vector, free) if is_solvable else None

    def shortened(
        self, values: gtsam.Values, points: Array, cost: float, step: Step
    ) -> tuple[float, gtsam.Values, Array, float]:
        """The longest share of a step that does not raise the cost, with values, points and cost there; 0 if none."""
        for length in LENGTHS:
            moved = gtsam.VectorValues()
            for key, begin, end in zip(self._problem.keys, self._blocks, self._blocks[1:], strict=False):
                moved.insert(key, length * step.keys[begin:end])
            proposed, proposed_points = values.retract(moved), points + length * step.points
            proposed_cost = self.cost(proposed, proposed_points)
            if is_lower(proposed_cost, cost):
                return length, proposed, proposed_points, proposed_cost
        return 0.0, values, points, cost

    def _poses(self, values: gtsam.Values) -> Array:
        """``T_body_world`` of the keyframes, (K, 4, 4)."""
        T_world_body = np.array([values.atPose3(key).matrix() for key in self._problem.pose_keys])
        return np.ascontiguousarray(se3.inverse(T_world_body))


def _nothing(key: int, size: int) -> gtsam.JacobianFactor:
    """A factor without information on a variable that only observations measure."""
    return gtsam.JacobianFactor(key, np.zeros((size, size)), np.zeros(size), gtsam.noiseModel.Unit.Create(size))
