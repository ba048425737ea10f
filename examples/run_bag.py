# SPDX-License-Identifier: BSD-3-Clause
"""Run one mode on a recording and print its drift: ``python examples/run_bag.py [RECORDING [MODE [FOLDER]]]``.

Without arguments: leg odometry on the bundled rosbag. An earlier run in the folder is replaced.
"""

import sys
from pathlib import Path

import coclo_vio as cv


def main(path: str | Path | None = None, mode: str = "coclo", folder: str = "out/run_bag") -> None:
    recording = cv.open(path or cv.sample_path())
    robot = "no robot" if recording.robot is None else f"robot {recording.robot.name}"
    print(f"{recording.name}: {robot}; enough for {', '.join(recording.modes)}")

    run = cv.run(recording, mode)
    for name, trajectory in run.trajectories.items():
        print(f"{name}: {len(trajectory)} poses, path of {trajectory.path_length_m():.3f} m")
    for event in run.events:
        print(f"{event.stamp_ns} ns: {event.kind}: {event.detail}")
    if recording.ground_truth() is not None:
        for name, evaluation in run.metrics().items():
            print(f"{name}: ATE {1e3 * evaluation.ate_m:.1f} mm over {evaluation.path_length_m:.2f} m")
    print(f"run folder: {run.save(folder, overwrite=True)}")


if __name__ == "__main__":
    main(*sys.argv[1:])
