# SPDX-License-Identifier: BSD-3-Clause
"""What an inspection lists of a recording is true of it."""

from pathlib import Path

import numpy as np
import pytest
from rich.console import Console
from tiny_recordings import tiny_cameras, tiny_frames

from coclo_vio.cli.inspection_view import drawn
from coclo_vio.datasets import images
from coclo_vio.datasets.dataset import DatasetConfig
from coclo_vio.datasets.recording_contents import RecordingContents
from coclo_vio.datasets.rosbag.writing.bag_writer import write_bag
from coclo_vio.datasets.rosbag.writing.messages import BagMessages
from coclo_vio.datasets.rosbag.writing.new_bag import new_bag
from coclo_vio.datasets.writer import RecordedJoints, write_euroc_folder, write_leg_log
from coclo_vio.geometry import se3
from coclo_vio.robot.description import RobotDescription, load_robot
from coclo_vio.runs.inspection import Inspection, Topic, inspect_recording, resolve_if_known
from coclo_vio.runs.modes.registry import modes
from coclo_vio.values.calibration import ImuCalibration, matrix4
from coclo_vio.values.config import parse_settings
from coclo_vio.values.errors import ConfigError, DatasetError
from coclo_vio.values.measurements import CameraImuSample, EncodedStereoFrame, ImuSample, JointSample, Measurement
from coclo_vio.values.trajectory import GroundTruth, Trajectory
from coclo_vio.values.units import NS_PER_S

START_NS = 1_700_000_000_000_000_000
NO_TWIST = ("a body twist: the body's velocities, measured by another source",)


@pytest.fixture
def daisy() -> RobotDescription:
    return load_robot("daisy")


def walk(robot: RobotDescription, *, start_ns: int = START_NS) -> list[Measurement]:
    """One second of IMU and joints at 100 Hz, torques included."""
    rng = np.random.default_rng(4)
    samples: list[Measurement] = []
    for step in range(100):
        stamp_ns = start_ns + step * 10_000_000
        samples.append(ImuSample(stamp_ns, rng.normal(size=3), np.array([0.0, 0.0, 9.81])))
        samples.append(JointSample(stamp_ns, *rng.normal(size=(3, len(robot.joint_names)))))
    return samples


def frames(start_ns: int = START_NS) -> list[EncodedStereoFrame]:
    return tiny_frames(range(start_ns, start_ns + NS_PER_S, 50_000_000), 90)


def inspected(path: Path, robot: RobotDescription | None, *settings: str) -> Inspection:
    return inspect_recording(path, robot, DatasetConfig.parse(parse_settings(settings), "test"))


def shown(seen: Inspection, width: int = 80) -> str:
    console = Console(width=width)
    with console.capture() as capture:
        console.print(*drawn(seen), sep="\n")
    return capture.get()


def test_a_whole_trial_is_ready_for_every_mode(tmp_path: Path, daisy: RobotDescription) -> None:
    camera_imu = [CameraImuSample(START_NS + i * 5_000_000, np.zeros(3), np.ones(3)) for i in range(200)]
    contents = RecordingContents(daisy, [*walk(daisy), *camera_imu], stereo=tiny_cameras(), frames=frames())
    write_euroc_folder(tmp_path, contents)
    seen = inspected(tmp_path, daisy)
    assert seen.missing == {name: NO_TWIST if name == "stereo_twist" else () for name in modes()}
    assert seen.joints.matched == daisy.joint_names
    assert seen.joints.fitting == ("daisy",)
    assert seen.calibrations["cameras"] == "8 x 6, f 5.0 px, no distortion, baseline 0.0500 m"
    assert {stream.name for stream in seen.report.streams} == {"imu", "camera_imu", "joints", "stereo"}


def test_no_image_is_decoded(tmp_path: Path, daisy: RobotDescription, monkeypatch: pytest.MonkeyPatch) -> None:
    write_euroc_folder(tmp_path, RecordingContents(daisy, walk(daisy), frames=frames()))

    def refuse(data: bytes, source: str) -> None:
        raise AssertionError(f"{source} was decoded")

    monkeypatch.setattr(images, "decoded", refuse)
    stereo = inspected(tmp_path, daisy).report.stream("stereo")
    assert stereo is not None
    assert stereo.samples == 20


