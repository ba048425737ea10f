# SPDX-License-Identifier: BSD-3-Clause
"""Calibrations and ground truth of a bag: mountings, intrinsics, noise, the tracked body; files of Kalibr."""

import sqlite3

import numpy as np
import pytest
import yaml
from tiny_bags import START_NS, STEP_NS, TinyBag, place

from coclo_vio.datasets.dataset import DatasetConfig, open_dataset
from coclo_vio.geometry import se3, so3
from coclo_vio.values.config import parse_settings
from coclo_vio.values.errors import CalibrationMissing, DatasetError, TimestampError

IMAGES = {side: f"/camera/infra{1 + i}/image_rect_raw" for i, side in enumerate(("left", "right"))}
TURNED = (0.5, -0.5, 0.5, -0.5)  # z forward, x right


@pytest.fixture
def bag(tmp_path):
    return TinyBag(tmp_path / "walk.bag")


def configured(*settings):
    return DatasetConfig.parse(parse_settings([f"rosbag.{setting}" for setting in settings]), "test")


def pose(xyz, quat_xyzw=(0.0, 0.0, 0.0, 1.0)):
    return se3.transform(so3.from_quat_xyzw(np.array(quat_xyzw)), np.array(xyz, dtype=np.float64))


def add_camera(bag, side, frame, **fields):
    focal = (400.0, 0.0, 319.5, 0.0, 401.0, 239.5, 0.0, 0.0, 1.0)
    fields = {"header__frame_id": frame, "width": 640, "height": 480, "k": focal} | fields
    info = IMAGES[side].replace("image_rect_raw", "camera_info")
    bag.add(fields.pop("topic", info), "sensor_msgs/msg/CameraInfo", START_NS, **fields)
    bag.add_image(START_NS, fields.pop("image", IMAGES[side]), np.zeros((2, 2), dtype=np.uint8))


def projection(focal, baseline=0.0):
    return (focal, 0.0, 300.0, -focal * baseline, 0.0, focal, 200.0, 0.0, 0.0, 0.0, 1.0, 0.0)


def test_mountings_follow_chains_of_frames(bag, biped):
    add_camera(bag, "left", "left_optical")
    add_camera(bag, "right", "right_optical")
    bag.add_imu(START_NS, topic="/camera/imu", header__frame_id="camera_imu")
    bag.add_tf(bag.transform("base_link", "camera_link", (0.3, 0.0, 0.1)))
    bag.add_tf(
        bag.transform("camera_link", "left_optical", (0.0, 0.025, 0.0), TURNED),
        bag.transform("camera_link", "right_optical", (0.0, -0.025, 0.0), TURNED),
        bag.transform("camera_imu", "camera_link", (0.01, 0.0, 0.0)),
    )
    dataset = open_dataset(bag.write(), biped)
    stereo = dataset.stereo_calibration()
    np.testing.assert_allclose(stereo.T_body_left_camera, pose((0.3, 0.025, 0.1), TURNED), atol=1e-12)
    assert stereo.baseline_m == pytest.approx(0.05)
    assert stereo.left.camera_matrix.tolist() == [[400.0, 0.0, 319.5], [0.0, 401.0, 239.5], [0.0, 0.0, 1.0]]
    assert (stereo.left.width_px, stereo.left.height_px, stereo.left.distortion) == (640, 480, "none")
    np.testing.assert_allclose(dataset.camera_imu_calibration().T_body_imu, pose((0.29, 0.0, 0.1)), atol=1e-12)


def test_the_right_camera_is_placed_by_the_baseline_where_its_frame_is_not(bag, biped):
    add_camera(bag, "left", "optical")
    add_camera(bag, "right", "optical", p=projection(400.0, 0.05))
    bag.add_tf(bag.transform("base_link", "optical", (0.3, 0.0, 0.0), TURNED))
    stereo = open_dataset(bag.write(), biped).stereo_calibration()
    T_left_right = se3.inverse(stereo.T_body_left_camera) @ stereo.T_body_right_camera
    np.testing.assert_allclose(T_left_right, pose((0.05, 0.0, 0.0)), atol=1e-12)


