# SPDX-License-Identifier: BSD-3-Clause
"""Simulated faults of cameras: dark, repeated, blurred, interchanged, lost, halved images, and jumps of exposure.

On tracks instead of images: blackouts, repeated, interchanged and lost frames; blur, exposure and size leave them.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import Annotated

import numpy as np
from pydantic import BeforeValidator, Field
from scipy.ndimage import gaussian_filter

from coclo_vio.runs.fault_kinds.fault_form import SPAN, FaultForm, Spans, TimedFault, active, one_or_more
from coclo_vio.runs.fault_spans import Span
from coclo_vio.values.arrays import ByteImage
from coclo_vio.values.calibration import CameraCalibration, StereoCalibration
from coclo_vio.values.config import StageConfig
from coclo_vio.values.measurements import StereoFrame, StereoTracks, TrackingQuality

EXPOSURE = FaultForm("START:SECONDS:FACTOR", "20:5:4", ((0.0, 100.0),))
BLUR = FaultForm("START:SECONDS:PX", "20:5:3", ((0.1, 50.0),))
LOST = FaultForm("START:SECONDS:SHARE", "20:5:0.5", ((0.0, 1.0),))

_Exposures = Annotated[tuple[Annotated[str, BeforeValidator(EXPOSURE.checked)], ...], BeforeValidator(one_or_more)]
_Blurs = Annotated[tuple[Annotated[str, BeforeValidator(BLUR.checked)], ...], BeforeValidator(one_or_more)]
_Losses = Annotated[tuple[Annotated[str, BeforeValidator(LOST.checked)], ...], BeforeValidator(one_or_more)]


class ImageFaultsConfig(StageConfig):
    """What goes wrong with images."""

    frozen_frames: Annotated[Spans, Field(description="START:SECONDS each: the last images come again and again")] = ()
    exposure_jumps: Annotated[
        _Exposures, Field(description="START:SECONDS:FACTOR each: grey values are so many times as large, up to 255")
    ] = ()
    blurred_images: Annotated[
        _Blurs, Field(description="START:SECONDS:PX each: images are blurred by a Gaussian of this standard deviation")
    ] = ()
    swapped_images: Annotated[Spans, Field(description="START:SECONDS each: left and right are interchanged")] = ()
    lost_frames: Annotated[
        _Losses, Field(description="START:SECONDS:SHARE each: this share of the frames is lost, at random")
    ] = ()
    halved_images: Annotated[
        Spans, Field(description="START:SECONDS each: images have half the resolution, the calibration stays")
    ] = ()
    halved_cameras: Annotated[
        bool, Field(description="images and their calibration have half the resolution, the whole time")
    ] = False


class ImageFaults:
    """The faults of a configuration on frames or tracks, one after the other."""

    def __init__(self, config: ImageFaultsConfig, seed: int) -> None:
        """Take the faults; ``seed`` decides which frames are lost."""
        self._frozen, self._swapped = SPAN.parsed(config.frozen_frames), SPAN.parsed(config.swapped_images)
        self._exposures, self._blurs = EXPOSURE.parsed(config.exposure_jumps), BLUR.parsed(config.blurred_images)
        self._lost, self._halved = LOST.parsed(config.lost_frames), SPAN.parsed(config.halved_images)
        self._is_halved = config.halved_cameras
        self._losses = np.random.default_rng([seed, 1])
        self._held: dict[type, StereoFrame | StereoTracks] = {}

    def applied(self, frame: StereoFrame | StereoTracks, after_ns: int) -> StereoFrame | StereoTracks | None:
        """The frame, or what becomes of it; None where it is lost."""
        if any(self._losses.random() < fault.values[0] for fault in active(self._lost, after_ns)):
            return None
        shown = self._held.get(type(frame))
        if shown is None or not active(self._frozen, after_ns):
            shown = self._held[type(frame)] = frame
        if shown is not frame:
            shown = replace(shown, stamp_ns=frame.stamp_ns)
        if active(self._swapped, after_ns):
            shown = _interchanged(shown)
        return self._exposed(shown, after_ns) if isinstance(shown, StereoFrame) else shown

    def _exposed(self, frame: StereoFrame, after_ns: int) -> StereoFrame:
        """The images as they are taken: blurred, bright or dark, small."""
        blurs, exposures = active(self._blurs, after_ns), active(self._exposures, after_ns)
        is_halved = self._is_halved or bool(active(self._halved, after_ns))
        if not (blurs or exposures or is_halved):
            return frame
        left, right = (_taken(image, blurs, exposures, is_halved=is_halved) for image in (frame.left, frame.right))
        return StereoFrame(frame.stamp_ns, left, right)


def _taken(
    image: ByteImage, blurs: Sequence[TimedFault], exposures: Sequence[TimedFault], *, is_halved: bool
) -> ByteImage:
    values = image.astype(np.float32)
    for fault in blurs:
        values = gaussian_filter(values, fault.values[0], mode="nearest")
    for fault in exposures:
        values = values * fault.values[0]
    if is_halved:
        rows, columns = (size // 2 for size in values.shape)
        values = values[: 2 * rows, : 2 * columns].reshape(rows, 2, columns, 2).mean(axis=(1, 3))
    return np.clip(np.rint(values), 0.0, 255.0).astype(np.uint8)


def _interchanged(frame: StereoFrame | StereoTracks) -> StereoFrame | StereoTracks:
    """Left and right the other way round; points without a match on the right are gone."""
    if isinstance(frame, StereoFrame):
        return StereoFrame(frame.stamp_ns, frame.right, frame.left)
    keep = ~np.isnan(frame.right_px).any(axis=1)
    return replace(
        frame,
        track_ids=frame.track_ids[keep],
        left_px=frame.right_px[keep],
        right_px=frame.left_px[keep],
        ages=frame.ages[keep],
    )


class Blackouts:
    """Black images and lost tracks for some spans of time.

    A tracker loses its points in the dark: the same point has another identity afterwards, and a new age.
    """

    def __init__(self, dark: Sequence[Span]) -> None:
        self._dark = dark
        self._shift = 0  # of identities, from the last darkness on
        self._next_id = 0
        self._frames: int | None = None  # since the last darkness

    def applied(self, frame: StereoFrame | StereoTracks, after_ns: int) -> StereoFrame | StereoTracks:
        """The frame, or what is left of it."""
        is_dark = any(after_ns in span for span in self._dark)
        if isinstance(frame, StereoFrame):
            black = np.zeros_like(frame.left)
            return replace(frame, left=black, right=black) if is_dark else frame
        if is_dark:
            self._shift, self._frames = self._next_id, 0
            nothing = np.zeros((0, 2))
            none = np.zeros(0, dtype=np.int64)
            return StereoTracks(frame.stamp_ns, none, nothing, nothing, quality=TrackingQuality.LOST, reason="blackout")
        shifted = frame
        if self._frames is not None:
            self._frames += 1
            ages = np.minimum(frame.ages, self._frames)
            shifted = replace(frame, track_ids=frame.track_ids + self._shift, ages=ages)
        self._next_id = max(self._next_id, int(shifted.track_ids.max(initial=-1)) + 1)
        return shifted


def halved_cameras(stereo: StereoCalibration) -> StereoCalibration:
    """The calibration of cameras whose images are averaged over 2 x 2 pixels.

    The centre of the upper left pixel is (0, 0) in both: u' = (u - 0.5) / 2.
    """
    return stereo.model_copy(update={"left": _halved(stereo.left), "right": _halved(stereo.right)})


def _halved(camera: CameraCalibration) -> CameraCalibration:
    (focal_x, focal_y), (centre_x, centre_y) = camera.focal_px, camera.principal_point_px
    return camera.model_copy(
        update={
            "width_px": camera.width_px // 2,
            "height_px": camera.height_px // 2,
            "focal_px": (focal_x / 2.0, focal_y / 2.0),
            "principal_point_px": ((centre_x - 0.5) / 2.0, (centre_y - 0.5) / 2.0),
        }
    )
