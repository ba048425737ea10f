# SPDX-License-Identifier: BSD-3-Clause
"""Solves what a window holds: by Schur's complement where that is compiled and suffices, otherwise by GTSAM."""

from collections.abc import Iterator, Sequence

import gtsam
import numpy as np

from coclo_vio.backend.window.config import SmootherConfig
from coclo_vio.backend.window.factors import ObservationFactors, Term, landmark_key
from coclo_vio.backend.window.marginalisation import evidence_of_poses
from coclo_vio.backend.window.pixel_noise import PixelNoise
from coclo_vio.backend.window.schur import SchurSolver, WindowMinimum, WindowProblem
from coclo_vio.backend.window.solver import minimise
from coclo_vio.geometry.compiled import IS_COMPILED
from coclo_vio.values.arrays import Array
from coclo_vio.values.calibration import RectifiedStereo


class WindowSolver:
    """Solves the problems of one window.

    Attributes:
        schur: the solver by Schur's complement.
        observations: makes the factors for GTSAM.
    """

    def __init__(self, rig: RectifiedStereo, config: SmootherConfig, noise: PixelNoise) -> None:
        self._config = config
        self.schur = SchurSolver(rig, noise)
        self.observations = ObservationFactors(rig, noise)

    def minimum(self, problem: WindowProblem, groups: Sequence[Sequence[int]]) -> WindowMinimum:
        """The least cost near the problem's values, and the covariances of groups of keys that follow each other.

        Raises:
            IndeterminateError: the factors do not determine the variables.
            SmootherError: there is no finite minimum.
        """
        most, tolerance = self._config.iterations, self._config.tolerance
        found = None
        if IS_COMPILED:
            found = self.schur.minimise(problem, groups, most_iterations=most, tolerance=tolerance)
        return found or self.minimum_by_gtsam(problem, groups)

    def minimum_by_gtsam(self, problem: WindowProblem, groups: Sequence[Sequence[int]]) -> WindowMinimum:
        """The same by GTSAM."""
        first = min(problem.keys.index(group[0]) for group in groups)
        found = minimise(
            self.graph(problem),
            problem.all_values(),
            problem.elimination,
            len(problem.keys) - first,
            most_iterations=self._config.iterations,
            tolerance=self._config.tolerance,
        )
        points = [found.values.atPoint3(landmark_key(each)) for each in problem.table.landmark_ids]
        ends = np.concatenate(([0], np.cumsum(problem.sizes[first:])))
        covariances = []
        for group in groups:
            begin, end = (problem.keys.index(key) - first for key in (group[0], group[-1]))
            rows = slice(ends[begin], ends[end + 1])
            covariances.append(found.covariance[rows, rows])
        return WindowMinimum(found.values, np.array(points).reshape(-1, 3), found.iterations, covariances)

    def evidence(self, problem: WindowProblem, last: int) -> tuple[Array, Array]:
        """Information (6 N, 6 N) and vector (6 N,) of the N ``last`` keys, all poses, everything else eliminated.

        Raises:
            SmootherError: landmarks or other variables are not determined.
        """
        found = None
        if IS_COMPILED:
            found = self.schur.run(problem).reduced(problem.values, problem.points, last)
        return found or self.evidence_by_gtsam(problem, last)

    def evidence_by_gtsam(self, problem: WindowProblem, last: int) -> tuple[Array, Array]:
        """The same by GTSAM."""
        leaving, poses = problem.elimination[:-last], problem.elimination[-last:]
        return evidence_of_poses(self.terms(problem), leaving, poses, problem.all_values())

    def terms(self, problem: WindowProblem) -> Iterator[Term]:
        """All terms of a problem, those of its observations last, landmark by landmark as they were created."""
        yield from problem.terms
        table = problem.table
        for index in np.argsort(np.array(table.landmark_ids, dtype=np.int64), kind="stable").tolist():
            for row in range(table.starts[index], table.starts[index + 1]):
                number = table.numbers[table.keyframe[row]]
                yield self.observations.term(
                    table.landmark_ids[index], number, table.pixels[row], is_first=bool(table.is_first[row])
                )

    def graph(self, problem: WindowProblem) -> gtsam.NonlinearFactorGraph:
        """All terms as GTSAM's graph."""
        graph = gtsam.NonlinearFactorGraph()
        for term in self.terms(problem):
            graph.push_back(term.factor)
        return graph
