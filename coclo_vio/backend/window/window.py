# SPDX-License-Identifier: BSD-3-Clause
"""The window itself: keyframes, landmarks and a prior, solved together; the oldest keyframe leaves as information."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

import gtsam
import numpy as np

from coclo_vio.backend.window import factors
from coclo_vio.backend.window.config import SmootherConfig
from coclo_vio.backend.window.factors import SightingFactors, Term
from coclo_vio.backend.window.landmarks import Landmark, LandmarkMap
from coclo_vio.backend.window.localisation import PixelModel
from coclo_vio.backend.window.marginalisation import marginal_prior, relative_to
from coclo_vio.backend.window.solver import minimise
from coclo_vio.geometry import se3
from coclo_vio.values.arrays import Array, BoolArray
from coclo_vio.values.calibration import RectifiedStereo
from coclo_vio.values.measurements import StereoTracks
from coclo_vio.values.units import NS_PER_S

_POSE = 6  # dimensions
_HELD = 1e-4  # rad and m, one sigma: where the oldest keyframe is held
_NOT_HELD = 100.0  # rad, one sigma of its tilt where gravity tells it


@dataclass(slots=True, eq=False)
class Keyframe:
    """A frame of the window.

    Attributes:
        number: counts up; its keys are made of it.
        stamp_ns: its time, ns.
        tracks: what was seen.
        terms: what ties it to the keyframe before it, and what is known of it alone.
        rest_terms: what a standstill says of it.
    """

    number: int
    stamp_ns: int
    tracks: StereoTracks
    terms: list[Term] = field(default_factory=list)
    rest_terms: list[Term] = field(default_factory=list)


@dataclass(frozen=True, slots=True)
class Solution:
    """How solving went.

    Attributes:
        iterations: of the solver.
        factors: in the problem.
        landmarks: in the problem.
        reprojection_px: root mean square of what is left of the sightings, px.
        covariance: of the newest pose relative to the oldest one's place and heading, and of velocity and biases
            (accelerometer, gyroscope) where the IMU is used, (6, 6) or (15, 15).
    """

    iterations: int
    factors: int
    landmarks: int
    reprojection_px: float
    covariance: Array


class Window:
    """Keyframes and landmarks with their estimates.

    Invariant: ``values`` holds the poses (and velocities and biases, where the IMU is used) of all keyframes. The
    oldest one is held where it is, but for its tilt where gravity is felt: solving changes what is known relative to
    it, and no estimate that has gone out before is moved as a whole.
    """

    def __init__(self, rig: RectifiedStereo, config: SmootherConfig, *, is_anchored: bool = False) -> None:
        self._config = config
        self._is_anchored = is_anchored
        self._pixels = PixelModel(rig, config.noise)
        self._sightings = SightingFactors(rig, config.noise)
        self._cache: dict[tuple[int, int], Term] = {}  # factors of sightings by landmark and keyframe
        self.landmarks = LandmarkMap(rig, config)
        self.keyframes: list[Keyframe] = []
        self.values = gtsam.Values()
        self.prior: list[Term] = []
        self._pin: Term | None = None  # holds the oldest keyframe; no knowledge, so it leaves with that keyframe
        self._solved: frozenset[int] = frozenset()  # landmarks of the last solution
        self._held_covariance = np.zeros((6, 6))  # of where the oldest keyframe is held, right/local
        self._next_covariance = np.zeros((6, 6))  # of the one after it, relative to that

    @property
    def newest(self) -> Keyframe:
        """The last keyframe."""
        return self.keyframes[-1]

    @property
    def solved_landmarks(self) -> list[int]:
        """Landmarks that were solved for and still are to be: their points are where everything fits best."""
        return [each for each, landmark in self.landmarks.items() if each in self._solved and landmark.is_solvable]

    @property
    def last_speed_mps(self) -> float:
        """How fast the body moved between the two newest keyframes."""
        if len(self.keyframes) < 2:
            return 0.0
        before, newest = self.keyframes[-2], self.newest
        way = self.pose(newest.number)[:3, 3] - self.pose(before.number)[:3, 3]
        return float(np.linalg.norm(way)) * NS_PER_S / (newest.stamp_ns - before.stamp_ns)

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
        """Take a keyframe in at ``T_world_body``; sightings (N,) that are wrong are left out."""
        self.values.insert(factors.pose_key(keyframe.number), gtsam.Pose3(T_world_body))
        self.keyframes.append(keyframe)
        self.landmarks.observe(keyframe.number, keyframe.tracks, is_wrong)
        self._place()

    def _place(self) -> None:
        poses = {each.number: self.pose(each.number) for each in self.keyframes}
        self.landmarks.place(poses)
        self.landmarks.judge(poses, self._pixels)

    def solve(self) -> Solution:
        """Move everything to where it fits best, and remove the sightings that do not fit.

        Raises:
            SmootherError: the problem is not determined, or its solution is not finite.
        """
        seen = [landmark_id for landmark_id, landmark in self.landmarks.items() if landmark.is_solvable]
        terms = [*self.terms(seen)]
        values = gtsam.Values(self.values)
        for landmark_id in seen:
            values.insert(factors.landmark_key(landmark_id), self.landmarks.point(landmark_id))
        graph = gtsam.NonlinearFactorGraph()
        for term in terms:
            graph.push_back(term.factor)
        elimination = self.elimination(seen)
        staying = [key for keyframe in self.keyframes[1:] or self.keyframes for key in self._keys_of(keyframe.number)]
        found = minimise(
            graph,
            values,
            elimination,
            len(staying),
            most_iterations=self._config.iterations,
            tolerance=self._config.tolerance,
        )
        self._take(found.values, seen)
        self._solved = frozenset(seen)
        covariance = self._newest_covariance(found.covariance)
        rms = self._cull()
        self._place()
        return Solution(found.iterations, len(terms), len(seen), rms, covariance)

    def _newest_covariance(self, covariance: Array) -> Array:
        """The newest keyframe's, from that of all but the oldest; what will be held next is noted on the way."""
        size = _POSE if self._unmeasured(self.newest.number).shape[1] == _POSE else 15
        self._next_covariance = covariance[size - _POSE : size, size - _POSE : size]
        return self._pose_first(covariance[-size:, -size:])

    def world_covariance(self, T_world_body: Array) -> Array:
        """What a pose is uncertain by since nobody knows where the oldest keyframe is, right/local, (6, 6)."""
        moved = se3.adjoint(se3.inverse(T_world_body) @ self.pose(self.keyframes[0].number))
        return np.asarray(moved @ self._held_covariance @ moved.T)

    def _take(self, solved: gtsam.Values, landmark_ids: Sequence[int]) -> None:
        for landmark_id in landmark_ids:
            key = factors.landmark_key(landmark_id)
            self.landmarks[landmark_id].point_world = np.asarray(solved.atPoint3(key))
            solved.erase(key)
        self.values = solved

    def terms(self, landmark_ids: Sequence[int]) -> Iterator[Term]:
        """Everything that is known: of keyframes, of these landmarks, of what has left."""
        yield from self.prior
        if self._pin is not None:
            yield self._pin
        for keyframe in self.keyframes:
            yield from keyframe.terms
            yield from keyframe.rest_terms
        for landmark_id in landmark_ids:
            for number in self.landmarks[landmark_id].sightings:
                yield self._sighting(landmark_id, number)

    def _sighting(self, landmark_id: int, number: int) -> Term:
        term = self._cache.get((landmark_id, number))
        if term is None:
            landmark = self.landmarks[landmark_id]
            is_first = landmark.placed_by == number
            sighting = landmark.sightings[number]
            term = self._cache[landmark_id, number] = self._sightings.make(
                number, landmark_id, sighting, is_first=is_first
            )
        return term

    def elimination(self, landmark_ids: Sequence[int]) -> list[int]:
        """Landmarks first, those that the prior ties together after the free ones, then states, the newest last."""
        by_freedom = sorted(landmark_ids, key=lambda each: self.landmarks[each].is_in_prior)
        keys = [factors.landmark_key(landmark_id) for landmark_id in by_freedom]
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

    def _cull(self) -> float:
        """Remove sightings that do not fit or are of points behind the camera; the rest's RMS residual, px."""
        rows = [
            (landmark_id, number)
            for landmark_id, landmark in self.landmarks.items()
            if landmark.is_solvable
            for number in landmark.sightings
        ]
        if not rows:
            return 0.0
        poses = {keyframe.number: self.pose(keyframe.number) for keyframe in self.keyframes}
        T_world_body = np.array([poses[number] for _, number in rows])
        points = np.array([self.landmarks.point(landmark_id) for landmark_id, _ in rows])
        sightings = np.array([self.landmarks[landmark_id].sightings[number] for landmark_id, number in rows])
        is_wrong = self._pixels.misfit(T_world_body, points, sightings) > self._config.noise.outlier
        for index in np.flatnonzero(is_wrong):
            landmark_id, number = rows[index]
            del self.landmarks[landmark_id].sightings[number]
            self._cache.pop((landmark_id, number), None)
            self.landmarks[landmark_id].is_retired |= number == self.newest.number
        residuals = (sightings - self._pixels.seen(T_world_body, points))[~is_wrong]
        return float(np.sqrt(np.nanmean(np.square(residuals)))) if len(residuals) else 0.0

    def drop_oldest(self) -> None:
        """Marginalise the oldest keyframe, and the landmarks that it and the prior know and that are lost from sight.

        Landmarks that are still seen stay, with what the past says of them in the prior; beyond
        ``most_kept_landmarks`` of them the others forget what the oldest keyframe saw.

        Raises:
            SmootherError: what leaves is not determined; nothing has changed then.
        """
        oldest = self.keyframes[0]
        lost, kept = self._lost_and_kept(oldest.number)
        leaving = [factors.landmark_key(each) for each in lost] + self._keys_of(oldest.number)
        touched, untouched = self._touched(set(leaving), oldest, lost, kept)
        values = gtsam.Values(self.values)
        for landmark_id in [*lost, *kept]:
            values.insert_or_assign(factors.landmark_key(landmark_id), self.landmarks.point(landmark_id))
        self.prior = untouched + marginal_prior(touched, leaving, values)
        if not self._is_anchored:
            following = self.keyframes[1].number
            key, free = factors.pose_key(following), self._unmeasured(following)
            self.prior += relative_to(self.prior, key, free, values)
            self._hold(following, self.world_covariance(self.pose(following)) + self._next_covariance)
        self._forget(oldest, lost)
        in_prior = {key for term in self.prior for key in term.keys}
        for landmark_id, landmark in self.landmarks.items():
            landmark.is_in_prior = factors.landmark_key(landmark_id) in in_prior

    def hold_first(self, covariance: Array) -> Array:
        """Hold the only keyframe where it is, but for its tilt where gravity is felt.

        Args:
            covariance: of its pose, (6, 6); what is held of it goes to ``world_covariance``.

        Returns:
            The covariance of what is not held, (6, 6).
        """
        number = self.keyframes[0].number
        if self._is_anchored:
            self.prior.append(factors.pose_prior(number, self.pose(number), covariance))
            return covariance
        self._hold(number, covariance)
        self.prior += self._tilt_prior(number, covariance)
        return np.asarray(covariance - self._held_covariance)

    def _hold(self, number: int, covariance: Array) -> None:
        free = self._unmeasured(number)
        across = free @ free.T
        self._held_covariance = across @ covariance @ across
        noise = _HELD**2 * across + _NOT_HELD**2 * (np.eye(_POSE) - across)
        self._pin = factors.pose_prior(number, self.pose(number), noise)

    def _tilt_prior(self, number: int, covariance: Array) -> list[Term]:
        """What is known of a keyframe's tilt, where gravity is felt."""
        free = self._unmeasured(number)
        if free.shape[1] == _POSE:
            return []
        across = free @ free.T
        tilt = np.eye(_POSE) - across
        return [factors.pose_prior(number, self.pose(number), tilt @ covariance @ tilt + _NOT_HELD**2 * across)]

    def _unmeasured(self, number: int) -> Array:
        """The directions, columns of a pose's tangent space, in which nothing says where the world is, (6, 6 or 4)."""
        if not self.values.exists(factors.velocity_key(number)):
            return np.eye(6)
        free = np.zeros((6, 4))
        free[:3, 0] = self.pose(number)[2, :3]
        free[3:, 1:] = np.eye(3)
        return free

    def _lost_and_kept(self, oldest: int) -> tuple[list[int], list[int]]:
        """Landmarks that the oldest keyframe or the prior know: those to eliminate, and those that the prior keeps."""
        lost: list[int] = []
        alive: list[int] = []
        for landmark_id, landmark in self.landmarks.items():
            is_seen_here = oldest in landmark.sightings and landmark.is_solvable
            if not (is_seen_here or landmark.is_in_prior):
                continue
            is_alive = self.newest.number in landmark.sightings and not landmark.is_retired
            (alive if is_alive else lost).append(landmark_id)
        known = [each for each in alive if self.landmarks[each].is_in_prior]
        fresh = [each for each in alive if self._is_worth_keeping(self.landmarks[each], oldest)]
        fresh.sort(key=lambda each: -len(self.landmarks[each].sightings))
        return lost, known + fresh[: max(0, self._config.most_kept_landmarks - len(known))]

    @staticmethod
    def _is_worth_keeping(landmark: Landmark, oldest: int) -> bool:
        """Whether the prior may know a landmark: one sighting alone has to place it."""
        return not landmark.is_in_prior and not np.isnan(landmark.sightings[oldest][2])

    def _touched(
        self, leaving: set[int], oldest: Keyframe, lost: Sequence[int], kept: Sequence[int]
    ) -> tuple[list[Term], list[Term]]:
        """The terms that touch what leaves, and those of the prior that do not."""
        touched = [term for term in self.prior if leaving.intersection(term.keys)]
        untouched = [term for term in self.prior if not leaving.intersection(term.keys)]
        for keyframe in self.keyframes[:2]:
            tied = [*keyframe.terms, *keyframe.rest_terms]
            touched += [term for term in tied if leaving.intersection(term.keys)]
        for landmark_id in lost:
            touched += [self._sighting(landmark_id, number) for number in self.landmarks[landmark_id].sightings]
        for landmark_id in kept:
            if oldest.number in self.landmarks[landmark_id].sightings:
                touched.append(self._sighting(landmark_id, oldest.number))
        return touched, untouched

    def _forget(self, oldest: Keyframe, lost: Sequence[int]) -> None:
        for key in self._keys_of(oldest.number):
            self.values.erase(key)
        for landmark_id in lost:
            for number in self.landmarks[landmark_id].sightings:
                self._cache.pop((landmark_id, number), None)
            self.landmarks.forget(landmark_id)
        for landmark_id, _ in self.landmarks.items():
            self._cache.pop((landmark_id, oldest.number), None)
        self.landmarks.forget_keyframe(oldest.number)
        self.keyframes.pop(0)
        gone = factors.pose_key(oldest.number)
        following = self.keyframes[0]
        following.terms = [term for term in following.terms if gone not in term.keys]

    def discard_oldest(self, covariance: Array) -> None:
        """Let the oldest keyframe go without its information; the next one gets a prior of ``covariance`` (15, 15)."""
        oldest = self.keyframes[0]
        held = self.world_covariance(self.pose(self.keyframes[1].number))
        lost = [each for each, landmark in self.landmarks.items() if landmark.is_in_prior]
        self._forget(oldest, lost)
        number = self.keyframes[0].number
        if self._is_anchored:
            self.prior = [factors.pose_prior(number, self.pose(number), covariance[:6, :6])]
            return
        self._hold(number, held + covariance[:6, :6])
        self.prior = self._tilt_prior(number, covariance[:6, :6])
        if self.values.exists(factors.velocity_key(number)):
            sigma = float(np.sqrt(np.trace(covariance[6:9, 6:9])))
            self.prior.append(factors.velocity_prior(number, self.velocity(number), sigma))
            bias = self.bias(number).vector()
            self.prior.append(factors.bias_prior(number, bias[:3], bias[3:], np.repeat([0.05, 0.002], 3)))
