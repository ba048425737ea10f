# SPDX-License-Identifier: BSD-3-Clause
"""Tracks of points on a wall from a vehicle in a bend: what is written is read back, and the signs agree."""

import numpy as np
import pytest
import scipy.io

from coclo_vio.datasets.camera_axes import R_BODY_CAMERA
from coclo_vio.datasets.dataset import DatasetConfig, guess_robot, open_dataset
from coclo_vio.geometry import se3, so3
from coclo_vio.values.calibration import RectifiedStereo
from coclo_vio.values.errors import CalibrationMissing, DatasetError, TimestampError
from coclo_vio.values.measurements import ALL_SENSORS, BodyTwistSample, StereoTracks, TrackingQuality

FRAMES, POINTS = 8, 12
START_S = 506.5
FOCAL_PX, CENTRE_PX, BASELINE_M = (700.0, 710.0), (600.0, 180.0), 0.54
RATE, VELOCITY = np.array([0.02, -0.03, 0.2]), np.array([9.0, 0.3, -0.1])  # rad/s, m/s, vehicle axes
T_VEHICLE_CAMERA = se3.transform(so3.exp(np.array([0.01, 0.02, -0.03])) @ R_BODY_CAMERA, np.array([1.1, -0.3, 0.7]))
TRACKS_ONLY = frozenset({StereoTracks})
DRIVES = ("2011_09_26_drive_0039_sync_KLT", "2011_09_30_drive_0020_sync_KLT")


def vehicle_poses(seconds):
    """T_world_vehicle (N, 4, 4) under a constant twist."""
    return np.array([se3.exp(np.concatenate((RATE, VELOCITY)) * at) for at in seconds])


def contents():
    """The arrays of a file, by the formulas of the layout, and not by the reader's code."""
    rng = np.random.default_rng(5)
    seconds = 0.1 * np.arange(FRAMES + 3)
    poses = vehicle_poses(seconds)
    points = np.column_stack((rng.uniform(20, 60, POINTS), rng.uniform(-8, 8, POINTS), rng.uniform(-1, 3, POINTS)))
    R_camera_vehicle = T_VEHICLE_CAMERA[:3, :3].T
    y = np.full((4, FRAMES, POINTS), -1.0)
    for frame in range(FRAMES):
        R_vehicle_world = poses[frame, :3, :3].T
        from_camera = (points - poses[frame, :3, 3]) @ R_vehicle_world.T - T_VEHICLE_CAMERA[:3, 3]
        x, down, z = R_camera_vehicle @ from_camera.T
        left = FOCAL_PX[0] * x / z + CENTRE_PX[0]
        row = FOCAL_PX[1] * down / z + CENTRE_PX[1]
        y[:, frame] = left, row, left - FOCAL_PX[0] * BASELINE_M / z, row
    return {
        "y_k_j": y,
        "t": START_S + seconds[None, :FRAMES],
        "fu": FOCAL_PX[0],
        "fv": FOCAL_PX[1],
        "cu": CENTRE_PX[0],
        "cv": CENTRE_PX[1],
        "b": BASELINE_M,
        "C_c_v": R_camera_vehicle,
        "rho_v_c_v": T_VEHICLE_CAMERA[:3, 3:],
        "w_vk_vk_i": np.tile(RATE[:, None], FRAMES + 3),
        "v_vk_vk_i": np.tile(VELOCITY[:, None], FRAMES + 3),
        "r_i_vk_i": poses[:, :3, 3].T,
        "theta_vk_i": so3.log(poses[:, :3, :3]).T,
    }


@pytest.fixture
def write(tmp_path):
    def write_file(drop=(), **changes):
        arrays = {name: array for name, array in {**contents(), **changes}.items() if name not in drop}
        scipy.io.savemat(tmp_path / "drive.mat", arrays, do_compression=True)
        return tmp_path / "drive.mat"

    return write_file


def tracks_of(path, **config):
    return list(open_dataset(path, None, DatasetConfig(**config)).measurements(TRACKS_ONLY))


def rectified(dataset):
    stereo = dataset.stereo_calibration()
    return RectifiedStereo(
        stereo.left.focal_px, stereo.left.principal_point_px, stereo.baseline_m, stereo.T_body_left_camera
    )


