# SPDX-License-Identifier: BSD-3-Clause
"""The points that the window knows: where they are, and which keyframes saw them."""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from coclo_vio.arrays import Array, BoolArray
from coclo_vio.backend.window.config import SmootherConfig
from coclo_vio.calibration import RectifiedStereo
from coclo_vio.geometry import se3
from coclo_vio.measurements import StereoTracks

_LEAST_PARALLAX_RAD = 0.02  # of rays that place a point without any disparity
_FARTHEST = 500.0  # baselines: farther points say nothing of translation


@dataclass(slots=True, eq=False)
class Landmark:
    """A point of the world.

    Attributes:
        point_world: where it is, m, (3,); None until it can be placed.
        sightings: by the number of the keyframe: left column, row, right column (NaN: not seen there), px, (3,).
        placed_by: the keyframe whose disparity counts; None as long as there is none.
        is_in_prior: whether the marginal prior knows of it.
        is_retired: whether it was found wrong: it takes no more sightings and leaves at the next occasion.
    """

    point_world: Array | None = None
    sightings: dict[int, Array] = field(default_factory=dict)
    placed_by: int | None = None
    is_in_prior: bool = False
    is_retired: bool = False

    @property
    def is_solvable(self) -> bool:
        """Whether it ties keyframes together: it has a place, and more than one keyframe or the prior knows it."""
        return self.is_in_prior or (self.point_world is not None and len(self.sightings) > 1)


class LandmarkMap:
    """Landmarks by the identity of their track."""

    def __init__(self, rig: RectifiedStereo, config: SmootherConfig) -> None:
        self._rig, self._config = rig, config
        self._by_id: dict[int, Landmark] = {}
        self._largest_px = rig.focal_px[0] * rig.baseline_m / config.nearest_m

    def __len__(self) -> int:
        return len(self._by_id)

    def __getitem__(self, track_id: int) -> Landmark:
        return self._by_id[track_id]

    def items(self) -> list[tuple[int, Landmark]]:
        """All landmarks by identity, in the order in which they came."""
        return list(self._by_id.items())

    def sightings(self, tracks: StereoTracks) -> Array:
        """Rows (N, 3) = left column, row, right column; NaN for a right column whose disparity is not believed."""
        disparity = tracks.left_px[:, 0] - tracks.right_px[:, 0]
        is_believed = (disparity > self._config.min_disparity_px) & (disparity < self._largest_px)
        return np.column_stack((tracks.left_px, np.where(is_believed, tracks.right_px[:, 0], np.nan)))

    def known(self, tracks: StereoTracks) -> tuple[BoolArray, Array]:
        """Which tracks (N,) have a placed landmark, and where those are, m, (M, 3)."""
        found = [self._by_id.get(int(each)) for each in tracks.track_ids]
        points = [one.point_world for one in found if one is not None and one.point_world is not None]
        is_known = np.array([one is not None and one.point_world is not None for one in found], dtype=np.bool_)
        return is_known, np.array(points).reshape(-1, 3)

    def observe(self, number: int, tracks: StereoTracks, is_wrong: BoolArray) -> None:
        """Add what keyframe ``number`` sees; sightings that are wrong are left out."""
        for track_id, sighting, wrong in zip(tracks.track_ids, self.sightings(tracks), is_wrong, strict=True):
            landmark = self._by_id.get(int(track_id))
            if wrong or (landmark is not None and landmark.is_retired):
                continue
            if landmark is None:
                landmark = self._by_id[int(track_id)] = Landmark()
            landmark.sightings[number] = sighting
            if landmark.placed_by is None and not np.isnan(sighting[2]):
                landmark.placed_by = number

    def place(self, poses: Mapping[int, Array]) -> None:
        """Place anew what the solver does not hold: by the first disparity, or by parallax.

        Args:
            poses: ``T_world_body`` by the number of the keyframe.
        """
        for landmark in self._by_id.values():
            if landmark.is_solvable or not landmark.sightings:
                continue
            sighting = landmark.sightings.get(-1 if landmark.placed_by is None else landmark.placed_by)
            if sighting is not None:
                T_world_camera = poses[landmark.placed_by] @ self._rig.T_body_camera
                point = self._rig.points(sighting[None, :2], sighting[:1] - sighting[2:])
                landmark.point_world = se3.apply(T_world_camera, point)[0]
            elif len(landmark.sightings) > 1:
                landmark.point_world = self._triangulated(landmark, poses)

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

    def forget(self, track_id: int) -> None:
        """Remove a landmark."""
        del self._by_id[track_id]

    def forget_keyframe(self, number: int) -> None:
        """Remove what a keyframe saw, and the landmarks that nothing knows any more."""
        for track_id, landmark in self.items():
            landmark.sightings.pop(number, None)
            if not landmark.sightings and not landmark.is_in_prior:
                self.forget(track_id)
