# SPDX-License-Identifier: BSD-3-Clause
"""The sound inputs that are changed: small bags, logs, trajectories and YAML files, by kind."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from coclo_vio.datasets.rosbag.writing.messages import BagMessages
from coclo_vio.datasets.rosbag.writing.new_bag import new_bag
from coclo_vio.datasets.writer import write_leg_log
from coclo_vio.experiments.fuzz.container_forms import plain_bag, plain_mcap
from coclo_vio.experiments.fuzz.message_mutations import START_NS, walk_messages
from coclo_vio.robot.description import RobotDescription, load_robot, urdf_path
from coclo_vio.runs.run_config import RunConfig
from coclo_vio.values.config import write_yaml
from coclo_vio.values.measurements import FootForceSample, ImuSample, JointSample, Measurement

_CAMCHAIN = """%YAML:1.0
cam0:
  T_cam_imu:
  - [1.0, 0.0, 0.0, 0.01]
  - [0.0, 1.0, 0.0, 0.02]
  - [0.0, 0.0, 1.0, 0.03]
  - [0.0, 0.0, 0.0, 1.0]
  cam_overlaps: [1]
  camera_model: pinhole
  distortion_coeffs: [0.1, -0.05, 0.001, 0.002]
  distortion_model: radtan
  intrinsics: [460.5, 459.1, 367.2, 248.3]
  resolution: [752, 480]
  rostopic: /cam0/image_raw
  timeshift_cam_imu: 0.005
cam1:
  T_cam_imu: [[1.0, 0.0, 0.0, -0.1], [0.0, 1.0, 0.0, 0.02], [0.0, 0.0, 1.0, 0.03], [0.0, 0.0, 0.0, 1.0]]
  T_cn_cnm1: [[1.0, 0.0, 0.0, -0.11], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, 1.0]]
  camera_model: pinhole
  distortion_coeffs: [0.1, -0.05, 0.001, 0.002]
  distortion_model: equidistant
  intrinsics: [460.5, 459.1, 367.2, 248.3]
  resolution: [752, 480]
  rostopic: /cam1/image_raw
"""
_KALIBR_IMU = """imu0:
  accelerometer_noise_density: 0.01
  accelerometer_random_walk: 0.0002
  gyroscope_noise_density: 0.005
  gyroscope_random_walk: 4.0e-06
  rostopic: /imu0
  update_rate: 200.0
"""
_SENSOR = """%YAML:1.0
sensor_type: camera
T_BS: !!opencv-matrix
  cols: 4
  rows: 4
  dt: d
  data: [1.0, 0.0, 0.0, 0.01, 0.0, 1.0, 0.0, 0.02, 0.0, 0.0, 1.0, 0.03, 0.0, 0.0, 0.0, 1.0]
gyroscope_noise_density: 1.7e-04
gyroscope_random_walk: 1.9e-05
accelerometer_noise_density: 2.0e-3
accelerometer_random_walk: 3.0e-3
resolution: [752, 480]
camera_model: pinhole
intrinsics: [458.6, 457.3, 367.2, 248.4]
distortion_model: radial-tangential
distortion_coefficients: [-0.28, 0.07, 0.0002, 1.7e-05]
"""
_RUN = """robot: {preset: go1}
dataset:
  gap_s: 0.2
  columns: {stamp_ns: [t], position: ['q_{joint}']}
  rosbag:
    topics: {imu: /imu, joints: [/joint_states], foot_force: {FL: /foot_force/FL}}
    types: {/imu: sensor_msgs/msg/Imu}
    clock: received
    joint_names: {FL_hip_joint: hip}
    joint_signs: {FL_hip_joint: -1}
    kalibr: {camchain: camchain.yaml}