def reprojected(dataset, gap, least_disparity_px):
    """Errors (N, 3), left column, row, disparity, px: points of each frame, reprojected ``gap`` frames later."""
    rig, poses = rectified(dataset), dataset.ground_truth().trajectory.T_world_body
    frames = list(dataset.measurements(TRACKS_ONLY))
    errors = []
    for k, (first, later) in enumerate(zip(frames[:-gap], frames[gap:], strict=True)):
        _, mine, theirs = np.intersect1d(first.track_ids, later.track_ids, return_indices=True)
        disparity = first.left_px[mine, 0] - first.right_px[mine, 0]
        near = disparity > least_disparity_px
        mine, theirs, disparity = mine[near], theirs[near], disparity[near]
        T_later_first = se3.inverse(poses[k + gap] @ rig.T_body_camera) @ poses[k] @ rig.T_body_camera
        points = se3.apply(T_later_first, rig.points(first.left_px[mine], disparity))
        is_ahead = points[:, 2] > 0.2
        pixels, expected = rig.pixels(points[is_ahead])
        left, right = later.left_px[theirs][is_ahead], later.right_px[theirs][is_ahead]
        errors.append(np.column_stack((left - pixels, left[:, 0] - right[:, 0] - expected)))
    return np.vstack(errors)


def test_tracks_twist_and_truth_come_back(write):
    dataset = open_dataset(write(), None)
    assert (dataset.name, guess_robot(write())) == ("drive", None)
    got = list(dataset.measurements(ALL_SENSORS))
    assert [type(sample) for sample in got] == [BodyTwistSample, StereoTracks] * FRAMES
    expected = contents()["y_k_j"]
    for frame, (twist, tracks) in enumerate(zip(got[::2], got[1::2], strict=True)):
        assert tracks.stamp_ns == twist.stamp_ns == 506_500_000_000 + frame * 100_000_000
        np.testing.assert_array_equal(tracks.track_ids, np.arange(POINTS))
        np.testing.assert_array_equal(tracks.left_px, expected[:2, frame].T)
        np.testing.assert_array_equal(tracks.right_px, expected[2:, frame].T)
        np.testing.assert_array_equal(tracks.ages, np.full(POINTS, frame + 1))
        assert (tracks.quality, tracks.reason) == (TrackingQuality.HEALTHY, "")
        np.testing.assert_array_equal(twist.velocity, VELOCITY)
        np.testing.assert_array_equal(twist.angular_velocity, RATE)
    truth = dataset.ground_truth()
    assert (truth.has_stamps, truth.source) == (True, "drive.mat")
    np.testing.assert_array_equal(truth.trajectory.stamps_ns, [tracks.stamp_ns for tracks in got[1::2]])
    np.testing.assert_allclose(truth.trajectory.T_world_body, vehicle_poses(0.1 * np.arange(FRAMES)), atol=1e-12)
    assert list(dataset.measurements()) == []


def test_calibration_truth_and_tracks_agree_to_the_last_digit(write):
    dataset = open_dataset(write(), None)
    assert np.abs(reprojected(dataset, 3, 0.0)).max() < 1e-8
    stereo = dataset.stereo_calibration()
    np.testing.assert_allclose(stereo.T_body_left_camera, T_VEHICLE_CAMERA, atol=1e-12)
    np.testing.assert_allclose(stereo.T_body_right_camera[:3, 3], (T_VEHICLE_CAMERA @ [BASELINE_M, 0, 0, 1])[:3])
    assert stereo.left == stereo.right


def test_axes_of_a_vehicle_are_renamed_without_moving_it(write):
    """The same drive by a vehicle whose x points back and whose z points down."""
    R_other_vehicle = np.diag([-1.0, 1.0, -1.0])
    same = contents()
    poses = vehicle_poses(0.1 * np.arange(FRAMES + 3))
    path = write(
        C_c_v=same["C_c_v"] @ R_other_vehicle.T,
        rho_v_c_v=R_other_vehicle @ same["rho_v_c_v"],
        v_vk_vk_i=R_other_vehicle @ same["v_vk_vk_i"],
        w_vk_vk_i=R_other_vehicle @ same["w_vk_vk_i"],
        theta_vk_i=so3.log(poses[:, :3, :3] @ R_other_vehicle.T).T,
    )
    dataset = open_dataset(path, None)
    np.testing.assert_allclose(dataset.stereo_calibration().T_body_left_camera, T_VEHICLE_CAMERA, atol=1e-9)
    np.testing.assert_allclose(dataset.ground_truth().trajectory.T_world_body, poses[:FRAMES], atol=1e-9)
    twist = next(dataset.measurements(frozenset({BodyTwistSample})))
    np.testing.assert_array_equal([twist.angular_velocity, twist.velocity], [RATE, VELOCITY])
    assert any("with its axes renamed" in note for note in dataset.report().notes)
    assert np.abs(reprojected(dataset, 3, 0.0)).max() < 1e-6