def test_rectified_images_have_the_lens_of_p_and_the_turn_of_r(bag, biped):
    turn = so3.about_z(0.1)
    for side in ("left", "right"):
        topic, image = f"/stereo/{side}/camera_info", f"/stereo/{side}/image_rect"
        fields = {"r": tuple(turn.ravel()), "p": projection(300.0), "d": (0.1, 0.0, 0.0, 0.0, 0.0)}
        add_camera(bag, side, f"{side}_optical", topic=topic, image=image, distortion_model="plumb_bob", **fields)
        bag.add_tf(bag.transform("base_link", f"{side}_optical", (0.0, 0.1 if side == "left" else -0.1, 0.0)))
    path = bag.write()
    stereo = open_dataset(path, biped).stereo_calibration()
    assert stereo.left.focal_px == (300.0, 300.0)
    assert stereo.left.distortion == "none"
    np.testing.assert_allclose(stereo.T_body_left_camera[:3, :3], turn.T, atol=1e-12)
    raw = open_dataset(path, biped, configured("is_rectified=false")).stereo_calibration()
    assert raw.left.focal_px == (400.0, 401.0)
    assert raw.left.distortion_coefficients == (0.1, 0.0, 0.0, 0.0, 0.0)
    np.testing.assert_allclose(raw.T_body_left_camera[:3, :3], np.eye(3), atol=1e-12)


@pytest.mark.parametrize(
    ("model", "given", "expected"),
    [
        ("plumb_bob", (0.1, 0.2, 0.3, 0.4, 0.5), ("radtan", (0.1, 0.2, 0.3, 0.4, 0.5))),
        ("plumb_bob", (0.0,) * 5, ("none", ())),
        ("rational_polynomial", (0.1,) * 8, ("radtan", (0.1,) * 8)),
        ("rational_polynomial", (0.1,) * 8 + (0.0,) * 6, ("radtan", (0.1,) * 8)),
        ("equidistant", (0.1, 0.2, 0.3, 0.4), ("equidistant", (0.1, 0.2, 0.3, 0.4))),
        ("", (), ("none", ())),
    ],
)
def test_models_of_distortion_are_those_of_ros(bag, biped, model, given, expected):
    for side in ("left", "right"):
        add_camera(bag, side, side, distortion_model=model, d=given)
        bag.add_tf(bag.transform("base_link", side, (0.0, 0.0, 0.0)))
    lens = open_dataset(bag.write(), biped).stereo_calibration().left
    assert (lens.distortion, lens.distortion_coefficients) == expected


def test_an_unknown_distortion_is_refused_with_those_that_are_read(bag, biped):
    for side in ("left", "right"):
        add_camera(bag, side, side, distortion_model="omni", d=(0.1,) * 5)
        bag.add_tf(bag.transform("base_link", side, (0.0, 0.0, 0.0)))
    with pytest.raises(CalibrationMissing, match=r"infra1/camera_info: distortion 'omni' with 5.*plumb_bob"):
        open_dataset(bag.write(), biped).stereo_calibration()


def test_cameras_without_a_mounting_are_noted_and_have_no_calibration(bag, biped):
    add_camera(bag, "left", "left_optical")
    add_camera(bag, "right", "right_optical")
    bag.add_tf(bag.transform("camera_link", "left_optical", (0.0, 0.0, 0.0)))
    dataset = open_dataset(bag.write(), biped)
    assert dataset.stereo_calibration() is None
    assert any("no static transform from base_link to the frame left_optical" in n for n in dataset.report().notes)


def test_noise_is_read_from_covariances_by_the_rate(bag, biped):
    for i in range(20):
        variance = (4e-6 * 100,) + (0.0,) * 3 + (4e-6 * 100,) + (0.0,) * 3 + (4e-6 * 100,)
        fields = {"angular_velocity_covariance": variance, "linear_acceleration_covariance": (0.0,) * 9}
        bag.add_imu(START_NS + i * STEP_NS, header__frame_id="imu_link", **fields)
    bag.add_tf(bag.transform("base_link", "imu_link", (0.1, 0.2, 0.3), TURNED))
    imu = open_dataset(bag.write(), biped).imu_calibration()
    assert imu.gyroscope_noise_density == pytest.approx(2e-3, rel=1e-9)
    assert imu.accelerometer_noise_density == biped.imu.accelerometer_noise_density
    np.testing.assert_allclose(imu.T_body_imu, pose((0.1, 0.2, 0.3), TURNED), atol=1e-12)


