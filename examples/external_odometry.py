# SPDX-License-Identifier: BSD-3-Clause
"""Use the odometry of another source beside vision: ``python examples/external_odometry.py``.

Vision is lost for one and a half seconds; the body twist of a walking controller ties the frames before to those after.
"""

from collections.abc import Iterator

import numpy as np
from tracks_without_images import CAMERAS, tracks, travelled_m

import coclo_vio as cv

LOST_S = (1.5, 3.0)


def measurements() -> Iterator[cv.Measurement]:
    """A body twist and a frame at each stamp; a tracker that was lost gives its points new identities."""
    for frame in tracks():
        time_s = frame.stamp_ns / 1e9
        speed_mps = (travelled_m(time_s + 5e-3) - travelled_m(time_s - 5e-3)) / 1e-2
        yield cv.BodyTwistSample(frame.stamp_ns, np.zeros(3), np.array([speed_mps, 0.0, 0.0]))
        kept = slice(0) if LOST_S[0] <= time_s < LOST_S[1] else slice(None)
        ids = frame.track_ids + (1000 if time_s >= LOST_S[1] else 0)
        yield cv.StereoTracks(frame.stamp_ns, ids[kept], frame.left_px[kept], frame.right_px[kept])


def main() -> None:
    for mode in ("stereo", "stereo_twist"):
        odometry = cv.make_estimator(mode, calibration=CAMERAS)
        outputs = [output for measurement in measurements() for output in odometry.push(measurement)]
        last = [output.state for output in outputs if isinstance(output, cv.Estimate)][-1]
        off_m = last.nav.T_world_body[0, 3] - travelled_m(last.stamp_ns / 1e9)
        kinds = [output.kind for output in outputs if isinstance(output, cv.Event)]
        print(f"{mode}: {off_m:+.3f} m off at {last.stamp_ns / 1e9:.1f} s; events: {', '.join(kinds)}")


if __name__ == "__main__":
    main()
