# SPDX-License-Identifier: BSD-3-Clause
"""The window itself: keyframes, landmarks and a prior, solved together; the oldest keyframe is marginalised."""

from collections.abc import Iterator, Sequence

import gtsam
import numpy as np

from coclo_vio.backend.window import factors
from coclo_vio.backend.window.config import SmootherConfig
from coclo_vio.backend.window.factors import ObservationFactors, Term
from coclo_vio.backend.window.gauge import Gauge, tilt_prior, unobservable_directions
from coclo_vio.backend.window.indeterminate import IndeterminateError
from coclo_vio.backend.window.keyframe import Keyframe, Solution
from coclo_vio.backend.window.landmarks import LandmarkMap
from coclo_vio.backend.window.marginalisation import evidence_of_poses, marginal_prior, removing_terms
from coclo_vio.backend.window.observation_table import ObservationTable
from coclo_vio.backend.window.schur import SchurSolver, WindowMinimum, WindowProblem
from coclo_vio.backend.window.solver import minimise
from coclo_vio.backend.window.stereo_model import StereoModel
from coclo_vio.geometry.compiled import IS_COMPILED
from coclo_vio.values.arrays import Array, BoolArray
from coclo_vio.values.calibration import RectifiedStereo
from coclo_vio.values.units import NS_PER_S

_POSE = 6  # dimensions
_MOST_ATTEMPTS = 8  # at solving, each without the landmarks that the one before did not determine


