# SPDX-License-Identifier: BSD-3-Clause
"""The points that are being tracked, as a frozen value between the steps of a frame."""

from dataclasses import dataclass
from typing import Self

import numpy as np

from coclo_vio.frontend.patch_alignment import Templates
from coclo_vio.values.arrays import Array, BoolArray, IntArray


@dataclass(frozen=True, slots=True, eq=False)
class ActiveTracks:
    """Tracks in one frame.

    Attributes:
        ids: one a track, never reused, (N,).
        left_px: columns and rows in the left image, (N, 2).
        right_px: the same in the right image, (N, 2); NaN where unknown.
        ages: frames of the track so far, this one included, (N,).
        slants: change of the disparity per column and per row, (N, 2): the slant of the surface.
        templates: reference templates of the patches.
        warps: map a step inside the template to one in the left image, (N, 2, 2).
        bends: relative change, per column and row of the template, of how much the depth has grown since, 1/px, (N, 2).
    """

    ids: IntArray
    left_px: Array
    right_px: Array
    ages: IntArray
    slants: Array
    templates: Templates
    warps: Array
    bends: Array

    @classmethod
    def new(cls, first_id: int, left_px: Array, templates: Templates) -> Self:
        """Tracks that begin at points (N, 2), px, numbered from ``first_id``, with their reference templates."""
        count = len(left_px)
        ids = np.arange(first_id, first_id + count, dtype=np.int64)
        return cls(
            ids,
            left_px,
            np.full((count, 2), np.nan),
            np.ones(count, dtype=np.int64),
            np.zeros((count, 2)),
            templates,
            np.tile(np.eye(2), (count, 1, 1)),
            np.zeros((count, 2)),
        )

    def __len__(self) -> int:
        return len(self.ids)

    @property
    def disparity(self) -> Array:
        """Left minus right column, px, (N,); NaN where the right one is unknown."""
        return self.left_px[:, 0] - self.right_px[:, 0]

    @property
    def has_right(self) -> BoolArray:
        """Whether the pixel in the right image is known, (N,)."""
        return np.isfinite(self.right_px[:, 0])

    def select(self, chosen: BoolArray | IntArray) -> Self:
        """The chosen tracks, by a mask (N,) or by indices."""
        if chosen.dtype == np.bool_ and chosen.all():
            return self
        return type(self)(
            self.ids[chosen],
            self.left_px[chosen],
            self.right_px[chosen],
            self.ages[chosen],
            self.slants[chosen],
            self.templates.select(chosen),
            self.warps[chosen],
            self.bends[chosen],
        )

    def joined(self, other: Self) -> Self:
        """These tracks, then the other ones."""
        if not len(other):
            return self
        return type(self)(
            np.concatenate((self.ids, other.ids)),
            np.concatenate((self.left_px, other.left_px)),
            np.concatenate((self.right_px, other.right_px)),
            np.concatenate((self.ages, other.ages)),
            np.concatenate((self.slants, other.slants)),
            self.templates.joined(other.templates),
            np.concatenate((self.warps, other.warps)),
            np.concatenate((self.bends, other.bends)),
        )