def test_missing_observations_are_left_out_and_ages_restart(write):
    y = contents()["y_k_j"]
    y[:, 3, 4] = -1.0  # a point is lost for a frame
    y[2:, 2, 5] = -1.0  # observed by the left camera only
    y[1, 1, 6] = np.nan
    y[0, 1, 7] = np.inf
    y[:, 6] = -1.0
    y[1, 7, 8] = 0.0  # the first row is a row
    frames = tracks_of(write(y_k_j=y))
    assert [len(frame) for frame in frames] == [12, 10, 12, 11, 12, 12, 0, 12]
    assert 4 not in frames[3].track_ids
    assert [frame.ages[frame.track_ids == 4].tolist() for frame in frames[2:6]] == [[3], [], [1], [2]]
    assert np.isnan(frames[2].right_px[5]).all()
    np.testing.assert_array_equal(frames[2].left_px[5], y[:2, 2, 5])
    assert (frames[6].quality, frames[6].reason) == (TrackingQuality.LOST, "the recording has no track in this frame")
    np.testing.assert_array_equal(frames[7].ages, np.ones(POINTS))
    assert frames[7].left_px[8, 1] == 0.0


def test_without_any_right_image_there_are_tracks_all_the_same(write):
    y = contents()["y_k_j"]
    y[2:] = -1.0
    dataset = open_dataset(write(y_k_j=y), None)
    assert all(np.isnan(frame.right_px).all() and len(frame) == POINTS for frame in dataset.measurements(TRACKS_ONLY))
    lens = dataset.stereo_calibration().left
    assert (lens.width_px, lens.height_px) == (max(1200, int(np.ceil(y[0].max() + 1))), 360)


def test_frames_that_go_back_are_counted_and_sorted_if_configured(write):
    order = np.array([0, 1, 4, 2, 3, 5, 6, 7])
    same = contents()
    path = write(y_k_j=same["y_k_j"][:, order], t=same["t"][:, order])
    dataset = open_dataset(path, None)
    assert dataset.report().stream("stereo_tracks").backward_stamps == 1
    assert len(dataset.ground_truth().trajectory) == 6
    assert dataset.report().dropped == {"ground truth: stamp repeated or out of order": 2}
    whole = tracks_of(write())
    path = write(y_k_j=same["y_k_j"][:, order], t=same["t"][:, order])
    ordered = open_dataset(path, None, DatasetConfig(sort=True))
    for mine, expected in zip(ordered.measurements(TRACKS_ONLY), whole, strict=True):
        assert mine.stamp_ns == expected.stamp_ns
        np.testing.assert_array_equal(mine.left_px, expected.left_px)
        np.testing.assert_array_equal(mine.ages, expected.ages)
    assert len(ordered.ground_truth().trajectory) == FRAMES
    assert any(note.startswith("1 frames were older") for note in ordered.report().notes)


def test_rates_after_the_last_frame_are_left_out_and_truth_that_ends_before_is_noted(write):
    same = contents()
    longer = open_dataset(write(), None)
    assert "r_i_vk_i, theta_vk_i, v_vk_vk_i, w_vk_vk_i continue after the last of the 8 frames" in " ".join(
        longer.report().notes
    )
    path = write(r_i_vk_i=same["r_i_vk_i"][:, :5], w_vk_vk_i=same["w_vk_vk_i"][:, :3])
    shorter = open_dataset(path, None)
    assert len(shorter.ground_truth().trajectory) == 5
    assert shorter.report().stream("body_twist").samples == 3
    assert "ground truth ends before the tracks: 5 poses for 8 frames" in shorter.report().notes


def test_a_rate_or_a_pose_that_is_nan_is_left_out(write):
    same = contents()
    same["w_vk_vk_i"][1, 2] = same["r_i_vk_i"][0, 4] = np.nan
    dataset = open_dataset(write(**same), None)
    assert dataset.report().stream("body_twist").samples == FRAMES - 1
    assert dataset.report().dropped == {"body twist: NaN": 1, "ground truth: pose empty or NaN": 1}
    assert len(dataset.ground_truth().trajectory) == FRAMES - 1


def test_tracks_alone_are_a_recording(write):
    dataset = open_dataset(write(drop=set(contents()) - {"t", "y_k_j"}), None)
    assert len(list(dataset.measurements(ALL_SENSORS))) == FRAMES
    assert dataset.ground_truth() is dataset.stereo_calibration() is None
    assert "no body twist: the file has no v_vk_vk_i, w_vk_vk_i" in dataset.report().notes


