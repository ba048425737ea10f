# SPDX-License-Identifier: BSD-3-Clause
"""Real roads and a real room without legs: stereo tracks in MATLAB files and a KITTI sequence through the smoother.

``python -m coclo_vio.experiments.studies.stereo_tracks RECORDING... -o out/stereo_tracks.json``: each a ``.mat``
file (``stereo``, and
``stereo_twist`` with the rates of the file as weak odometry) or a folder of the KITTI odometry layout (``stereo``).
Beside the smoother stands what its rates alone come to. Nothing differs between recordings but the noise in pixels.
"""

import argparse
import json
import os
import sys
import time
from collections.abc import Mapping
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # before NumPy: one core
os.environ.setdefault("OMP_NUM_THREADS", "1")

import numpy as np

from coclo_vio.backend.window.config import TwistConfig
from coclo_vio.backend.window.twist_odometry import TwistOdometry
from coclo_vio.datasets.dataset import Dataset, open_dataset
from coclo_vio.datasets.read_report import STREAM_NAMES
from coclo_vio.evaluation.clock import ClockConfig
from coclo_vio.evaluation.evaluate import EvaluationConfig, evaluate
from coclo_vio.evaluation.records import EvaluationRecord
from coclo_vio.geometry import se3, so3
from coclo_vio.runs import comparison, run_folder
from coclo_vio.runs.run_config import RunConfig, resolve
from coclo_vio.values.arrays import Array
from coclo_vio.values.measurements import BodyTwistSample, StereoFrame, StereoTracks
from coclo_vio.values.trajectory import GroundTruth, Trajectory
from coclo_vio.values.units import MS_PER_S

Row = dict[str, Any]
FIGURES = ("drift_100m_percent", "drift_percent", "ate_m", "path_length_m", "path_length_ratio", "coverage")
_KLT = ("smoother.noise.track_px=0.4", "smoother.noise.disparity_px=0.7", "smoother.noise.repeated_disparity_px=10")
NOISE: Mapping[str, tuple[str, ...]] = {  # by what a recording's name holds; of others the defaults
    "drive": _KLT,
    "starry_night": ("smoother.noise.track_px=8", "smoother.noise.disparity_px=8"),
}
_SAME_CLOCK = EvaluationConfig(clock=ClockConfig(offset_s=0.0), alignment="se3", max_ground_truth_gap_s=1.0)
_INTERPOLATED_UNTIL = 12  # frame of kitti_stereo: up to it each true step turns by the same angle to 0.003 deg
_EYES = (STREAM_NAMES[StereoFrame], STREAM_NAMES[StereoTracks])


def follow(path: Path, settings: tuple[str, ...]) -> Row:
    """One recording through every mode that it is enough for."""
    noise = next((values for name, values in NOISE.items() if name in path.stem), ())
    config = resolve(settings=[*noise, *settings])
    dataset = open_dataset(path, None, config.dataset)
    twists = [each for each in dataset.measurements(frozenset({BodyTwistSample})) if isinstance(each, BodyTwistSample)]
    modes = ("stereo", "stereo_twist") if twists else ("stereo",)
    seen: Row = {mode: _follow(dataset, path, mode, config) for mode in modes}
    truth = dataset.ground_truth()
    if twists and truth is not None:
        seen["rates alone"] = _dead_reckoning(twists, truth)
    return {"recording": path.stem, "settings": [*noise, *settings], "modes": seen}


def _follow(dataset: Dataset, path: Path, mode: str, config: RunConfig) -> Row:
    with TemporaryDirectory() as scratch:
        folder, began_s = Path(scratch), time.process_time()
        told = comparison.run_all(path, [mode], config, folder)
        cpu_s = time.process_time() - began_s
        evaluations, failures = comparison.evaluate_run(folder, _SAME_CLOCK)
        frames = _frames(dataset)
        seen = _health(told["estimators"][mode], frames) | {"cpu_ms_per_frame": MS_PER_S * cpu_s / frames}
        if mode not in evaluations:
            return seen | {"failure": failures[mode]}
        seen |= _figures(EvaluationRecord.of(evaluations[mode]).to_json())
        truth = dataset.ground_truth()
        if "kitti_stereo" in path.stem and truth is not None:
            seen["ends"] = _ends(run_folder.read_estimates(folder, mode).trajectory, truth.trajectory)
        return seen