class Window:
    """Keyframes and landmarks with their estimates.

    Invariant: ``values`` holds the poses (and velocities and biases, where the IMU is used) of all keyframes. The
    oldest one is fixed by the gauge, except for its tilt where gravity is measured: solving changes the poses relative
    to it, and no earlier estimate is moved as a whole. An anchored window has no gauge: a given start is its prior.
    """

    def __init__(self, rig: RectifiedStereo, config: SmootherConfig, *, is_anchored: bool = False) -> None:
        self._config = config
        self._is_anchored = is_anchored
        self._model = StereoModel(rig, config.noise)
        self._schur_solver = SchurSolver(rig, config.noise)
        self._observation_factors = ObservationFactors(rig, config.noise)
        self._cache: dict[tuple[int, int], Term] = {}  # observations by landmark and keyframe
        self.landmarks = LandmarkMap(rig, config)
        self.keyframes: list[Keyframe] = []
        self.values = gtsam.Values()
        self.prior: list[Term] = []
        self._gauge = Gauge()
        self._solved: frozenset[int] = frozenset()  # landmarks of the last solution
        self._next_covariance = np.zeros((6, 6))  # of the keyframe after the oldest one, relative to that

    @property
    def newest(self) -> Keyframe:
        """The last keyframe."""
        return self.keyframes[-1]

    @property
    def solved_landmarks(self) -> list[int]:
        """Landmarks of the last solution that are still solvable: their points are at the minimum."""
        return [each for each, landmark in self.landmarks.items() if each in self._solved and landmark.is_solvable]

    @property
    def last_speed_mps(self) -> float:
        """Mean speed of the body between the two newest keyframes."""
        if len(self.keyframes) < 2:
            return 0.0
        before, newest = self.keyframes[-2], self.newest
        path = self.pose(newest.number)[:3, 3] - self.pose(before.number)[:3, 3]
        return float(np.linalg.norm(path)) * NS_PER_S / (newest.stamp_ns - before.stamp_ns)

    def pose(self, number: int) -> Array:
        """``T_world_body`` of a keyframe, (4, 4)."""
        return np.asarray(self.values.atPose3(factors.pose_key(number)).matrix())

    def velocity(self, number: int) -> Array:
        """Velocity of a keyframe, m/s, world frame, (3,), where the IMU is used."""
        return np.asarray(self.values.atVector(factors.velocity_key(number)))

    def bias(self, number: int) -> gtsam.imuBias.ConstantBias:
        """Biases of a keyframe, where the IMU is used."""
        return self.values.atConstantBias(factors.bias_key(number))

    def set_inertial(self, number: int, velocity_world: Array, bias: gtsam.imuBias.ConstantBias) -> None:
        """First values of a keyframe's velocity and biases."""
        self.values.insert(factors.velocity_key(number), velocity_world)
        self.values.insert(factors.bias_key(number), bias)

    def add(self, keyframe: Keyframe, T_world_body: Array, is_wrong: BoolArray) -> None:
        """Add a keyframe at ``T_world_body``; tracks (N,) that are wrong are left out."""
        self.values.insert(factors.pose_key(keyframe.number), gtsam.Pose3(T_world_body))
        self.keyframes.append(keyframe)
        self.landmarks.observe(keyframe.number, keyframe.tracks, is_wrong)
        self._place()
        if len(self.keyframes) == 1:  # nothing to solve for, after which they would be updated
            self._update_covariances()

    def _place(self) -> None:
        self.landmarks.place({each.number: self.pose(each.number) for each in self.keyframes})

    def _update_covariances(self) -> None:
        self.landmarks.update_covariances({each.number: self.pose(each.number) for each in self.keyframes}, self._model)

    def solve(self) -> Solution:
        """Solve for all states and landmarks, and remove the observations that do not fit.

        Landmarks that are not determined are dropped, and the others solved for again.

        Raises:
            SmootherError: the keyframes are not determined, or the solution is not finite.
        """
        dropped = 0
        for _ in range(_MOST_ATTEMPTS):
            problem = self.problem([each for each, landmark in self.landmarks.items() if landmark.is_solvable])
            try:
                found = self._minimum(problem)
                break
            except IndeterminateError as error:
                if not error.points:
                    raise
                self._drop([each for each in problem.table.landmark_ids if factors.landmark_key(each) in error.points])
                dropped += len(error.points)
                last = error
        else:
            raise last
        landmark_ids, count = problem.table.landmark_ids, len(problem.terms) + len(problem.table)
        self._take(found, landmark_ids)
        self._solved = frozenset(landmark_ids)
        covariance = self._newest_covariance(found.covariance)
        rms = self._cull(problem.table, found.points)
        self._place()
        self._update_covariances()
        return Solution(found.iterations, count, len(landmark_ids), rms, covariance, dropped)

    def problem(
        self, landmark_ids: Sequence[int], without: Sequence[Term] = (), last: Sequence[int] = ()
    ) -> WindowProblem:
        """Everything that is solved for.

        Args:
            landmark_ids: the landmarks, all of them solvable.
            without: terms that are left out.
            last: keys of poses that are put at the end.
        """
        kept = [each for each in landmark_ids if self.landmarks[each].is_in_prior]
        ordered_ids = [each for each in landmark_ids if not self.landmarks[each].is_in_prior] + kept
        landmarks = {each: self.landmarks[each] for each in ordered_ids}
        values, keys = gtsam.Values(self.values), [factors.landmark_key(each) for each in kept]
        for key, each in zip(keys, kept, strict=True):
            values.insert(key, self.landmarks.point(each))
        numbers, left_out = [keyframe.number for keyframe in self.keyframes], {id(term) for term in without}
        keys += [key for number in numbers for key in self._keys_of(number) if key not in last]
        keys += last
        return WindowProblem(
            values=values,
            terms=[term for term in self._other_terms() if id(term) not in left_out],
            keys=keys,
            sizes=[factors.dimensions(key) for key in keys],
            pose_keys=[factors.pose_key(number) for number in numbers],
            table=ObservationTable.of(landmarks, numbers),
            points=np.array([self.landmarks.point(each) for each in landmarks]).reshape(-1, 3),
            kept=len(kept),
        )

    def evidence(self, numbers: Sequence[int], without: Sequence[Term] = ()) -> tuple[Array, Array]:
        """Information (6 N, 6 N) and vector (6 N,) of the poses of N keyframes, everything else eliminated.

        Args:
            numbers: of the keyframes.
            without: terms that are left out.

        Raises:
            SmootherError: landmarks or other variables are not determined.
        """
        landmark_ids = self.solved_landmarks  # others may be far from the minimum, where linearisation is worthless
        if IS_COMPILED:
            problem = self.problem(landmark_ids, without, [factors.pose_key(number) for number in numbers])
            found = self._schur_solver.run(problem).reduced(problem.values, problem.points, len(numbers))
            if found is not None:
                return found
        return self.evidence_by_gtsam(numbers, without)

    def evidence_by_gtsam(self, numbers: Sequence[int], without: Sequence[Term] = ()) -> tuple[Array, Array]:
        """The same by GTSAM's elimination."""
        landmark_ids, values = self.solved_landmarks, gtsam.Values(self.values)
        for landmark_id in landmark_ids:
            values.insert_or_assign(factors.landmark_key(landmark_id), self.landmarks.point(landmark_id))
        poses, left_out = [factors.pose_key(number) for number in numbers], {id(term) for term in without}
        terms = [term for term in self.terms(landmark_ids) if id(term) not in left_out]
        leaving = [key for key in self.elimination(landmark_ids) if key not in poses]
        return evidence_of_poses(terms, leaving, poses, values)

    def _minimum(self, problem: WindowProblem) -> WindowMinimum:
        """By our solver; by GTSAM's where that has none, or is not compiled."""
        last = sum(len(self._keys_of(keyframe.number)) for keyframe in self.keyframes[1:] or self.keyframes)
        most, tolerance = self._config.iterations, self._config.tolerance
        found = None
        if IS_COMPILED:
            found = self._schur_solver.minimise(problem, last, most_iterations=most, tolerance=tolerance)
        return found or self._minimum_by_gtsam(problem, last)

    def _minimum_by_gtsam(self, problem: WindowProblem, last: int) -> WindowMinimum:
        landmark_ids = problem.table.landmark_ids
        values, graph = gtsam.Values(self.values), gtsam.NonlinearFactorGraph()
        for landmark_id in landmark_ids:
            values.insert(factors.landmark_key(landmark_id), self.landmarks.point(landmark_id))
        for term in self.terms(sorted(landmark_ids)):
            graph.push_back(term.factor)
        found = minimise(
            graph,
            values,
            self.elimination(landmark_ids),
            last,
            most_iterations=self._config.iterations,
            tolerance=self._config.tolerance,
        )
        points = [found.values.atPoint3(factors.landmark_key(each)) for each in landmark_ids]
        return WindowMinimum(found.values, np.array(points).reshape(-1, 3), found.iterations, found.covariance)

    def _drop(self, landmark_ids: Sequence[int]) -> None:
        """Drop landmarks; of the prior, what it holds on the other variables is kept."""
        keys = [factors.landmark_key(each) for each in landmark_ids]
        touched = [term for term in self.prior if not set(keys).isdisjoint(term.keys)]
        if touched:
            values = gtsam.Values(self.values)
            for landmark_id, landmark in self.landmarks.items():
                if landmark.is_in_prior:
                    values.insert(factors.landmark_key(landmark_id), self.landmarks.point(landmark_id))
            in_prior = {key for term in touched for key in term.keys}
            untouched = [term for term in self.prior if term not in touched]
            self.prior = untouched + marginal_prior(touched, [key for key in keys if key in in_prior], values)
        for landmark_id in landmark_ids:
            self._forget(landmark_id)

    def _forget(self, landmark_id: int) -> None:
        for number in self.landmarks[landmark_id].observations:
            self._cache.pop((landmark_id, number), None)
        self.landmarks.remove(landmark_id)

    def _newest_covariance(self, covariance: Array) -> Array:
        """The newest keyframe's, from that of all but the oldest; that of the next oldest one is kept for the gauge."""
        size = _POSE if self._unobservable(self.newest.number).shape[1] == _POSE else 15
        self._next_covariance = covariance[size - _POSE : size, size - _POSE : size]
        return self._pose_first(covariance[-size:, -size:])

    def gauge_covariance(self, T_world_body: Array) -> Array:
        """Uncertainty of a pose from that of the fixed oldest keyframe in the world, right/local, (6, 6)."""
        return self._gauge.covariance_at(T_world_body, self.pose(self.keyframes[0].number))

    def _take(self, found: WindowMinimum, landmark_ids: Sequence[int]) -> None:
        for landmark_id, point in zip(landmark_ids, found.points, strict=True):
            key = factors.landmark_key(landmark_id)
            self.landmarks[landmark_id].point_world = point
            if found.values.exists(key):
                found.values.erase(key)
        self.values = found.values

    def terms(self, landmark_ids: Sequence[int]) -> Iterator[Term]:
        """All terms: of the prior, of the keyframes, and of the observations of these landmarks."""
        yield from self._other_terms()
        for landmark_id in landmark_ids:
            for number in self.landmarks[landmark_id].observations:
                yield self._observation_term(landmark_id, number)

    def _other_terms(self) -> Iterator[Term]:
        yield from self.prior
        if self._gauge.term is not None:
            yield self._gauge.term
        for keyframe in self.keyframes:
            yield from keyframe.terms
            yield from keyframe.rest_terms

    def _observation_term(self, landmark_id: int, number: int) -> Term:
        term = self._cache.get((landmark_id, number))
        if term is None:
            landmark = self.landmarks[landmark_id]
            is_first = landmark.depth_keyframe == number
            observation = landmark.observations[number]
            term = self._cache[landmark_id, number] = self._observation_factors.make(
                number, landmark_id, observation, is_first=is_first
            )
        return term

    def elimination(self, landmark_ids: Sequence[int]) -> list[int]:
        """Landmarks first, those of the prior after the others, then states, the newest last."""
        free_first = sorted(landmark_ids, key=lambda each: self.landmarks[each].is_in_prior)
        keys = [factors.landmark_key(landmark_id) for landmark_id in free_first]
        for keyframe in self.keyframes:
            keys += self._keys_of(keyframe.number)
        return keys

    def _keys_of(self, number: int) -> list[int]:
        keys = [factors.bias_key(number), factors.velocity_key(number), factors.pose_key(number)]
        return [key for key in keys if self.values.exists(key)]

    @staticmethod
    def _pose_first(covariance: Array) -> Array:
        """The covariance of [biases, velocity, pose] as that of [pose, velocity, biases]."""
        size = len(covariance)
        order = np.arange(size) if size == _POSE else np.r_[9:15, 6:9, 0:6]
        return np.asarray(covariance[np.ix_(order, order)])

    def _cull(self, table: ObservationTable, points_world: Array) -> float:
        """Remove observations that do not fit or are of points behind the camera; RMS residual of the others, px."""
        if not len(table):
            return 0.0
        T_world_body = np.array([self.pose(number) for number in table.numbers])[table.keyframe]
        points, observations = points_world[table.landmark], table.pixels
        is_wrong = self._model.residual_norms(T_world_body, points, observations) > self._config.noise.outlier
        for row in np.flatnonzero(is_wrong):
            landmark_id, number = table.landmark_ids[table.landmark[row]], table.numbers[table.keyframe[row]]
            del self.landmarks[landmark_id].observations[number]
            self._cache.pop((landmark_id, number), None)
            self.landmarks[landmark_id].is_retired |= number == self.newest.number
        residuals = (observations - self._model.project(T_world_body, points))[~is_wrong]
        return float(np.sqrt(np.nanmean(np.square(residuals)))) if len(residuals) else 0.0

    def drop_oldest(self) -> None:
        """Marginalise the oldest keyframe, and the landmarks of it and of the prior that are no longer tracked.

        Landmarks that are still tracked stay, with the past information on them in the prior; beyond
        ``most_kept_landmarks`` of them, the observations by the oldest keyframe are dropped.

        Raises:
            SmootherError: the variables that leave are not determined; nothing has changed then.
        """
        oldest = self.keyframes[0]
        lost, kept = self.landmarks.leaving(oldest.number, self.newest.number)
        leaving = [factors.landmark_key(each) for each in lost] + self._keys_of(oldest.number)
        touched, untouched = self._touched(set(leaving), oldest, lost, kept)
        values = gtsam.Values(self.values)
        for landmark_id in [*lost, *kept]:
            values.insert_or_assign(factors.landmark_key(landmark_id), self.landmarks.point(landmark_id))
        self.prior = untouched + marginal_prior(touched, leaving, values)
        if not self._is_anchored:
            following = self.keyframes[1].number
            key, free = factors.pose_key(following), self._unobservable(following)
            self.prior += removing_terms(self.prior, key, free, values)
            self._fix(following, self.gauge_covariance(self.pose(following)) + self._next_covariance)
        self._remove(oldest, lost)
        in_prior = {key for term in self.prior for key in term.keys}
        for landmark_id, landmark in self.landmarks.items():
            landmark.is_in_prior = factors.landmark_key(landmark_id) in in_prior

    def fix_first(self, covariance: Array) -> Array:
        """Fix the only keyframe where it is, except for its tilt where gravity is measured.

        Args:
            covariance: of its pose, (6, 6); that of the fixed directions goes to ``gauge_covariance``.

        Returns:
            The covariance of the directions that are not fixed, (6, 6).
        """
        number = self.keyframes[0].number
        if self._is_anchored:
            self.prior.append(factors.pose_prior(number, self.pose(number), covariance))
            return covariance
        self._fix(number, covariance)
        self.prior += self._tilt_prior(number, covariance)
        return np.asarray(covariance - self._gauge.covariance)

    def _fix(self, number: int, covariance: Array) -> None:
        self._gauge.fix(number, self.pose(number), self._unobservable(number), covariance)

    def _tilt_prior(self, number: int, covariance: Array) -> list[Term]:
        return tilt_prior(number, self.pose(number), self._unobservable(number), covariance)

    def _unobservable(self, number: int) -> Array:
        has_gravity = self.values.exists(factors.velocity_key(number))
        return unobservable_directions(self.pose(number), has_gravity=has_gravity)

    def _touched(
        self, leaving: set[int], oldest: Keyframe, lost: Sequence[int], kept: Sequence[int]
    ) -> tuple[list[Term], list[Term]]:
        """The terms with a variable that leaves, and those of the prior without one."""
        touched = [term for term in self.prior if leaving.intersection(term.keys)]
        untouched = [term for term in self.prior if not leaving.intersection(term.keys)]
        for keyframe in self.keyframes[:2]:
            own = [*keyframe.terms, *keyframe.rest_terms]
            touched += [term for term in own if leaving.intersection(term.keys)]
        for landmark_id in lost:
            touched += [
                self._observation_term(landmark_id, number) for number in self.landmarks[landmark_id].observations
            ]
        for landmark_id in kept:
            if oldest.number in self.landmarks[landmark_id].observations:
                touched.append(self._observation_term(landmark_id, oldest.number))
        return touched, untouched

    def _remove(self, oldest: Keyframe, lost: Sequence[int]) -> None:
        for key in self._keys_of(oldest.number):
            self.values.erase(key)
        for landmark_id in lost:
            self._forget(landmark_id)
        for landmark_id, _ in self.landmarks.items():
            self._cache.pop((landmark_id, oldest.number), None)
        self.landmarks.remove_keyframe(oldest.number)
        self.keyframes.pop(0)
        gone = factors.pose_key(oldest.number)
        following = self.keyframes[0]
        following.terms = [term for term in following.terms if gone not in term.keys]

    def discard_oldest(self, covariance: Array) -> None:
        """Drop the oldest keyframe without its information; the next one gets a prior of ``covariance`` (15, 15)."""
        oldest = self.keyframes[0]
        fixed = self.gauge_covariance(self.pose(self.keyframes[1].number))
        lost = [each for each, landmark in self.landmarks.items() if landmark.is_in_prior]
        self._remove(oldest, lost)
        number = self.keyframes[0].number
        if self._is_anchored:
            self.prior = [factors.pose_prior(number, self.pose(number), covariance[:6, :6])]
            return
        self._fix(number, fixed + covariance[:6, :6])
        self.prior = self._tilt_prior(number, covariance[:6, :6])
        if self.values.exists(factors.velocity_key(number)):
            sigma = float(np.sqrt(np.trace(covariance[6:9, 6:9])))
            self.prior.append(factors.velocity_prior(number, self.velocity(number), sigma))
            bias = self.bias(number).vector()
            self.prior.append(factors.bias_prior(number, bias[:3], bias[3:], np.repeat([0.05, 0.002], 3)))