def test_a_single_landmark_is_read_without_its_dimension(write):
    assert [len(frame) for frame in tracks_of(write(y_k_j=contents()["y_k_j"][:, :, 0]))] == [1] * FRAMES


@pytest.mark.parametrize("name", ["y_k_j", "t"])
def test_a_file_without_tracks_or_stamps_is_an_error_that_lists_its_arrays(write, name):
    with pytest.raises(DatasetError, match=rf"drive\.mat has no {name}.*its arrays are C_c_v, b, cu, cv, fu"):
        open_dataset(write(drop=(name,)), None)


@pytest.mark.parametrize("name", ["fu", "b", "C_c_v", "rho_v_c_v"])
def test_an_incomplete_calibration_is_an_error_that_lists_the_arrays(write, name):
    dataset = open_dataset(write(drop=(name,)), None)
    with pytest.raises(CalibrationMissing, match=f"has no {name}; its arrays are "):
        dataset.stereo_calibration()
    assert len(list(dataset.measurements(TRACKS_ONLY))) == FRAMES


@pytest.mark.parametrize(
    ("changes", "error", "message"),
    [
        ({"t": np.arange(7.0)}, DatasetError, r"shape \(4, 7, landmarks\) for the 7 stamps of t, it has \(4, 8, 12\)"),
        ({"y_k_j": np.zeros((3, 8, 12))}, DatasetError, r"it has \(3, 8, 12\)"),
        ({"t": np.full(8, np.nan)}, TimestampError, "t has nan s at frame 1"),
        ({"t": np.full(8, 1.3e18)}, TimestampError, "stamps must be finite"),
        ({"t": np.zeros((1, 0))}, TimestampError, "t is empty"),
        ({"t": "now"}, DatasetError, "t must be an array of real numbers"),
        ({"w_vk_vk_i": np.zeros((8, 3))}, DatasetError, r"w_vk_vk_i must have 3 rows .* \(8, 3\)"),
        ({"b": -0.54}, DatasetError, "b = -0.54 must be positive"),
        ({"fu": [1.0, 2.0]}, DatasetError, "fu must be one finite number"),
        ({"fv": -1.0}, DatasetError, "fv = -1.0 must be positive"),
        ({"rho_v_c_v": [0.0, np.nan, 0.0]}, DatasetError, "rho_v_c_v must be three finite numbers"),
        ({"C_c_v": 2.0 * np.eye(3)}, DatasetError, "C_c_v must be a rotation"),
        ({"C_c_v": np.diag([1.0, 1.0, -1.0])}, DatasetError, "C_c_v is a reflection"),
    ],
)
def test_a_file_at_fault_is_one_sentence(write, changes, error, message):
    with pytest.raises(error, match=message) as raised:  # noqa: PT012 -- whichever call raises first
        dataset = open_dataset(write(**changes), None)
        dataset.report()
        dataset.stereo_calibration()
    assert "\n" not in str(raised.value)


@pytest.mark.parametrize("keep", [0, 60, 140, 900, -400])
def test_a_file_that_was_cut_off_is_an_error_that_names_it(write, keep):
    path = write()
    path.write_bytes(path.read_bytes()[:keep])
    with pytest.raises(DatasetError, match=r"drive\.mat"):  # noqa: PT012
        dataset = open_dataset(path, None)
        dataset.report()
        dataset.ground_truth().trajectory.path_length_m()
        dataset.stereo_calibration().baseline_m.hex()


def test_a_file_of_another_kind_is_an_error(write):
    path = write()
    path.write_bytes(b"\x89HDF\r\n\x1a\n" + bytes(2000))
    with pytest.raises(DatasetError, match=r"cannot read the MATLAB file .* save it again with -v7"):
        open_dataset(path, None)


@pytest.mark.parametrize(
    ("name", "frames", "tracks", "path_m"), [(DRIVES[0], 300, 92.0, 239.1), (DRIVES[1], 1000, 64.5, 1139.8)]
)
def test_the_real_drives_agree_with_their_truth(shared_data, name, frames, tracks, path_m):
    """Points of one frame reproject into the next within the accuracy of KLT and of a ground truth from GPS and IMU."""
    dataset = open_dataset(shared_data / "stereo_tracks" / f"{name}.mat", None)
    measured = list(dataset.measurements(TRACKS_ONLY))
    assert len(measured) == frames
    assert np.mean([len(frame) for frame in measured]) == pytest.approx(tracks, abs=0.1)
    truth = dataset.ground_truth().trajectory
    assert (len(truth), truth.path_length_m()) == (frames, pytest.approx(path_m, abs=0.1))
    np.testing.assert_allclose(truth.T_world_body[0], np.eye(4), atol=1e-9)
    median = np.median(np.abs(reprojected(dataset, 1, 4.0)), axis=0)
    assert (median < [0.45, 0.5, 0.11]).all()
    assert (np.median(np.abs(reprojected(dataset, 5, 4.0)), axis=0) < [1.4, 1.4, 0.25]).all()