def test_cameras_without_calibration_or_at_another_time_are_a_lack(tmp_path: Path, daisy: RobotDescription) -> None:
    bare = tmp_path / "bare"
    write_euroc_folder(bare, RecordingContents(daisy, walk(daisy), frames=frames()))
    seen = inspected(bare, daisy)
    assert seen.missing["stereo"] == ("calibration of the cameras",)
    assert seen.missing["combined"] == ("calibration of the cameras",)
    apart = tmp_path / "apart"
    late = frames(START_NS + 60_000_000_000)
    write_euroc_folder(apart, RecordingContents(daisy, walk(daisy), stereo=tiny_cameras(), frames=late))
    seen = inspected(apart, daisy)
    assert seen.missing["stereo"] == ()
    assert seen.missing["combined"] == ("joints and stereo at one time: their stamps are 59 s apart",)
    assert seen.missing["vins"] == ("stereo and imu at one time: their stamps are 59 s apart",)


def test_no_torques_are_needed_where_there_are_no_foot_forces_either(tmp_path: Path, daisy: RobotDescription) -> None:
    write_leg_log(tmp_path, daisy, walk(daisy), joints=RecordedJoints(with_effort=False))
    assert inspected(tmp_path, daisy).missing["coclo"] == ()  # by the motion of the feet


def test_foot_forces_are_missing_where_contact_is_estimated_from_them(tmp_path: Path) -> None:
    go1 = load_robot("go1")
    write_leg_log(tmp_path, go1, walk(go1))
    assert inspected(tmp_path, go1).missing["coclo"] == ("foot forces, from which go1's contacts are estimated",)


def test_a_robot_that_does_not_fit_is_a_lack_and_the_rest_is_read(tmp_path: Path, daisy: RobotDescription) -> None:
    write_leg_log(tmp_path, daisy, walk(daisy))
    log = tmp_path / "leg_log.csv"
    log.write_text(log.read_text(encoding="ascii").replace(daisy.joint_names[4], "knie"), encoding="ascii")
    seen = inspected(tmp_path, daisy)
    assert seen.joints.missing == (daisy.joint_names[4],)
    assert seen.missing["coclo"] == ("1 of daisy's 18 joints",)
    assert [stream.name for stream in seen.report.streams] == ["imu"]
    assert f"17 of 18 joints found, not {daisy.joint_names[4]}" in " ".join(shown(seen, width=200).split())


def test_robots_that_share_their_joints_are_named(tmp_path: Path) -> None:
    go1 = load_robot("go1")
    write_leg_log(tmp_path / "walk", go1, walk(go1))
    config, robot = resolve_if_known(tmp_path / "walk", None, None, ["dataset.gap_s=0.5"])
    assert robot is None
    assert config.dataset.gap_s == 0.5
    seen = inspected(tmp_path / "walk", None)
    assert {"a1", "go1"} <= set(seen.joints.fitting)
    assert "name one with --robot" in seen.missing["coclo"][0]


def test_gaps_and_clock_jumps_are_listed_with_their_times(tmp_path: Path, daisy: RobotDescription) -> None:
    samples = walk(daisy)
    del samples[60:90]  # 0.3 s to 0.45 s
    samples.append(samples[20])
    write_leg_log(tmp_path, daisy, samples)
    seen = inspected(tmp_path, daisy)
    imu = seen.report.stream("imu")
    assert imu is not None
    assert (imu.gaps, imu.backward_stamps) == (1, 1)
    text = shown(seen)
    assert "0.160  0.29" in text
    assert "1 older than the one before (the clock jumps" in " ".join(shown(seen, width=200).split())


def test_a_wrong_configuration_is_an_error_with_and_without_a_robot(tmp_path: Path, daisy: RobotDescription) -> None:
    write_leg_log(tmp_path, daisy, walk(daisy))
    for robot in ("daisy", None):
        with pytest.raises(ConfigError, match=r"there is no dataset\.gap"):
            resolve_if_known(tmp_path, robot, None, ["dataset.gap=1"])


def test_configured_columns_are_used_when_the_robot_is_guessed(tmp_path: Path, daisy: RobotDescription) -> None:
    write_leg_log(tmp_path, daisy, walk(daisy))
    log = tmp_path / "leg_log.csv"
    log.write_text(log.read_text(encoding="ascii").replace(".position", "/q"), encoding="ascii")
    _, robot = resolve_if_known(tmp_path, None, None, ["dataset.columns.position=['{joint}/q']"])
    assert robot is not None
    assert robot.name == "daisy"


