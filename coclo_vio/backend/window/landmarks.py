# SPDX-License-Identifier: BSD-3-Clause
"""The landmarks of the window: their positions, and the keyframes that observe them."""

from collections.abc import Mapping, Sequence

import numpy as np
from scipy.spatial import cKDTree

from coclo_vio.backend.window.config import SmootherConfig
from coclo_vio.backend.window.disparity_offset import DisparityOffset
from coclo_vio.backend.window.landmark import Landmark
from coclo_vio.backend.window.observation_table import ObservationTable
from coclo_vio.backend.window.stereo_model import StereoModel
from coclo_vio.geometry import se3
from coclo_vio.values.arrays import Array, BoolArray, IntArray
from coclo_vio.values.calibration import RectifiedStereo
from coclo_vio.values.measurements import StereoTracks

_LEAST_PARALLAX_RAD = 0.02  # of rays that triangulate a point without any disparity
_NOTHING = np.zeros((3, 3))
_FARTHEST = 500.0  # baselines: farther points do not show translation


class LandmarkMap:
    """Landmarks by an identity of their own, and the landmark of each track."""

    def __init__(self, rig: RectifiedStereo, config: SmootherConfig, offset: DisparityOffset | None = None) -> None:
        self._rig, self._config = rig, config
        self._offset = offset or DisparityOffset(config.disparity_offset)
        self._by_id: dict[int, Landmark] = {}
        self._of_track: dict[int, int] = {}  # the landmark that a track observes at present
        self._next_id = 0
        noise = config.noise
        self._most_observations = np.inf if noise.walk_px == 0.0 else max(2.0, (noise.track_px / noise.walk_px) ** 2)
        self._largest_px = rig.focal_px[0] * rig.baseline_m / config.nearest_m

    def __len__(self) -> int:
        return len(self._by_id)

    def __getitem__(self, landmark_id: int) -> Landmark:
        return self._by_id[landmark_id]

    def matched(self, number: int) -> int:
        """How many landmarks both cameras of a keyframe observe."""
        observed = (each.observations.get(number) for each in self._by_id.values())
        return sum(each is not None and not np.isnan(each[2]) for each in observed)

    def point(self, landmark_id: int) -> Array:
        """Position of a placed landmark, m, world frame, (3,)."""
        point = self._by_id[landmark_id].point_world
        assert point is not None
        return point

    def items(self) -> list[tuple[int, Landmark]]:
        """All landmarks by identity, in the order of their creation."""
        return list(self._by_id.items())

    def observations(self, tracks: StereoTracks) -> Array:
        """Rows (N, 3) = left column, row, right column; NaN for a right column whose disparity is out of range."""
        right = tracks.right_px[:, 0] + self._offset.px
        disparity = tracks.left_px[:, 0] - right
        is_in_range = (disparity > self._config.min_disparity_px) & (disparity < self._largest_px)
        return np.column_stack((tracks.left_px, np.where(is_in_range, right, np.nan)))

    def known(self, tracks: StereoTracks) -> tuple[BoolArray, Array, Array]:
        """Which tracks (N,) have a placed landmark, positions of those, m, (M, 3), and their covariances (M, 3, 3)."""
        found = [self._landmark_of(each) for each in tracks.track_ids.tolist()]
        placed = [each for each in found if each is not None and each.point_world is not None]
        is_known = np.array([each is not None and each.point_world is not None for each in found], dtype=np.bool_)
        points = [each.point_world for each in placed if each.point_world is not None]
        covariances = [_NOTHING if each.covariance is None else each.covariance for each in placed]
        return is_known, _stacked(points, (3,)), _stacked(covariances, (3, 3))

    def observe(self, number: int, tracks: StereoTracks, is_wrong: BoolArray) -> None:
        """Add the observations of keyframe ``number``; tracks that are wrong (N,) are left out."""
        is_crowded = self._is_crowded(tracks, is_wrong)
        observations = self.observations(tracks)
        for track_id, observation, unused in zip(
            tracks.track_ids.tolist(), observations, is_wrong | is_crowded, strict=True
        ):
            landmark = self._landmark_of(track_id)
            if unused or (landmark is not None and landmark.is_retired):
                continue
            if landmark is not None:
                landmark.observe(number, observation)
                if len(landmark.observations) < self._most_observations:
                    continue
                landmark.is_retired = True  # its track may have drifted: from now on it observes another point
            self._add(track_id).observe(number, observation)

    def _landmark_of(self, track_id: int) -> Landmark | None:
        return self._by_id.get(self._of_track.get(track_id, -1))

    def _add(self, track_id: int) -> Landmark:
        landmark = self._by_id[self._next_id] = Landmark(track_id)
        self._of_track[track_id] = self._next_id
        self._next_id += 1
        return landmark

    def _is_crowded(self, tracks: StereoTracks, is_wrong: BoolArray) -> BoolArray:
        """New tracks (N,) too near to a known or an earlier one, whose errors they would repeat."""
        is_known = np.array([each in self._of_track for each in tracks.track_ids.tolist()], dtype=np.bool_)
        order = np.concatenate((np.flatnonzero(is_known & ~is_wrong), np.flatnonzero(~is_known)))
        near = cKDTree(tracks.left_px[order]).query_pairs(self._config.spacing_px, output_type="ndarray")
        is_crowded = np.zeros(len(tracks), dtype=np.bool_)
        for earlier, later in near[np.lexsort((near[:, 1], near[:, 0]))]:
            if not is_crowded[order[earlier]] and not is_known[order[later]]:
                is_crowded[order[later]] = True
        return is_crowded

    def place(self, poses: Mapping[int, Array]) -> None:
        """Place the landmarks that are not solved for: by the first disparity, or by triangulation.

        Args:
            poses: ``T_world_body`` by the number of the keyframe.
        """
        by_disparity, by_rays = [], {}
        for landmark_id, landmark in self._by_id.items():
            if landmark.is_solvable or not landmark.observations:
                continue
            if landmark.depth_keyframe in landmark.observations:
                by_disparity.append(landmark)
            elif len(landmark.observations) > 1:
                by_rays[landmark_id] = landmark
        if by_rays:
            self._triangulate(by_rays, poses)
        if by_disparity:
            self._place_by_disparity(by_disparity, poses)

    def _place_by_disparity(self, landmarks: Sequence[Landmark], poses: Mapping[int, Array]) -> None:
        numbers = [landmark.depth_keyframe for landmark in landmarks if landmark.depth_keyframe is not None]
        pixels = np.array([each.observations[number] for each, number in zip(landmarks, numbers, strict=True)])
        T_world_camera = {number: poses[number] @ self._rig.T_body_camera for number in set(numbers)}
        in_camera = self._rig.points(pixels[:, :2], pixels[:, 0] - pixels[:, 2])
        points = se3.apply(np.array([T_world_camera[number] for number in numbers]), in_camera)
        for landmark, point in zip(landmarks, points, strict=True):
            landmark.point_world = point

    def update_covariances(self, poses: Mapping[int, Array], model: StereoModel) -> None:
        """Covariance of each point, poses taken as known: of all its observations, and of one disparity.

        Args:
            poses: ``T_world_body`` by the number of the keyframe.
            model: of the camera and its noise.
        """
        placed = {
            name: each for name, each in self._by_id.items() if each.point_world is not None and each.observations
        }
        if not placed:
            return
        table = ObservationTable.of(placed, list(poses))
        depth = np.array([_depth_number(each) for each in placed.values()])
        has_disparity = depth[table.landmark] == np.array(table.numbers)[table.keyframe]
        points = _stacked([each.point_world for each in placed.values() if each.point_world is not None], (3,))
        covariances = model.point_covariances(points, table, np.array(list(poses.values())), has_disparity)
        for each, covariance in zip(placed.values(), covariances, strict=True):
            each.covariance = covariance

    def _triangulate(self, landmarks: Mapping[int, Landmark], poses: Mapping[int, Array]) -> None:
        """Place landmarks at the points nearest to their rays, where those are usable."""
        table = ObservationTable.of(landmarks, list(poses))
        T_world_camera, rays = self._rays(table, poses)
        points, depths = triangulated(table.starts, T_world_camera[:, :3, 3], rays)
        is_usable = (self._config.nearest_m < depths) & (depths < _FARTHEST * self._rig.baseline_m)
        for landmark, point, usable in zip(landmarks.values(), points, is_usable.tolist(), strict=True):
            landmark.point_world = point if usable else None

    def _rays(self, table: ObservationTable, poses: Mapping[int, Array]) -> tuple[Array, Array]:
        """Pose of the camera at each observation, (N, 4, 4), and the direction of its point, world, (N, 3)."""
        T_world_camera = (np.array(list(poses.values())) @ self._rig.T_body_camera)[table.keyframe]
        sides = (table.pixels[:, :2] - np.array(self._rig.principal_point_px)) / np.array(self._rig.focal_px)
        rays = np.einsum("nij,nj->ni", T_world_camera[:, :3, :3], np.column_stack((sides, np.ones(len(sides)))))
        rays /= np.sqrt(np.einsum("ni,ni->n", rays, rays))[:, None]
        return T_world_camera, rays

    def learn_offset(self, landmark_ids: Sequence[int], poses: Mapping[int, Array], track_px: float) -> None:
        """Learn the offset of disparities from landmarks that leave, each by its parallax in the window.

        Args:
            landmark_ids: of the landmarks.
            poses: ``T_world_body`` by the number of the keyframe.
            track_px: one sigma of a track, px.
        """
        leaving = {each: self._by_id[each] for each in landmark_ids}
        found = {each: one for each, one in leaving.items() if len(one.observations) > 2 and not one.is_retired}
        if not found:
            return
        table = ObservationTable.of(found, list(poses))
        T_world_camera, rays = self._rays(table, poses)
        points, _ = triangulated(table.starts, T_world_camera[:, :3, 3], rays)
        first, last = table.starts[:-1], table.starts[1:] - 1
        parallax = np.linalg.norm(np.cross(rays[first], rays[last]), axis=1)
        depths = se3.apply(se3.inverse(T_world_camera), points[table.landmark])[:, 2]
        disparities = table.pixels[:, 0] - table.pixels[:, 2]
        is_matched = ~np.isnan(disparities) & (depths > self._config.nearest_m)
        by_motion = self._rig.focal_px[0] * self._rig.baseline_m / np.where(is_matched, depths, np.inf)
        counts = np.add.reduceat(is_matched.astype(np.float64), first)
        is_used = (counts > 0.0) & (parallax > self._config.disparity_offset.least_parallax_rad)
        measured, moved = (
            np.add.reduceat(np.where(is_matched, each, 0.0), first)[is_used] / counts[is_used]
            for each in (disparities, by_motion)
        )
        self._offset.learn(measured, moved, moved * track_px / self._rig.focal_px[0] / parallax[is_used])

    def leaving(self, oldest: int, newest: int) -> tuple[list[int], list[int]]:
        """Landmarks of the oldest keyframe or the prior: those to eliminate with it, and those that the prior keeps."""
        lost: list[int] = []
        tracked: list[int] = []
        for landmark_id, landmark in self.items():
            is_observed = oldest in landmark.observations and landmark.is_solvable
            if not (is_observed or landmark.is_in_prior):
                continue
            is_tracked = newest in landmark.observations and not landmark.is_retired
            (tracked if is_tracked else lost).append(landmark_id)
        known = [each for each in tracked if self[each].is_in_prior]
        fresh = [each for each in tracked if _is_worth_keeping(self[each], oldest)]
        fresh.sort(key=lambda each: -len(self[each].observations))
        return lost, known + fresh[: max(0, self._config.most_kept_landmarks - len(known))]

    def remove(self, landmark_id: int) -> None:
        """Remove a landmark."""
        landmark = self._by_id.pop(landmark_id)
        if self._of_track.get(landmark.track_id) == landmark_id:
            del self._of_track[landmark.track_id]

    def remove_keyframe(self, number: int) -> None:
        """Remove the observations by a keyframe, and the landmarks without any other that are not in the prior."""
        for landmark_id, landmark in self.items():
            landmark.observations.pop(number, None)
            if not landmark.observations and not landmark.is_in_prior:
                self.remove(landmark_id)


