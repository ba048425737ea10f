# SPDX-License-Identifier: BSD-3-Clause
"""The window itself: keyframes, landmarks and a prior, solved together; the oldest keyframe is marginalised."""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import gtsam
import numpy as np

from coclo_vio.backend.window import factors
from coclo_vio.backend.window.config import SmootherConfig
from coclo_vio.backend.window.disparity_offset import DisparityOffset
from coclo_vio.backend.window.factors import Term
from coclo_vio.backend.window.gauge import Gauge, HeldGauge
from coclo_vio.backend.window.indeterminate import IndeterminateError
from coclo_vio.backend.window.keyframe import Keyframe, Solution
from coclo_vio.backend.window.landmarks import LandmarkMap
from coclo_vio.backend.window.marginalisation import marginal_prior
from coclo_vio.backend.window.observation_table import ObservationTable
from coclo_vio.backend.window.pixel_noise import PixelNoise
from coclo_vio.backend.window.schur import WindowMinimum, WindowProblem
from coclo_vio.backend.window.stereo_model import StereoModel
from coclo_vio.backend.window.variables import POSE, VELOCITY, KeyframeVariables, Variable
from coclo_vio.backend.window.window_solver import WindowSolver
from coclo_vio.values.arrays import Array, BoolArray
from coclo_vio.values.calibration import RectifiedStereo
from coclo_vio.values.units import NS_PER_S

_MOST_ATTEMPTS = 8  # at solving, each without the landmarks that the one before did not determine