def test_a_recording_that_breaks_off_is_an_error(tmp_path: Path, daisy: RobotDescription) -> None:
    write_leg_log(tmp_path, daisy, walk(daisy))
    log = tmp_path / "leg_log.csv"
    lines = log.read_text(encoding="ascii").splitlines()
    lines[50] = lines[50].replace(",", ",oops,", 1)
    log.write_text("\n".join(lines), encoding="ascii")
    with pytest.raises(DatasetError, match="line 51"):
        inspected(tmp_path, daisy)


def test_a_bag_with_a_joint_too_few_is_a_problem_and_the_rest_is_read(tmp_path: Path, daisy: RobotDescription) -> None:
    other = daisy.joint_names[4]
    leg = daisy.legs[1].model_copy(update={"joints": (daisy.joint_names[3], "knie", daisy.joint_names[5])})
    renamed = daisy.model_copy(update={"legs": (daisy.legs[0], leg, *daisy.legs[2:]), "joint_aliases": {}})
    bag = write_bag(
        tmp_path / "walk.mcap", RecordingContents(renamed, walk(daisy), stereo=tiny_cameras(), frames=frames())
    )
    seen = inspected(bag, daisy)
    assert seen.joints.missing == (other,)
    assert seen.missing["coclo"] == ("1 of daisy's 18 joints",)
    assert seen.missing["vins"] == seen.missing["stereo"] == ()
    assert len(seen.problems) == 1
    assert other in seen.problems[0]
    assert {topic.role: topic.topics for topic in seen.topics}["imu"] == ("/imu",)
    partial = inspected(bag, daisy, "allow_partial=true")
    assert (partial.missing["coclo"], partial.problems) == ((), ())
    named = inspected(bag, daisy, f"rosbag.joint_names={{{other}: knie}}")
    assert (named.joints.matched, named.missing["coclo"]) == (daisy.joint_names, ())


def test_a_bag_whose_clock_jumps_back_is_a_problem_for_all(tmp_path: Path) -> None:
    path = tmp_path / "walk.bag"
    with new_bag(path) as bag:
        for step in range(800):
            back_ns = 3_000_000_000 if step >= 400 else 0
            sample = ImuSample(START_NS + step * 10_000_000 - back_ns, 0.1 * np.ones(3), np.ones(3))
            message = BagMessages(bag).imu("imu_link", sample, 0.0, 0.0)
            bag.write("/imu", START_NS + step * 10_000_000, message)
    seen = inspected(path, None)
    assert len(seen.problems) == 1
    assert all(lacks[0] == "a recording that can be read through (see problems)" for lacks in seen.missing.values())
    assert seen.report.stream("imu") is not None
    assert inspected(path, None, "allow_partial=true").problems == ()


def test_a_calibration_that_is_malformed_is_a_problem_and_not_the_end(tmp_path: Path, daisy: RobotDescription) -> None:
    write_euroc_folder(tmp_path, RecordingContents(daisy, walk(daisy), stereo=tiny_cameras(), frames=frames()))
    lens = tmp_path / "mav0" / "cam1" / "sensor.yaml"
    lens.write_text(lens.read_text(encoding="ascii").replace("intrinsics", "intrinsic"), encoding="ascii")
    seen = inspected(tmp_path, daisy)
    assert "has no intrinsics" in seen.problems[0]
    assert seen.missing["stereo"] == ("calibration of the cameras",)
    assert seen.missing["coclo"] == ()
    assert "problems - " in " ".join(shown(seen).split())


def test_the_listing_fits_any_terminal(shared_data: Path) -> None:
    for name, robot in (
        ("go1_mocap", load_robot("daisy")),
        ("euroc_v1_01_start", None),
        ("kitti_stereo", None),
        ("stereo_tracks/2011_09_26_drive_0039_sync_KLT.mat", None),
    ):
        seen = inspected(shared_data / name, robot)
        for width in (80, 120):
            assert max(map(len, shown(seen, width).splitlines())) <= width


def test_the_truth_about_the_start_of_v1_01(shared_data: Path) -> None:
    config, robot = resolve_if_known(shared_data / "euroc_v1_01_start", None, None, [])
    assert robot is None
    seen = inspect_recording(shared_data / "euroc_v1_01_start", robot, config.dataset)
    rates = {stream.name: (stream.samples, round(stream.rate_hz)) for stream in seen.report.streams}
    assert rates == {"imu": (29_120, 200), "stereo": (95, 20)}
    assert seen.report.dropped == {"cam1/data.csv: image file is missing": 4}
    assert seen.joints.matched == seen.joints.fitting == ()
    assert seen.ground_truth is not None
    assert (seen.ground_truth.has_stamps, seen.ground_truth.poses) == (True, 28_712)
    assert seen.calibrations["cameras"] is not None
    assert "radtan" in seen.calibrations["cameras"]
    assert {mode for mode, lacks in seen.missing.items() if not lacks} == {"vins", "stereo"}
    text = " ".join(shown(seen).split())
    assert "cam1/data.csv names 4 images whose files are missing" in text
    assert "joints0/data.csv is absent" in text


