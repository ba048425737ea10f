# SPDX-License-Identifier: BSD-3-Clause
"""The points that the window knows: where they are, and which keyframes saw them."""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from scipy.spatial import cKDTree

from coclo_vio.backend.window.config import SmootherConfig
from coclo_vio.backend.window.localisation import PixelModel
from coclo_vio.geometry import se3
from coclo_vio.values.arrays import Array, BoolArray
from coclo_vio.values.calibration import RectifiedStereo
from coclo_vio.values.measurements import StereoTracks

_LEAST_PARALLAX_RAD = 0.02  # of rays that place a point without any disparity
_FAINT = 1e-6  # 1/m^2: a point is at most so badly known
_DIGITS = 1e-12  # relative to a matrix: what keeps it positive definite in floating point
_FARTHEST = 500.0  # baselines: farther points say nothing of translation


@dataclass(slots=True, eq=False)
class Landmark:
    """A point of the world.

    Attributes:
        track_id: the track that sees it.
        point_world: where it is, m, (3,); None until it can be placed.
        covariance: of the point, the poses that see it taken as known, m^2, (3, 3); None until it has a place.
        sightings: by the number of the keyframe: left column, row, right column (NaN: not seen there), px, (3,).
        placed_by: the keyframe whose disparity counts; None as long as there is none.
        is_in_prior: whether the marginal prior knows of it.
        is_retired: whether it was found wrong: it takes no more sightings and leaves at the next occasion.
    """

    track_id: int
    point_world: Array | None = None
    covariance: Array | None = None
    sightings: dict[int, Array] = field(default_factory=dict)
    placed_by: int | None = None
    is_in_prior: bool = False
    is_retired: bool = False

    @property
    def is_solvable(self) -> bool:
        """Whether it ties keyframes together: it has a place, and more than one keyframe or the prior knows it."""
        return self.is_in_prior or (self.point_world is not None and len(self.sightings) > 1)

    def observe(self, number: int, sighting: Array) -> None:
        """Take what keyframe ``number`` sees, (3,); the first disparity is the one that places it."""
        self.sightings[number] = sighting
        if self.placed_by is None and not np.isnan(sighting[2]):
            self.placed_by = number