class Window:
    """Keyframes and landmarks with their estimates.

    Invariant: ``values`` holds all registered variables of all keyframes. Solving changes the poses relative to the
    directions that the gauge holds, and no earlier estimate is moved as a whole.
    """

    def __init__(
        self,
        rig: RectifiedStereo,
        config: SmootherConfig,
        variables: KeyframeVariables | None = None,
        gauge: Gauge | None = None,
        noise: PixelNoise | None = None,
        offset: DisparityOffset | None = None,
    ) -> None:
        """An empty window.

        Args:
            rig: the cameras.
            config: of the smoother.
            variables: of each keyframe; None: its pose alone.
            gauge: what becomes of directions that nothing measures; None: the oldest keyframe is held.
            noise: of tracks and disparities, which learns from this window; None: its own, from the configuration.
            offset: of all disparities, likewise.
        """
        self._config = config
        self.variables = variables or KeyframeVariables()
        self._gauge = gauge or HeldGauge()
        self._noise = noise or PixelNoise(config.noise)
        self._model = StereoModel(rig, self._noise)
        self.solver = WindowSolver(rig, config, self._noise)
        self.landmarks = LandmarkMap(rig, config, offset)
        self.keyframes: list[Keyframe] = []
        self.values = gtsam.Values()
        self.prior: list[Term] = []
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
        """Velocity of a keyframe, m/s, world frame, (3,), where that is a variable."""
        return np.asarray(VELOCITY.value(self.values, number))

    def add(
        self,
        keyframe: Keyframe,
        T_world_body: Array,
        is_wrong: BoolArray,
        values: Mapping[Variable, Any] | None = None,
    ) -> None:
        """Add a keyframe.

        Args:
            keyframe: its factors may still be completed before solving.
            T_world_body: first value of its pose, (4, 4).
            is_wrong: tracks that are left out, (N,).
            values: first values of its other variables.
        """
        self.values.insert(factors.pose_key(keyframe.number), gtsam.Pose3(T_world_body))
        for variable, value in (values or {}).items():
            self.values.insert(variable.key(keyframe.number), value)
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

        Landmarks that are not determined are dropped, and the others solved for again; a pose that is not gets a weak
        prior where it is.

        Raises:
            SmootherError: the keyframes are not determined, or the solution is not finite.
        """
        dropped, supported, following = 0, 0, (self.keyframes[1:] or self.keyframes)[0]
        groups = (self.variables.keys(self.newest.number), [factors.pose_key(following.number)])
        for _ in range(_MOST_ATTEMPTS):
            problem = self.problem([each for each, landmark in self.landmarks.items() if landmark.is_solvable])
            try:
                found = self.solver.minimum(problem, groups)
                break
            except IndeterminateError as error:
                if not error.points and not self._support(error):
                    raise
                self._drop([each for each in problem.table.landmark_ids if factors.landmark_key(each) in error.points])
                dropped += len(error.points)
                supported += not error.points
                failure = error
        else:
            raise failure
        landmark_ids, count = problem.table.landmark_ids, len(problem.terms) + len(problem.table)
        self._take(found, landmark_ids)
        self._solved = frozenset(landmark_ids)
        covariance, self._next_covariance = self.variables.as_registered(found.covariances[0]), found.covariances[1]
        rms = self._cull(problem.table, found.points)
        self._place()
        self._update_covariances()
        return Solution(found.iterations, count, len(landmark_ids), rms, covariance, dropped, supported)

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
        keys += [key for number in numbers for key in self.variables.keys(number) if key not in last]
        keys += last
        return WindowProblem(
            values=values,
            terms=[term for term in self._other_terms() if id(term) not in left_out],
            keys=keys,
            sizes=[self.variables.dimensions(key) for key in keys],
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
        poses = [factors.pose_key(number) for number in numbers]
        problem = self.problem(self.solved_landmarks, without, poses)  # others may be far from the minimum
        return self.solver.evidence(problem, len(poses))

    def _support(self, error: IndeterminateError) -> bool:
        """Give the pose that is not determined a weak prior; whether there is one that has none yet."""
        for keyframe in self.keyframes:
            if factors.pose_key(keyframe.number) == error.pose and not keyframe.is_supported:
                covariance = np.eye(POSE.dimensions) / error.pose_information
                keyframe.terms.append(factors.pose_prior(keyframe.number, self.pose(keyframe.number), covariance))
                keyframe.is_supported = True
                return True
        return False

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
            self.solver.observations.forget(number, landmark_id)
        self.landmarks.remove(landmark_id)

    def gauge_covariance(self, T_world_body: Array) -> Array:
        """Uncertainty of a pose from that of the held oldest keyframe in the world, right/local, (6, 6)."""
        return self._gauge.covariance_at(T_world_body, self.pose(self.keyframes[0].number))

    def _take(self, found: WindowMinimum, landmark_ids: Sequence[int]) -> None:
        for landmark_id, point in zip(landmark_ids, found.points, strict=True):
            key = factors.landmark_key(landmark_id)
            self.landmarks[landmark_id].point_world = point
            if found.values.exists(key):
                found.values.erase(key)
        self.values = found.values

    def _other_terms(self) -> Iterator[Term]:
        yield from self.prior
        if self._gauge.term is not None:
            yield self._gauge.term
        for keyframe in self.keyframes:
            yield from keyframe.terms
            yield from keyframe.rest_terms

    def _observation_term(self, landmark_id: int, number: int) -> Term:
        landmark = self.landmarks[landmark_id]
        is_first = landmark.depth_keyframe == number
        observation = landmark.observations[number]
        return self.solver.observations.term(landmark_id, number, observation, is_first=is_first)

    def _cull(self, table: ObservationTable, points_world: Array) -> float:
        """Remove observations that do not fit or are of points behind the camera; RMS residual of the others, px."""
        if not len(table):
            return 0.0
        T_world_body = np.array([self.pose(number) for number in table.numbers])[table.keyframe]
        points, observations = points_world[table.landmark], table.pixels
        residuals = observations - self._model.project(T_world_body, points)
        is_wrong = self._model.residual_norms(residuals) > self._config.noise.outlier
        for row in np.flatnonzero(is_wrong):
            landmark_id, number = table.landmark_ids[table.landmark[row]], table.numbers[table.keyframe[row]]
            del self.landmarks[landmark_id].observations[number]
            self.solver.observations.forget(number, landmark_id)
            self.landmarks[landmark_id].is_retired |= number == self.newest.number
        self._noise.learn(residuals, len(points_world))
        self._noise.count(self.landmarks.matched(self.newest.number))
        residuals = residuals[~is_wrong]
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
        leaving = [factors.landmark_key(each) for each in lost] + self.variables.keys(oldest.number)
        touched, untouched = self._touched(set(leaving), oldest, lost, kept)
        values = gtsam.Values(self.values)
        for landmark_id in [*lost, *kept]:
            values.insert_or_assign(factors.landmark_key(landmark_id), self.landmarks.point(landmark_id))
        self.prior = untouched + marginal_prior(touched, leaving, values)
        following = self.keyframes[1].number
        pose = self.pose(following)
        covariance = self.gauge_covariance(pose) + self._next_covariance
        self.prior += self._gauge.pass_on(following, pose, covariance, self.prior, values)
        poses = {each.number: self.pose(each.number) for each in self.keyframes}
        self.landmarks.learn_offset(lost, poses, self._config.noise.track_px * self._noise.shown)
        self._remove(oldest, lost)
        in_prior = {key for term in self.prior for key in term.keys}
        for landmark_id, landmark in self.landmarks.items():
            landmark.is_in_prior = factors.landmark_key(landmark_id) in in_prior

    def fix_first(self, covariance: Array) -> Array:
        """Fix the only keyframe in the world, as the gauge does.

        Args:
            covariance: of its pose, (6, 6); that of held directions goes to ``gauge_covariance``.

        Returns:
            The covariance of the directions that are not held, (6, 6).
        """
        number = self.keyframes[0].number
        prior, free = self._gauge.begin(number, self.pose(number), covariance)
        self.prior += prior
        return free

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
        for key in self.variables.keys(oldest.number):
            self.values.erase(key)
        for landmark_id in lost:
            self._forget(landmark_id)
        self.solver.observations.forget(oldest.number)
        self.landmarks.remove_keyframe(oldest.number)
        self.keyframes.pop(0)
        gone, following = set(self.variables.keys(oldest.number)), self.keyframes[0]
        following.terms = [term for term in following.terms if gone.isdisjoint(term.keys)]

    def discard_oldest(self, covariance: Array, priors: Sequence[Term]) -> None:
        """Drop the oldest keyframe without its information.

        Args:
            covariance: of the pose of the next keyframe, which gets a prior, (6, 6).
            priors: on the other variables of that keyframe.
        """
        oldest = self.keyframes[0]
        held = self.gauge_covariance(self.pose(self.keyframes[1].number))
        self._remove(oldest, [each for each, landmark in self.landmarks.items() if landmark.is_in_prior])
        number = self.keyframes[0].number
        self.prior = [*self._gauge.replace(number, self.pose(number), held, covariance), *priors]