def test_the_truth_about_the_street_of_kitti(shared_data: Path) -> None:
    config, robot = resolve_if_known(shared_data / "kitti_stereo", None, None, [])
    assert config.robot is robot is None
    seen = inspect_recording(shared_data / "kitti_stereo", robot, config.dataset)
    assert seen.calibrations["cameras"] == "1226 x 370, f 707.1 px, no distortion, baseline 0.5372 m"
    legs = ("joints", "the body's IMU")
    visual = {"vins": ("an IMU",), "stereo": (), "stereo_twist": NO_TWIST}
    assert seen.missing == {name: visual.get(name, legs) for name in modes()}
    text = " ".join(shown(seen).split())
    assert "51 poses over 5.0 s, path of 59.9 m" in text
    assert "taken to be 10 Hz" in text


def test_the_truth_about_starry_night(shared_data: Path) -> None:
    seen = inspected(shared_data / "stereo_tracks" / "starry_night.mat", None)
    assert {mode for mode, lacks in seen.missing.items() if not lacks} == {"stereo", "stereo_twist"}
    assert seen.missing["vins"] == ("an IMU",)
    streams = {stream.name: (stream.samples, round(stream.duration_s, 1)) for stream in seen.report.streams}
    assert streams == {"body_twist": (1900, 168.9), "stereo_tracks": (1900, 168.9)}
    assert seen.problems == ()


def test_an_imu_without_a_known_mounting_does_not_serve_the_cameras(tmp_path: Path, daisy: RobotDescription) -> None:
    inertial = [sample for sample in walk(daisy) if isinstance(sample, ImuSample)]
    write_euroc_folder(tmp_path, RecordingContents(daisy, inertial, stereo=tiny_cameras(), frames=frames()))
    assert inspected(tmp_path, None).missing["vins"] == ("the mounting of its IMU",)
    assert inspected(tmp_path, daisy).missing["vins"] == ()  # by the robot's description
    contents = RecordingContents(daisy, inertial, imu=ImuCalibration(), stereo=tiny_cameras(), frames=frames())
    write_euroc_folder(tmp_path / "recorded", contents)
    assert inspected(tmp_path / "recorded", None).missing["vins"] == ()


def test_changes_to_a_robot_that_is_not_known_are_refused(shared_data: Path) -> None:
    with pytest.raises(ConfigError, match=r"changes robot\.contact, but no robot is named"):
        resolve_if_known(shared_data / "kitti_stereo", None, None, ["robot.contact.source=torque"])


def test_the_truth_about_the_go1(shared_data: Path) -> None:
    config, robot = resolve_if_known(shared_data / "go1_mocap", None, None, [])
    assert robot is not None
    seen = inspect_recording(shared_data / "go1_mocap", robot, config.dataset)
    assert (seen.robot, seen.joints.matched, seen.joints.has_effort) == ("go1", robot.joint_names, False)
    assert seen.ground_truth is not None
    assert (seen.ground_truth.has_stamps, seen.ground_truth.duration_s, seen.ground_truth.poses) == (False, None, 1610)
    assert seen.missing["coclo"] == ()
    assert seen.missing["vins"] == ("stereo images", "calibration of the cameras")
    text = " ".join(shown(seen).split())
    for note in (
        "no joint velocity in the log: estimated causally",
        "no joint torque in the log",
        "1610 poses without stamps",
        "all 12 joints found, without torques",
    ):
        assert note in text


def test_topics_of_a_bag_are_shown_with_their_reason(tmp_path: Path, daisy: RobotDescription) -> None:
    write_leg_log(tmp_path, daisy, walk(daisy))
    plain = inspected(tmp_path, daisy)
    chosen = Topic("imu", ("/imu",), "sensor_msgs/msg/Imu", "the plainest name", ("/imu/raw", "/imu/old"))
    none = Topic("camera_imu", (), "", "none has a camera's name", ())
    seen = Inspection(
        plain.name,
        plain.robot,
        plain.report,
        (chosen, none),
        plain.joints,
        plain.calibrations,
        plain.ground_truth,
        plain.problems,
        plain.missing,
    )
    text = " ".join(shown(seen, width=200).split())
    assert "topics imu /imu (Imu): the plainest name; could be /imu/old, /imu/raw camera_imu none" in text
    assert "camera_imu none: none has a camera's name calibration" in text
    assert seen.to_json()["topics"][0]["topics"] == ("/imu",)


