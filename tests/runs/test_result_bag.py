# SPDX-License-Identifier: BSD-3-Clause
"""A run folder as a bag."""

from pathlib import Path

import numpy as np
import pytest
from rosbags.highlevel import AnyReader

from coclo_vio.datasets.writer import write_leg_log
from coclo_vio.evaluation.evaluation import Evaluation
from coclo_vio.geometry import se3, so3
from coclo_vio.robot.description import load_robot
from coclo_vio.robot.model import RobotModel
from coclo_vio.runs.evaluating import evaluate_run
from coclo_vio.runs.result_bag import write_run_bag
from coclo_vio.runs.run_config import resolve
from coclo_vio.runs.run_folder import read_estimates
from coclo_vio.runs.running import run_modes
from coclo_vio.simulation.analytic import AnalyticTrialConfig, generate
from coclo_vio.simulation.body_motion import BodyMotionConfig
from coclo_vio.values.trajectory import GroundTruth


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict[str, Evaluation]]:
    """Three seconds of a Daisy through a naive estimator; the ground truth's world is turned and moved."""
    robot = load_robot("daisy")
    body = BodyMotionConfig(rest_s=0.8, walk_s=2.0, stop_s=0.2, ramp_s=0.4)
    trial = generate(AnalyticTrialConfig(body=body), RobotModel(robot), seed=12)
    moved = trial.truth.moved(se3.transform(so3.about_z(1.0), np.array([4.0, -2.0, 1.0])))
    folder = tmp_path_factory.mktemp("run")
    write_leg_log(folder / "walk", robot, trial.measurements, GroundTruth(moved, True, "truth"))
    config = resolve("daisy")
    run_modes(folder / "walk", ["naive"], config, folder / "out")
    evaluations, _ = evaluate_run(folder / "out", config.evaluation)
    return folder / "out", evaluations


def _poses(path: Path, child: str) -> dict[int, np.ndarray]:
    """Transforms on /tf and /tf_static into a frame, by stamp."""
    found = {}
    with AnyReader([path]) as reader:
        for connection, stamp_ns, raw in reader.messages():
            if connection.topic.startswith("/tf"):
                message: object = reader.deserialize(raw, connection.msgtype)
                for one in message.transforms:  # type: ignore[attr-defined]
                    if one.child_frame_id == child:
                        t, q = one.transform.translation, one.transform.rotation
                        rotation = so3.from_quat_xyzw(np.array([q.x, q.y, q.z, q.w]))
                        found[stamp_ns] = se3.transform(rotation, np.array([t.x, t.y, t.z]))
    return found


def test_the_estimate_lies_on_the_ground_truth_in_the_map(
    run: tuple[Path, dict[str, Evaluation]], tmp_path: Path
) -> None:
    folder, evaluations = run
    bag = write_run_bag(tmp_path / "r.mcap", folder, ["naive"], evaluations)
    [tie] = _poses(bag, "odom").values()
    body, truth = _poses(bag, "base_link"), _poses(bag, "ground_truth")
    first_ns = min(body)
    at_rest = [tie @ pose for stamp_ns, pose in body.items() if stamp_ns < first_ns + 500_000_000]
    truth_at_rest = [pose for stamp_ns, pose in truth.items() if stamp_ns < first_ns + 500_000_000]
    assert len(at_rest) > 40
    assert len(truth_at_rest) > 40
    np.testing.assert_allclose(np.mean(at_rest, axis=0), np.mean(truth_at_rest, axis=0), atol=0.02)  # tilt
    assert np.linalg.norm(tie[:3, 3]) > 4.0


def test_without_an_evaluation_the_map_is_the_estimators_world(
    run: tuple[Path, dict[str, Evaluation]], tmp_path: Path
) -> None:
    folder, _ = run
    bag = write_run_bag(tmp_path / "r.mcap", folder, ["naive"], {})
    [tie] = _poses(bag, "odom").values()
    np.testing.assert_array_equal(tie, np.eye(4))
    assert _poses(bag, "ground_truth") == {}
    poses = read_estimates(folder, "naive").trajectory
    assert sorted(_poses(bag, "base_link")) == poses.stamps_ns.tolist()


def test_angular_velocity_comes_from_the_state_file(run: tuple[Path, dict[str, Evaluation]], tmp_path: Path) -> None:
    folder, _ = run
    bag = write_run_bag(tmp_path / "r.mcap", folder, ["naive"], {})
    table = np.genfromtxt(folder / "naive_state.csv", delimiter=",", names=True)
    with AnyReader([bag]) as reader:
        connections = [one for one in reader.connections if one.topic == "/naive/odometry"]
        yaw_rates = [
            reader.deserialize(raw, connection.msgtype).twist.twist.angular.z  # type: ignore[attr-defined]
            for connection, _, raw in reader.messages(connections)
        ]
    np.testing.assert_array_equal(yaw_rates, table["angular_velocity_body_z"])
    assert np.std(yaw_rates) > 0.0