class LandmarkMap:
    """Landmarks by an identity of their own, and which of them each track sees."""

    def __init__(self, rig: RectifiedStereo, config: SmootherConfig) -> None:
        self._rig, self._config = rig, config
        self._by_id: dict[int, Landmark] = {}
        self._of_track: dict[int, int] = {}  # the landmark that a track sees at present
        self._next_id = 0
        noise = config.noise
        self._most_sightings = np.inf if noise.walk_px == 0.0 else max(2.0, (noise.track_px / noise.walk_px) ** 2)
        self._largest_px = rig.focal_px[0] * rig.baseline_m / config.nearest_m

    def __len__(self) -> int:
        return len(self._by_id)

    def __getitem__(self, landmark_id: int) -> Landmark:
        return self._by_id[landmark_id]

    def point(self, landmark_id: int) -> Array:
        """Where a placed landmark is, m, world frame, (3,)."""
        point = self._by_id[landmark_id].point_world
        assert point is not None
        return point

    def items(self) -> list[tuple[int, Landmark]]:
        """All landmarks by identity, in the order in which they came."""
        return list(self._by_id.items())

    def sightings(self, tracks: StereoTracks) -> Array:
        """Rows (N, 3) = left column, row, right column; NaN for a right column whose disparity is not believed."""
        disparity = tracks.left_px[:, 0] - tracks.right_px[:, 0]
        is_believed = (disparity > self._config.min_disparity_px) & (disparity < self._largest_px)
        return np.column_stack((tracks.left_px, np.where(is_believed, tracks.right_px[:, 0], np.nan)))

    def known(self, tracks: StereoTracks) -> tuple[BoolArray, Array, Array]:
        """Which tracks (N,) have a placed landmark, where those are, m, (M, 3), and their covariances (M, 3, 3)."""
        found = [self._seen_by(int(each)) for each in tracks.track_ids]
        placed = [one for one in found if one is not None and one.point_world is not None]
        is_known = np.array([one is not None and one.point_world is not None for one in found], dtype=np.bool_)
        points = np.array([one.point_world for one in placed]).reshape(-1, 3)
        nothing = np.zeros((3, 3))
        covariances = [nothing if one.covariance is None else one.covariance for one in placed]
        return is_known, points, np.array(covariances).reshape(-1, 3, 3)

    def observe(self, number: int, tracks: StereoTracks, is_wrong: BoolArray) -> None:
        """Add what keyframe ``number`` sees; sightings that are wrong are left out."""
        is_crowded = self._is_crowded(tracks, is_wrong)
        sightings = self.sightings(tracks)
        for track_id, sighting, unused in zip(tracks.track_ids.tolist(), sightings, is_wrong | is_crowded, strict=True):
            landmark = self._seen_by(track_id)
            if unused or (landmark is not None and landmark.is_retired):
                continue
            if landmark is not None:
                landmark.observe(number, sighting)
                if len(landmark.sightings) < self._most_sightings:
                    continue
                landmark.is_retired = True  # its track may have wandered off: what it sees from now on is another point
            self._add(track_id).observe(number, sighting)

    def _seen_by(self, track_id: int) -> Landmark | None:
        landmark_id = self._of_track.get(track_id)
        return None if landmark_id is None else self._by_id[landmark_id]

    def _add(self, track_id: int) -> Landmark:
        landmark = self._by_id[self._next_id] = Landmark(track_id)
        self._of_track[track_id] = self._next_id
        self._next_id += 1
        return landmark

    def _is_crowded(self, tracks: StereoTracks, is_wrong: BoolArray) -> BoolArray:
        """New tracks (N,) that are too near to a known or an earlier one: they repeat its errors."""
        is_known = np.array([each in self._of_track for each in tracks.track_ids.tolist()], dtype=np.bool_)
        order = np.concatenate((np.flatnonzero(is_known & ~is_wrong), np.flatnonzero(~is_known)))
        near = cKDTree(tracks.left_px[order]).query_pairs(self._config.spacing_px, output_type="ndarray")
        is_crowded = np.zeros(len(tracks), dtype=np.bool_)
        for earlier, later in near[np.lexsort((near[:, 1], near[:, 0]))]:
            if not is_crowded[order[earlier]] and not is_known[order[later]]:
                is_crowded[order[later]] = True
        return is_crowded

    def place(self, poses: Mapping[int, Array]) -> None:
        """Place anew what the solver does not hold: by the first disparity, or by parallax.

        Args:
            poses: ``T_world_body`` by the number of the keyframe.
        """
        for landmark in self._by_id.values():
            if landmark.is_solvable or not landmark.sightings:
                continue
            number = landmark.placed_by
            if number is not None and number in landmark.sightings:
                sighting = landmark.sightings[number]
                point = self._rig.points(sighting[None, :2], sighting[:1] - sighting[2:])
                landmark.point_world = se3.apply(poses[number] @ self._rig.T_body_camera, point)[0]
            elif len(landmark.sightings) > 1:
                landmark.point_world = self._triangulated(landmark, poses)

    def judge(self, poses: Mapping[int, Array], pixels: PixelModel) -> None:
        """Tell how well each point is known, poses taken as known: by what saw it, and by one disparity.

        Args:
            poses: ``T_world_body`` by the number of the keyframe.
            pixels: the noise of sightings.
        """
        placed = [one for one in self._by_id.values() if one.point_world is not None and one.sightings]
        rows = [(row, number) for row, one in enumerate(placed) for number in one.sightings]
        if not rows:
            return
        with_disparity = [one.placed_by if one.placed_by in one.sightings else min(one.sightings) for one in placed]
        is_placing = [placed[row].placed_by is not None and with_disparity[row] == number for row, number in rows]
        sigmas = np.where(is_placing, self._config.noise.disparity_px, np.inf)
        points = np.array([placed[row].point_world for row, _ in rows])
        T_world_body = np.array([poses[number] for _, number in rows])
        information = np.zeros((len(placed), 3, 3))
        np.add.at(information, [row for row, _ in rows], pixels.point_information(T_world_body, points, sigmas))
        least = _FAINT + _DIGITS * np.einsum("nii->n", information)  # of a point that all but touches a camera
        covariances = np.linalg.inv(information + least[:, None, None] * np.eye(3))
        for one, covariance in zip(placed, covariances, strict=True):
            one.covariance = covariance

    def _triangulated(self, landmark: Landmark, poses: Mapping[int, Array]) -> Array | None:
        """The point (3,) nearest to all rays; None where they are too parallel, or it is behind or too far."""
        centres, rays = [], []
        for number, sighting in landmark.sightings.items():
            T_world_camera = poses[number] @ self._rig.T_body_camera
            sides = (sighting[:2] - np.array(self._rig.principal_point_px)) / np.array(self._rig.focal_px)
            ray = T_world_camera[:3, :3] @ np.array([sides[0], sides[1], 1.0])
            centres.append(T_world_camera[:3, 3])
            rays.append(ray / np.linalg.norm(ray))
        if np.linalg.norm(np.cross(rays[0], rays[-1])) < _LEAST_PARALLAX_RAD:
            return None
        across = [np.eye(3) - np.outer(ray, ray) for ray in rays]
        right = np.sum([part @ centre for part, centre in zip(across, centres, strict=True)], axis=0)
        point = np.asarray(np.linalg.solve(np.sum(across, axis=0), right))
        depth = float(rays[-1] @ (point - centres[-1]))
        is_usable = self._config.nearest_m < depth < _FARTHEST * self._rig.baseline_m
        return point if is_usable else None

    def forget(self, landmark_id: int) -> None:
        """Remove a landmark."""
        landmark = self._by_id.pop(landmark_id)
        if self._of_track.get(landmark.track_id) == landmark_id:
            del self._of_track[landmark.track_id]

    def forget_keyframe(self, number: int) -> None:
        """Remove what a keyframe saw, and the landmarks that nothing knows any more."""
        for landmark_id, landmark in self.items():
            landmark.sightings.pop(number, None)
            if not landmark.sightings and not landmark.is_in_prior:
                self.forget(landmark_id)