def test_torques_are_found_in_a_recording_that_cannot_be_read_through(tmp_path: Path, daisy: RobotDescription) -> None:
    joints = [sample for sample in walk(daisy) if isinstance(sample, JointSample)]
    received_ns = [sample.stamp_ns for sample in joints]
    joints[21], joints[22] = joints[22], joints[21]
    with new_bag(tmp_path / "swapped.mcap") as bag:
        for came_ns, sample in zip(received_ns, joints, strict=True):
            message = BagMessages(bag).joints("", daisy.joint_names, sample, with_velocity=True, with_effort=True)
            bag.write("/joint_states", came_ns, message)
    seen = inspected(tmp_path / "swapped.mcap", daisy)
    assert "goes back" in seen.problems[0]
    assert seen.joints.has_effort
    assert seen.missing["coclo"] == ("a recording that can be read through (see problems)", "the body's IMU")


def test_a_wrong_joint_name_is_named_without_a_robot_too(tmp_path: Path, daisy: RobotDescription) -> None:
    write_leg_log(tmp_path, daisy, walk(daisy))
    log = tmp_path / "leg_log.csv"
    log.write_text(log.read_text(encoding="ascii").replace(daisy.joint_names[4], "knie"), encoding="ascii")
    seen = inspected(tmp_path, None)
    assert (seen.joints.nearest, seen.joints.missing) == ("daisy", (daisy.joint_names[4],))
    assert seen.missing["coclo"] == ("1 of daisy's joints, or another robot (--robot)",)
    assert f"the joints fit daisy but for {daisy.joint_names[4]}; there are knie" in " ".join(shown(seen, 200).split())


def test_cameras_that_look_apart_are_no_stereo_pair(tmp_path: Path, daisy: RobotDescription) -> None:
    pair = tiny_cameras()
    T_body_behind = se3.transform(np.diag([-1.0, 1.0, -1.0]), np.array([0.3, 0.0, 0.0]))
    pair = pair.model_copy(update={"body_right_camera": matrix4(T_body_behind)})
    write_euroc_folder(tmp_path, RecordingContents(daisy, walk(daisy), stereo=pair, frames=frames()))
    seen = inspected(tmp_path, daisy)
    assert (seen.calibrations["cameras"] or "").endswith("baseline 0.3000 m, axes 180 deg apart")
    assert seen.missing["stereo"] == ("cameras that look in the same direction",)


def test_the_noise_of_a_tracker_adds_nothing_to_the_path(tmp_path: Path, daisy: RobotDescription) -> None:
    rng = np.random.default_rng(9)
    seconds = np.arange(0.0, 10.0, 0.01)
    position = np.column_stack((0.1 * seconds, 0.0 * seconds, 0.0 * seconds)) + rng.normal(0.0, 0.001, (1000, 3))
    stamps_ns = START_NS + np.rint(seconds * 1e9).astype(np.int64)
    trajectory = Trajectory(stamps_ns, se3.transform(np.tile(np.eye(3), (1000, 1, 1)), position))
    truth = GroundTruth(trajectory, has_stamps=True, source="tracker")
    write_leg_log(tmp_path, daisy, walk(daisy), truth)
    seen = inspected(tmp_path, daisy)
    assert seen.ground_truth is not None
    assert seen.ground_truth.path_length_m == pytest.approx(1.0, rel=0.02)
    assert trajectory.path_length_m() > 2.0


def test_a_robot_whose_description_does_not_fit_its_urdf_is_a_problem_and_a_lack(
    tmp_path: Path, daisy: RobotDescription
) -> None:
    write_leg_log(tmp_path, daisy, walk(daisy))
    leg = daisy.legs[0].model_copy(update={"foot_frame": "no_such_frame"})
    seen = inspected(tmp_path, daisy.model_copy(update={"legs": (leg, *daisy.legs[1:])}))
    assert "no_such_frame" in seen.problems[0]
    assert seen.missing["coclo"] == ("a description of daisy that fits its URDF (see problems)",)
    assert {stream.name for stream in seen.report.streams} == {"imu", "joints"}