def _stacked(arrays: Sequence[Array], shape: tuple[int, ...]) -> Array:
    """Arrays of one shape as one array: several times as fast as ``np.array`` of a list."""
    return np.concatenate(arrays).reshape(-1, *shape) if arrays else np.zeros((0, *shape))


def _depth_number(landmark: Landmark) -> int:
    """The keyframe whose disparity counts: the one that placed the landmark, or else the first; -1 without any."""
    if landmark.depth_keyframe is None:
        return -1
    return landmark.depth_keyframe if landmark.depth_keyframe in landmark.observations else min(landmark.observations)


def _is_worth_keeping(landmark: Landmark, oldest: int) -> bool:
    """Whether a landmark may enter the prior: a single observation has to place it."""
    return not landmark.is_in_prior and not np.isnan(landmark.observations[oldest][2])


def triangulated(starts: IntArray, centres: Array, rays: Array) -> tuple[Array, Array]:
    """Points nearest to all of their rays, and depths along the last one; NaN where rays are too parallel.

    A point p has ``sum over its rays of (I - r r^T) (p - c) = 0``.

    Args:
        starts: first ray of each point, and N, (P + 1,); at least two for each.
        centres: where the rays begin, m, (N, 3).
        rays: their directions, of length 1, (N, 3).

    Returns:
        Points (P, 3) and depths (P,), m.
    """
    first, last = starts[:-1], starts[1:] - 1
    sine = np.linalg.norm(np.cross(rays[first], rays[last]), axis=1)
    across = np.eye(3) - rays[:, :, None] * rays[:, None, :]
    left = np.add.reduceat(across, first)
    right = np.add.reduceat(np.einsum("nij,nj->ni", across, centres), first)
    left[sine < _LEAST_PARALLAX_RAD] = np.eye(3)  # parallel rays determine no point
    points = np.linalg.solve(left, right[:, :, None])[:, :, 0]
    depths = np.einsum("ni,ni->n", rays[last], points - centres[last])
    depths[sine < _LEAST_PARALLAX_RAD] = np.nan
    return points, depths