def _frames(dataset: Dataset) -> int:
    """How many the recording has."""
    return max(stream.samples for stream in dataset.report().streams if stream.name in _EYES)


def _health(told: Row, frames: int) -> Row:
    return {
        "frames": frames,
        "frames_without_estimate": frames - told["estimates"],
        "keyframes": told["keyframes"],
        "counts": told["counts"],
        "events": told["events"],
        "failure": told["failure"],
    }


def _figures(evaluated: Row) -> Row:
    return {key: evaluated.get(key) for key in FIGURES}


def _dead_reckoning(twists: list[BodyTwistSample], truth: GroundTruth) -> Row:
    """The rates of the file, integrated from the first to the last."""
    odometry = TwistOdometry(TwistConfig())
    odometry.push(twists[0])
    odometry.restart(twists[0].stamp_ns)
    poses = [np.eye(4)]
    for twist in twists[1:]:
        odometry.push(twist)
        delta = odometry.delta_until(twist.stamp_ns)
        poses.append(poses[-1] if delta is None else delta.T_start_end)
    path = Trajectory(np.array([each.stamp_ns for each in twists]), np.array(poses))
    return _figures(EvaluationRecord.of(evaluate(path, truth, _SAME_CLOCK, is_gravity_aligned=False)).to_json())


def _ends(estimate: Trajectory, truth: Trajectory) -> Row:
    """Where the end is, seen from the first frame and from the first whose pose is not interpolated."""
    true = truth.interpolated(estimate.stamps_ns).T_world_body
    steps = np.array([se3.log(step) for step in se3.inverse(true[:-1]) @ true[1:]])
    told: Row = {
        name: np.ptp(part, axis=0).tolist()  # of [rotation rad, translation m] from frame to frame
        for name, part in (
            ("range_of_true_steps_before", steps[:_INTERPOLATED_UNTIL]),
            ("range_of_true_steps_after", steps[_INTERPOLATED_UNTIL:]),
        )
    }
    for first in (0, _INTERPOLATED_UNTIL):
        off = se3.inverse(_relative(true, first)) @ _relative(estimate.T_world_body, first)
        way_m = float(np.linalg.norm(np.diff(true[first:, :3, 3], axis=0), axis=1).sum())
        told[f"from_frame_{first}"] = {
            "way_m": way_m,
            "end_m": float(np.linalg.norm(off[:3, 3])),
            "turned_deg": float(np.degrees(np.linalg.norm(so3.log(off[:3, :3])))),
        }
    return told


def _relative(poses: Array, first: int) -> Array:
    return np.asarray(se3.inverse(poses[first]) @ poses[-1])


def _lines(row: Row) -> str:
    lines = [f"{row['recording']} {' '.join(row['settings'])}"]
    for mode, seen in row["modes"].items():
        drift = seen.get("drift_100m_percent")
        pieces = "" if drift is None else f" {drift:.2f} % over pieces of 100 m,"
        lines.append(f"  {mode}:{pieces} ATE {seen['ate_m']:.2f} m" if "ate_m" in seen else f"  {mode}: failed")
    return "\n".join(lines)


def main() -> None:
    """Follow every recording, writing after each."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("recordings", type=Path, nargs="+", help=".mat files and folders of the KITTI layout")
    parser.add_argument("--set", action="append", default=[], help="a setting for all recordings alike, such as a.b=c")
    parser.add_argument("-o", "--output", type=Path, default=Path("out/stereo_tracks.json"))
    given = parser.parse_args()
    given.output.parent.mkdir(parents=True, exist_ok=True)
    rows: list[Row] = []
    for path in given.recordings:
        rows.append(follow(path, tuple(given.set)))
        print(_lines(rows[-1]), file=sys.stderr)
        given.output.write_text(json.dumps(rows, indent=1) + "\n", encoding="utf-8")
    print(json.dumps(rows, indent=2))


if __name__ == "__main__":
    main()
