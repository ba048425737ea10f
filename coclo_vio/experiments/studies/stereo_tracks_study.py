# SPDX-License-Identifier: BSD-3-Clause
"""Real recordings without legs: stereo tracks in MATLAB files and a KITTI sequence through the smoother.

``python -m coclo_vio.experiments.studies.stereo_tracks_study RECORDING... -o out/stereo_tracks.json``: each a ``.mat``
file (``stereo``, and ``stereo_twist`` with the rates of the file as weak odometry) or a folder of the KITTI odometry
layout (``stereo``). Dead reckoning with the rates alone is given for comparison. Only the noise in pixels differs
between recordings.
"""

import json
import time
from collections.abc import Mapping
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from coclo_vio.backend.window.config import TwistConfig
from coclo_vio.backend.window.twist_odometry import TwistOdometry
from coclo_vio.datasets.dataset import Dataset, open_dataset
from coclo_vio.datasets.read_report import STREAM_NAMES
from coclo_vio.evaluation.clock import ClockConfig
from coclo_vio.evaluation.evaluate import EvaluationConfig, evaluate
from coclo_vio.evaluation.evaluation_record import EvaluationRecord
from coclo_vio.experiments.studies.study import Row, parser, report
from coclo_vio.geometry import se3, so3
from coclo_vio.runs import run_folder
from coclo_vio.runs.evaluating import evaluate_run
from coclo_vio.runs.run_config import RunConfig, resolve
from coclo_vio.runs.run_record import TrajectoryRecord
from coclo_vio.runs.running import run_modes
from coclo_vio.values.arrays import Array
from coclo_vio.values.measurements import BodyTwistSample, StereoFrame, StereoTracks
from coclo_vio.values.record import write_json
from coclo_vio.values.trajectory import GroundTruth, Trajectory
from coclo_vio.values.units import MS_PER_S

FIGURES = ("drift_100m_percent", "drift_percent", "ate_m", "path_length_m", "path_length_ratio", "coverage")
_KLT = ("smoother.noise.track_px=0.4", "smoother.noise.disparity_px=0.7", "smoother.noise.repeated_disparity_px=10")
NOISE: Mapping[str, tuple[str, ...]] = {  # by a part of the recording's name; otherwise the defaults
    "drive": _KLT,
    "starry_night": ("smoother.noise.track_px=8", "smoother.noise.disparity_px=8"),
}
_SAME_CLOCK = EvaluationConfig(clock=ClockConfig(offset_s=0.0), alignment="se3", max_ground_truth_gap_s=1.0)
_INTERPOLATED_UNTIL = 12  # frame of kitti_stereo: up to it each true step turns by the same angle to 0.003 deg
_CAMERA_STREAMS = (STREAM_NAMES[StereoFrame], STREAM_NAMES[StereoTracks])


def run_recording(path: Path, settings: tuple[str, ...]) -> Row:
    """One recording through every mode that it suffices for."""
    noise = next((values for name, values in NOISE.items() if name in path.stem), ())
    config = resolve(settings=[*noise, *settings])
    dataset = open_dataset(path, None, config.dataset)
    twists = [each for each in dataset.measurements(frozenset({BodyTwistSample})) if isinstance(each, BodyTwistSample)]
    modes = ("stereo", "stereo_twist") if twists else ("stereo",)
    results: Row = {mode: _run_mode(dataset, path, mode, config) for mode in modes}
    truth = dataset.ground_truth()
    if twists and truth is not None:
        results["rates alone"] = _dead_reckoning(twists, truth)
    return {"recording": path.stem, "settings": [*noise, *settings], "modes": results}


def _run_mode(dataset: Dataset, path: Path, mode: str, config: RunConfig) -> Row:
    with TemporaryDirectory() as scratch:
        folder, began_s = Path(scratch), time.process_time()
        record = run_modes(path, [mode], config, folder).estimators[mode]
        cpu_s = time.process_time() - began_s
        evaluations, failures = evaluate_run(folder, _SAME_CLOCK)
        frames = _frames(dataset)
        result = _health(record, frames) | {"cpu_ms_per_frame": MS_PER_S * cpu_s / frames}
        if mode not in evaluations:
            return result | {"failure": failures[mode]}
        result |= _figures(EvaluationRecord.of(evaluations[mode]).to_json())
        truth = dataset.ground_truth()
        if "kitti_stereo" in path.stem and truth is not None:
            result["ends"] = _ends(run_folder.read_estimates(folder, mode).trajectory, truth.trajectory)
        return result


def _frames(dataset: Dataset) -> int:
    """Number of the recording's frames."""
    return max(stream.samples for stream in dataset.report().streams if stream.name in _CAMERA_STREAMS)


def _health(record: TrajectoryRecord, frames: int) -> Row:
    kept = record.model_dump(mode="json", include={"keyframes", "counts", "events", "failure"})
    return {"frames": frames, "frames_without_estimate": frames - record.estimates, **kept}


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
    """Error of the end relative to the first frame, and to the first whose true pose is not interpolated."""
    true = truth.interpolated(estimate.stamps_ns).T_world_body
    steps = np.array([se3.log(step) for step in se3.inverse(true[:-1]) @ true[1:]])
    ends: Row = {
        name: np.ptp(part, axis=0).tolist()  # of [rotation rad, translation m] from frame to frame
        for name, part in (
            ("range_of_true_steps_before", steps[:_INTERPOLATED_UNTIL]),
            ("range_of_true_steps_after", steps[_INTERPOLATED_UNTIL:]),
        )
    }
    for first in (0, _INTERPOLATED_UNTIL):
        error = se3.inverse(_relative(true, first)) @ _relative(estimate.T_world_body, first)
        path_m = float(np.linalg.norm(np.diff(true[first:, :3, 3], axis=0), axis=1).sum())
        ends[f"from_frame_{first}"] = {
            "way_m": path_m,
            "end_m": float(np.linalg.norm(error[:3, 3])),
            "turned_deg": float(np.degrees(np.linalg.norm(so3.log(error[:3, :3])))),
        }
    return ends


def _relative(poses: Array, first: int) -> Array:
    return np.asarray(se3.inverse(poses[first]) @ poses[-1])


def _lines(row: Row) -> str:
    lines = [f"{row['recording']} {' '.join(row['settings'])}"]
    for mode, result in row["modes"].items():
        drift = result.get("drift_100m_percent")
        pieces = "" if drift is None else f" {drift:.2f} % over pieces of 100 m,"
        lines.append(f"  {mode}:{pieces} ATE {result['ate_m']:.2f} m" if "ate_m" in result else f"  {mode}: failed")
    return "\n".join(lines)


def main() -> None:
    """Run every recording, writing after each."""
    arguments = parser(__doc__, Path("out/stereo_tracks.json"))
    arguments.add_argument("recordings", type=Path, nargs="+", help=".mat files and folders of the KITTI layout")
    arguments.add_argument("--set", action="append", default=[], help="a setting for all recordings, such as a.b=c")
    options = arguments.parse_args()
    options.output.parent.mkdir(parents=True, exist_ok=True)
    rows: list[Row] = []
    for path in options.recordings:
        rows.append(run_recording(path, tuple(options.set)))
        report(_lines(rows[-1]))
        write_json(options.output, rows)
    print(json.dumps(rows, indent=2))


if __name__ == "__main__":
    main()