def test_an_implausible_covariance_is_not_used_and_noted(bag, biped):
    for i in range(5):
        bag.add_imu(START_NS + i * STEP_NS, angular_velocity_covariance=(1e4,) + (0.0,) * 3 + (1e4, *(0.0,) * 3, 1e4))
    dataset = open_dataset(bag.write(), biped)
    assert dataset.imu_calibration() is None
    assert any("and not used" in note for note in dataset.report().notes)


TRUTHS = {
    "geometry_msgs/msg/TransformStamped": ("transform", "translation", "rotation"),
    "geometry_msgs/msg/PoseStamped": ("pose", "position", "orientation"),
    "geometry_msgs/msg/PoseWithCovarianceStamped": ("pose.pose", "position", "orientation"),
    "nav_msgs/msg/Odometry": ("pose.pose", "position", "orientation"),
}


def add_truth(bag, stamp_ns, xyz, quat_xyzw=(0.0, 0.0, 0.0, 1.0), msgtype="geometry_msgs/msg/TransformStamped"):
    fields = {}
    bag.add("/vicon/biped/biped", msgtype, stamp_ns, **fields)
    message = bag.last_message
    inner, position, rotation = TRUTHS[msgtype]
    for name in inner.split("."):
        message = getattr(message, name)
    place(getattr(message, position), getattr(message, rotation), xyz, quat_xyzw)


@pytest.mark.parametrize("msgtype", TRUTHS)
def test_ground_truth_is_read_from_poses_of_all_types(bag, biped, msgtype):
    for i in range(3):
        add_truth(bag, START_NS + i * STEP_NS, (1.0, 2.0, float(i)), TURNED, msgtype)
    truth = open_dataset(bag.write(), biped).ground_truth()
    assert truth.has_stamps
    assert truth.source == "/vicon/biped/biped"
    assert truth.trajectory.stamps_ns.tolist() == [START_NS + i * STEP_NS for i in range(3)]
    np.testing.assert_allclose(truth.trajectory.T_world_body[2], pose((1.0, 2.0, 2.0), TURNED), atol=1e-12)


def test_the_mounting_of_the_tracked_object_is_taken_into_account(bag, biped):
    T_body_object = se3.transform(so3.about_z(np.pi / 2), np.array([0.1, 0.0, 0.2]))
    T_world_body = pose((1.0, 2.0, 3.0), TURNED)
    T_world_object = T_world_body @ T_body_object
    add_truth(bag, START_NS, T_world_object[:3, 3], so3.to_quat_xyzw(T_world_object[:3, :3]))
    config = configured("object_position_body_m=[0.1, 0, 0.2]", f"rotation_body_object_rpy_rad=[0, 0, {np.pi / 2}]")
    truth = open_dataset(bag.write(), biped, config).ground_truth()
    np.testing.assert_allclose(truth.trajectory.T_world_body[0], T_world_body, atol=1e-12)


def test_lost_and_repeated_poses_are_left_out_and_counted(bag, biped):
    bag.add_imu(START_NS)
    add_truth(bag, START_NS, (1.0, 0.0, 0.0))
    add_truth(bag, START_NS, (1.0, 0.0, 0.0))
    add_truth(bag, START_NS + STEP_NS, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 0.0))
    dataset = open_dataset(bag.write(), biped)
    assert len(dataset.ground_truth().trajectory) == 1
    assert dataset.report().dropped == {
        "ground truth: stamp repeated or out of order": 1,
        "ground truth: pose empty or NaN": 1,
    }


def test_ground_truth_that_goes_back_is_an_error_unless_left_out(bag, biped):
    bag.add_imu(START_NS)
    for k in (0, 2, 1, 3):
        add_truth(bag, START_NS + k * STEP_NS, (float(k), 0.0, 0.0))
        bag.received_last(START_NS)
    path = bag.write()
    dataset = open_dataset(path, biped)
    with pytest.raises(TimestampError, match=r"on /vicon/biped/biped.*goes back"):
        dataset.ground_truth()
    assert any("ground truth is not read" in note for note in dataset.report().notes)
    partial = open_dataset(path, biped, DatasetConfig(allow_partial=True))
    assert partial.ground_truth().trajectory.positions[:, 0].tolist() == [0.0, 2.0, 3.0]
    assert partial.report().dropped == {"/vicon/biped/biped: stamp goes back": 1}