@pytest.mark.parametrize("name", DRIVES)
def test_rates_of_the_real_drives_are_those_of_the_truth(shared_data, name):
    dataset = open_dataset(shared_data / "stereo_tracks" / f"{name}.mat", None)
    rates, velocities, turned, moved = rates_and_truth(dataset)
    assert (rms(turned - rates) < 0.011).all()  # rad/s; the yaw rate alone is 0.09 and 0.18
    assert (rms(turned + rates) > 0.02).all()
    assert (rms(moved - velocities) < [0.6, 0.1, 0.2]).all()  # m/s, of 8 and 11
    assert moved[:, 0].mean() == pytest.approx(velocities[:, 0].mean(), rel=0.004)


def test_starry_night_is_as_its_authors_measured_it(shared_data):
    """Compared with the ground truth, tracks, rates and velocities have the variances that the file states."""
    path = shared_data / "stereo_tracks" / "starry_night.mat"
    stated = scipy.io.loadmat(path, variable_names=["y_var", "w_var", "v_var", "rho_i_pj_i"])
    dataset = open_dataset(path, None)
    rig, truth = rectified(dataset), dataset.ground_truth().trajectory
    assert (len(truth), truth.path_length_m()) == (1900, pytest.approx(44.3, abs=0.1))
    landmarks = stated["rho_i_pj_i"].T
    errors = []
    for T_world_body, measured in zip(truth.T_world_body, dataset.measurements(TRACKS_ONLY), strict=True):
        T_camera_world = se3.inverse(T_world_body @ rig.T_body_camera)
        left, disparity = rig.pixels(se3.apply(T_camera_world, landmarks[measured.track_ids]))
        right_column = measured.right_px[:, 0] - left[:, 0] + disparity
        errors.append(np.column_stack((measured.left_px - left, right_column, measured.right_px[:, 1] - left[:, 1])))
    np.testing.assert_allclose(np.vstack(errors).var(axis=0), stated["y_var"].ravel(), rtol=1e-3)
    rates, velocities, turned, moved = rates_and_truth(dataset, from_earlier=True)
    np.testing.assert_allclose((turned - rates).var(axis=0), stated["w_var"].ravel(), rtol=1e-3)
    np.testing.assert_allclose((moved - velocities).var(axis=0), stated["v_var"].ravel(), rtol=0.05)


def test_the_room_of_starry_night_is_z_up_and_its_body_looks_along_x(shared_data):
    dataset = open_dataset(shared_data / "stereo_tracks" / "starry_night.mat", None)
    truth = dataset.ground_truth().trajectory
    assert truth.positions[:, 2].min() > 0.1  # the landmarks lie on the floor, at z = -0.01
    np.testing.assert_allclose(truth.rotations[0, 2], [0.0, 0.0, 1.0], atol=0.04)  # held level at first
    camera = dataset.stereo_calibration().T_body_left_camera[:3, :3]
    np.testing.assert_allclose(camera, R_BODY_CAMERA, atol=0.01)
    assert any("y_var = [37.9799, 129.8356, 41.9527, 132.4891]" in note for note in dataset.report().notes)


def rms(errors):
    return np.sqrt((errors**2).mean(axis=0))


def rates_and_truth(dataset, *, from_earlier=False):
    """Rates and velocities of the file, and those of the truth from frame to frame, (frames - 1, 3) each.

    A rate is compared with the motion that ends at its stamp, with ``from_earlier`` with the one that begins there.
    """
    samples = list(dataset.measurements(frozenset({BodyTwistSample})))
    truth = dataset.ground_truth().trajectory
    steps_s = np.diff(truth.times_s)[:, None]
    before, after = truth.rotations[:-1], truth.rotations[1:]
    turned = so3.log(before.swapaxes(1, 2) @ after) / steps_s
    moved = np.einsum("nji,nj->ni", before, np.diff(truth.positions, axis=0)) / steps_s
    taken = samples[:-1] if from_earlier else samples[1:]
    rates = np.array([sample.angular_velocity for sample in taken])
    return rates, np.array([sample.velocity for sample in taken]), turned, moved
