# SPDX-License-Identifier: BSD-3-Clause
"""Register a contact estimator and run the filter with it: ``python examples/own_contact_estimator.py [RECORDING]``.

A foot is in stance from a share of the mean load on, so that no force has to be known.
"""

import sys
from pathlib import Path

import numpy as np

import coclo_vio as cv
from coclo_vio.values.arrays import Array


class RelativeLoad:
    """Compares the load on each foot with the mean over the feet whose load is known."""

    def __init__(self, config: cv.ContactConfig, legs: int) -> None:
        self._share = config.parameters.get("share", 0.5)

    def update(self, stamp_ns: int, load: Array) -> cv.ContactState:
        known = np.nan_to_num(load, nan=0.0)  # a foot without a load is in swing
        ratio = known / max(float(np.abs(known).mean()), 1e-6)
        return cv.ContactState(np.clip(ratio, 0.0, 1.0), ratio >= self._share, load)


def main(path: str | Path | None = None) -> None:
    cv.register_contact_estimator("relative_load", RelativeLoad, "stance by relative load", parameters=["share"])
    for settings in ([], ["robot.contact.method=relative_load", "robot.contact.parameters.share=0.6"]):
        recording = cv.open(path or cv.sample_path(), robot="daisy", settings=settings)
        (evaluation,) = cv.run(recording, "coclo").metrics().values()
        print(
            f"{settings or 'as described'}: ATE {1e3 * evaluation.ate_m:.1f} mm over {evaluation.path_length_m:.2f} m"
        )


if __name__ == "__main__":
    main(*sys.argv[1:])