def camchain(tmp_path, **changes):
    """cam0 at z = 0.1 before the IMU, cam1 to its right, both turned as cameras are."""
    T_cam_imu = se3.inverse(pose((0.1, 0.0, 0.0), TURNED))
    lens = {
        "camera_model": "pinhole",
        "intrinsics": [350.0, 351.0, 320.0, 240.0],
        "distortion_model": "radtan",
        "distortion_coeffs": [0.1, 0.2, 0.3, 0.4],
        "resolution": [640, 480],
        "timeshift_cam_imu": 0.0125,
    }
    cam0 = lens | {"T_cam_imu": T_cam_imu.tolist(), "rostopic": IMAGES["left"]}
    cam1 = lens | {"T_cn_cnm1": pose((-0.06, 0.0, 0.0)).tolist(), "rostopic": IMAGES["right"]}
    path = tmp_path / "camchain.yaml"
    path.write_text(yaml.safe_dump({"cam0": cam0, "cam1": cam1} | changes))
    return path


def seeing(bag):
    grey = np.zeros((2, 2), dtype=np.uint8)
    for topic in IMAGES.values():
        bag.add_image(START_NS, topic, grey)
    bag.add_imu(START_NS)
    bag.add_imu(START_NS, topic="/camera/imu", header__frame_id="camera_imu")


def test_a_camchain_replaces_a_missing_calibration(tmp_path, bag, biped):
    seeing(bag)
    dataset = open_dataset(bag.write(), biped, configured(f"kalibr.camchain={camchain(tmp_path)}"))
    stereo = dataset.stereo_calibration()
    np.testing.assert_allclose(stereo.T_body_left_camera, pose((0.1, 0.0, 0.0), TURNED), atol=1e-12)
    assert stereo.baseline_m == pytest.approx(0.06)
    T_left_right = se3.inverse(stereo.T_body_left_camera) @ stereo.T_body_right_camera
    assert T_left_right[0, 3] == pytest.approx(0.06)
    assert stereo.left.focal_px == (350.0, 351.0)
    assert stereo.time_offset_s == 0.0125
    assert any("taken to be the body's IMU" in note for note in dataset.report().notes)


def test_a_camchain_of_the_cameras_imu_needs_the_mounting_of_that_imu(tmp_path, bag, biped):
    seeing(bag)
    settings = (f"kalibr.camchain={camchain(tmp_path)}", "kalibr.calibrated_imu=camera_imu")
    path = bag.write()
    with pytest.raises(CalibrationMissing, match=r"own mounting on the body is unknown.*calibrated_imu=imu"):
        open_dataset(path, biped, configured(*settings)).stereo_calibration()
    again = TinyBag(tmp_path / "mounted.bag")
    seeing(again)
    again.add_tf(again.transform("base_link", "camera_imu", (0.2, 0.0, 0.0)))
    dataset = open_dataset(again.write(), biped, configured(*settings))
    np.testing.assert_allclose(
        dataset.stereo_calibration().T_body_left_camera, pose((0.3, 0.0, 0.0), TURNED), atol=1e-12
    )


def test_a_camchain_places_the_cameras_imu_by_the_cameras_frame(tmp_path, bag, biped):
    seeing(bag)
    add_camera(bag, "left", "left_optical")
    bag.add_tf(bag.transform("base_link", "left_optical", (0.4, 0.0, 0.0), TURNED))
    settings = (f"kalibr.camchain={camchain(tmp_path)}", "kalibr.calibrated_imu=camera_imu")
    dataset = open_dataset(bag.write(), biped, configured(*settings))
    np.testing.assert_allclose(dataset.camera_imu_calibration().T_body_imu, pose((0.3, 0.0, 0.0)), atol=1e-12)


