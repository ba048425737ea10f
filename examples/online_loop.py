# SPDX-License-Identifier: BSD-3-Clause
"""Feed an estimator one measurement at a time: ``python examples/online_loop.py [RECORDING [MODE]]``.

On a robot the measurements come from its drivers; here they come from a recording, in the order of their stamps.
"""

import sys
from pathlib import Path

import numpy as np

import coclo_vio as cv

PRINT_EVERY_NS = 1_000_000_000


def main(path: str | Path | None = None, mode: str = "coclo") -> None:
    recording = cv.open(path or cv.sample_path())
    odometry = cv.make_estimator(mode, robot=recording.robot, calibration=recording.calibration)
    next_ns = 0

    def show(output: cv.Output) -> None:
        nonlocal next_ns
        match output:
            case cv.Estimate(name=name, state=state) if state.stamp_ns >= next_ns:
                next_ns = state.stamp_ns + PRINT_EVERY_NS
                print(f"{name} at {state.stamp_ns} ns: position {np.round(state.nav.T_world_body[:3, 3], 4)} m")
            case cv.Event(kind=kind, detail=detail):
                print(f"{kind}: {detail}")

    for measurement in recording.measurements():
        for output in odometry.push(measurement):
            show(output)
    for output in odometry.finish():
        show(output)
    print({name: count for name, count in odometry.counts.items() if count})


if __name__ == "__main__":
    main(*sys.argv[1:])
