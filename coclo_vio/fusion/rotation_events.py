# SPDX-License-Identifier: BSD-3-Clause
"""What a comparison of rotations has found, as events, the same for every estimator."""

import numpy as np

from coclo_vio.fusion.rotation_findings import CameraMounting, ImageDelay, VisionSuspect
from coclo_vio.values.outputs import Event

_WITNESSES = {"legs": "the legs", "camera_gyroscope": "the cameras' own gyroscope"}


def delay_event(stamp_ns: int, found: ImageDelay) -> Event:
    """Stamps of images are late or early, and are corrected."""
    late, delay_ms = "late" if found.delay_s > 0.0 else "early", 1e3 * abs(found.delay_s)
    detail = (
        f"stamps of images are {delay_ms:.1f} +- {1e3 * found.sigma_s:.1f} ms {late}, as cameras and gyroscope agree; "
        "they are corrected from that on, and the window starts anew; set time_offset_s of the cameras' calibration"
    )
    return Event(stamp_ns, "image_delay", detail)


def mounting_sentence(found: CameraMounting, expected_rad: float | None = None) -> str:
    """How far the cameras are turned, and what one sigma of their mounting allows, rad, where it is known."""
    degrees = np.degrees(found.rotation)
    sigma = float(np.degrees(np.sqrt(found.covariance.trace() / 3.0)))
    measured = (
        f"the cameras are turned by ({degrees[0]:.2f}, {degrees[1]:.2f}, {degrees[2]:.2f}) +- {sigma:.2f} deg "
        "against the gyroscope"
    )
    if expected_rad is None:
        return measured
    return f"{measured}, where {np.degrees(expected_rad):.2f} deg is expected of the cameras' mounting"


def suspicion_event(stamp_ns: int, found: VisionSuspect) -> Event:
    """Cameras and gyroscope contradict each other."""
    differ = f"the rotations of cameras and gyroscope differ by {found.rate_radps:.3f} rad/s"
    if found.witness is None:
        detail = f"{differ}, and no other sensor tells which of them is wrong; nothing was changed"
        return Event(stamp_ns, "rotation_disagreement", detail)
    detail = (
        f"{differ}, and by {named_witness(found.witness)} the gyroscope is right; nothing was changed but by outlier "
        "gates"
    )
    return Event(stamp_ns, "vision_suspect", detail)


def accord_event(stamp_ns: int) -> Event:
    """Cameras that were suspect agree with the gyroscope again."""
    return Event(stamp_ns, "vision_agrees", "cameras and gyroscope agree on the rotation again")


def named_witness(witness: str) -> str:
    """A sensor that has decided between cameras and gyroscope, in a sentence."""
    return _WITNESSES[witness]