def test_a_camchain_names_left_and_right_by_their_topics(tmp_path, bag, biped):
    seeing(bag)
    values = yaml.safe_load(camchain(tmp_path).read_text())
    values["cam0"]["rostopic"], values["cam1"]["rostopic"] = IMAGES["right"], IMAGES["left"]
    path = camchain(tmp_path, **values)
    stereo = open_dataset(bag.write(), biped, configured(f"kalibr.camchain={path}")).stereo_calibration()
    np.testing.assert_allclose(stereo.T_body_right_camera, pose((0.1, 0.0, 0.0), TURNED), atol=1e-12)


def test_an_imu_file_sets_the_noise_of_its_own_imu(tmp_path, bag, biped):
    seeing(bag)
    path = tmp_path / "imu.yaml"
    path.write_text("{gyroscope_noise_density: 0.003, accelerometer_random_walk: 0.0007, rostopic: /camera/imu}")
    with pytest.raises(CalibrationMissing, match=r"is of /camera/imu, which is the camera's IMU.*=camera_imu"):
        open_dataset(bag.write(), biped, configured(f"kalibr.imu={path}")).imu_calibration()
    path.write_text("{gyroscope_noise_density: 0.003, accelerometer_random_walk: 0.0007, rostopic: /imu}")
    imu = open_dataset(bag.path, biped, configured(f"kalibr.imu={path}")).imu_calibration()
    assert (imu.gyroscope_noise_density, imu.accelerometer_bias_walk) == (0.003, 0.0007)


def test_a_topic_that_holds_no_pose_is_refused(bag, biped):
    bag.add_imu(START_NS)
    config = configured("topics.ground_truth=/imu", "types={/imu: geometry_msgs/msg/PoseStamped}")
    with pytest.raises(DatasetError, match="/imu holds no pose"):
        open_dataset(bag.write(), biped, config).ground_truth()


def test_a_time_shift_of_seconds_is_one_sentence(tmp_path, bag, biped):
    seeing(bag)
    path = camchain(tmp_path)
    path.write_text(path.read_text().replace("timeshift_cam_imu: 0.0125", "timeshift_cam_imu: 6.0"))
    dataset = open_dataset(bag.write(), biped, configured(f"kalibr.camchain={path}"))
    with pytest.raises(CalibrationMissing, match=r"camchain\.yaml: time_offset_s = 6\.0: .*or equal to 1;") as error:
        dataset.stereo_calibration()
    assert "\n" not in str(error.value)


@pytest.mark.parametrize("model", ["omnidirectional", "double_sphere", "Inverse Brown Conrady"])
@pytest.mark.parametrize("coefficients", [(), (0.0,) * 5, (0.1, 0.2, 0.0, 0.0)])
def test_an_unknown_lens_is_not_read_as_a_pinhole(bag, biped, model, coefficients):
    for side in ("left", "right"):
        add_camera(bag, side, f"{side}_optical", distortion_model=model, d=coefficients)
    bag.add_tf(bag.transform("base_link", "left_optical", (0.0, 0.1, 0.0), TURNED))
    with pytest.raises(CalibrationMissing, match=f"distortion '{model}' .* is not supported"):
        open_dataset(bag.write(), biped).stereo_calibration()


def test_a_calibration_of_a_bag_whose_first_messages_cannot_be_decoded_is_none(tmp_path, biped):
    bag = TinyBag(tmp_path / "walk.db3")
    for i in range(5):
        bag.add_imu(START_NS + i * STEP_NS)
    path = bag.write()
    with sqlite3.connect(path) as database:
        database.execute("UPDATE messages SET data = substr(data, 1, 60)")
    dataset = open_dataset(path, biped, DatasetConfig(allow_partial=True))
    assert dataset.imu_calibration() is None
    assert dataset.stereo_calibration() is None


@pytest.mark.parametrize("quat_xyzw", [(0.0, 0.0, 0.0, 0.0), (1e308, 0.0, 0.0, 1e308), (np.nan, 0.0, 0.0, 1.0)])
def test_a_transform_without_a_rotation_is_left_out(bag, biped, quat_xyzw):
    bag.add_imu(START_NS, topic="/camera/imu", header__frame_id="camera_imu")
    bag.add_tf(bag.transform("base_link", "camera_imu", (0.1, 0.0, 0.0), quat_xyzw))
    dataset = open_dataset(bag.write(), biped)
    assert dataset.camera_imu_calibration() is None
    assert any("no static transform from base_link to the frame camera_imu" in note for note in dataset.report().notes)