filter: {profile: paper}
faults: {}
evaluation: {}
"""
_EUROC_IMU = "#timestamp [ns],w_RS_S_x [rad s^-1],w_RS_S_y,w_RS_S_z,a_RS_S_x,a_RS_S_y,a_RS_S_z\n" + "".join(
    f"{i * 5_000_000},0.1,0.2,0.{i % 10},0.0,0.1,9.81\n" for i in range(40)
)
_TUM_LINE = "{t}.{n:09d} {x} {y} 0.3 0.0 0.0 0.1 0.995\n"


def seed_inputs(folder: Path) -> Mapping[str, Sequence[bytes]]:
    """Sound inputs by kind; ``folder`` is for files that are written on the way."""
    go1 = load_robot("go1")
    log = write_leg_log(folder / "log", go1, _walk(go1)).read_bytes()
    write_yaml(RunConfig(), folder / "run.yaml")
    description = go1.model_dump(mode="json") | {"urdf": "robot.urdf"}
    write_yaml(RobotDescription.model_validate(description), folder / "robot.yaml")
    tum = "# t x y z qx qy qz qw\n" + "".join(
        _TUM_LINE.format(t=1_700_000_000 + i // 10, n=i % 10 * 100_000_000, x=0.01 * i, y=-0.02 * i) for i in range(40)
    )
    truth = (
        "#timestamp [ns],p_RS_R_x [m],p_RS_R_y [m],p_RS_R_z [m],q_RS_w [],q_RS_x [],q_RS_y [],q_RS_z []\n"
        + "".join(f"{START_NS + i * 10_000_000},{0.01 * i},0.0,0.3,1.0,0.0,0.0,0.0\n" for i in range(40))
    )
    plain = "time_s,x,y,z,qx,qy,qz,qw\n" + "".join(f"{0.1 * i:.3f},{0.01 * i},0,0.3,0,0,0,1\n" for i in range(40))
    return {
        "bag": _bags(folder, ".bag"),
        "mcap": _bags(folder, ".mcap"),
        "db3": _bags(folder, ".db3"),
        "metadata": [(_folder(folder) / "metadata.yaml").read_bytes()],
        "configuration": [_RUN.encode(), (folder / "run.yaml").read_bytes()],
        "camchain": [_CAMCHAIN.encode(), _CAMCHAIN.partition("\n")[2].encode()],
        "kalibr_imu": [_KALIBR_IMU.encode()],
        "sensor": [_SENSOR.encode()],
        "robot": [_short_robot(), (folder / "robot.yaml").read_bytes()],
        "urdf": [urdf_path(go1).read_bytes()],
        "tum": [tum.encode()],
        "truth_csv": [truth.encode(), plain.encode()],
        "leg_log": [log],
        "euroc": [_EUROC_IMU.encode()],
    }


def _short_robot() -> bytes:
    legs = "\n".join(
        f"  - {{name: {leg}, joints: [{leg}_hip_joint, {leg}_thigh_joint, {leg}_calf_joint], foot_frame: {leg}_foot}}"
        for leg in ("FR", "FL", "RR", "RL")
    )
    return f"name: dog\nurdf: robot.urdf\nlegs:\n{legs}\njoint_aliases: {{hip: FR_hip_joint}}\nimu: {{}}\n".encode()


def _walk(robot: RobotDescription) -> list[Measurement]:
    rng = np.random.default_rng(2)
    samples: list[Measurement] = []
    for i in range(40):
        at_ns = START_NS + i * 5_000_000
        samples.append(FootForceSample(at_ns, np.abs(rng.normal(size=4))))
        samples.append(ImuSample(at_ns, rng.normal(size=3), rng.normal(size=3)))
        samples.append(JointSample(at_ns, *rng.normal(size=(3, 12))))
    return samples


def _folder(folder: Path) -> Path:
    path = folder / "walk"
    if not path.exists():
        _write(path)
    return path


def _write(path: Path) -> None:
    with new_bag(path) as bag:
        for topic, stamp_ns, message in walk_messages(BagMessages(bag)):
            bag.write(topic, stamp_ns, message, is_latched=topic == "/tf_static")


def _bags(folder: Path, suffix: str) -> list[bytes]:
    """As written, and with chunks that are not compressed."""
    path = folder / f"walk{suffix}"
    _write(path)
    data = path.read_bytes()
    match suffix:
        case ".bag":
            return [data, plain_bag(data)]
        case ".mcap":
            return [data, plain_mcap(data)]
    return [data]
