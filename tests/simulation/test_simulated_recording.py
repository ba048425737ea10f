# SPDX-License-Identifier: BSD-3-Clause
"""A simulated trial on the disk: the same recording in any format, the same bytes each time, the truth apart."""

import csv
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import yaml

from coclo_vio.datasets.dataset import open_dataset
from coclo_vio.robot.description import load_robot
from coclo_vio.simulation.simulated_recording import (
    Execution,
    RecordingFormat,
    SimulationConfig,
    at_gait_speed,
    simulate_recording,
    simulation_config,
    truth_folder,
    walked_m,
)
from coclo_vio.simulation.trial.trial import Trial
from coclo_vio.simulation.visuals.opengl import RenderingError, choose_backend
from coclo_vio.values.errors import ConfigError, DatasetError
from coclo_vio.values.measurements import ALL_SENSORS, Measurement, StereoFrame
from coclo_vio.values.trajectory import Trajectory, read_tum
from coclo_vio.values.units import NS_PER_S

DAISY = load_robot("daisy")
SEED = 6
UNTIL_S = 1.5
# It walks from the first second on, so that images and contacts change.
CONFIG = simulation_config("stairs", {"trial": {"stand_s": 1.0, "frame_rate_hz": 8.0}})


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], tuple[Path, Trial]]:
    """Records 1.5 s of the stairs with images under a name; each once."""
    try:
        choose_backend()
    except RenderingError as error:
        pytest.skip(str(error))
    folder = tmp_path_factory.mktemp("simulated")
    done: dict[str, tuple[Path, Trial]] = {}

    def record(name: str) -> tuple[Path, Trial]:
        if name not in done:
            path = folder / name
            done[name] = path, simulate_recording(path, "stairs", CONFIG, SEED, until_s=UNTIL_S)
        return done[name]

    return record


def same(first: object, second: object) -> bool:
    """Whether two samples have the same type and equal arrays."""
    fields = type(first).__slots__
    return type(first) is type(second) and all(
        np.array_equal(getattr(first, name), getattr(second, name), equal_nan=name not in ("left", "right"))
        for name in fields
    )


@pytest.mark.slow
def test_a_bag_and_a_folder_of_one_seed_hold_the_same_samples(recorded) -> None:
    (bag_path, trial), (folder_path, _) = recorded("walk.bag"), recorded("walk_folder")
    bag, folder = open_dataset(bag_path, DAISY), open_dataset(folder_path, DAISY)
    frames = samples = 0
    for in_bag, in_folder in zip(bag.measurements(ALL_SENSORS), folder.measurements(ALL_SENSORS), strict=True):
        assert same(in_bag, in_folder)
        samples += 1
        if isinstance(in_bag, StereoFrame):
            frames += 1
            assert in_bag.left.shape == (480, 640)
            assert in_bag.left.std() > 10.0
            assert not np.array_equal(in_bag.left, in_bag.right)
    assert frames == len(trial.frame_ns) == 13
    assert samples == len(trial.measurements) + frames


@pytest.mark.long
def test_the_written_samples_are_the_measurements(recorded) -> None:
    path, trial = recorded("walk.bag")
    read = [
        sample for sample in open_dataset(path, DAISY).measurements(ALL_SENSORS) if not isinstance(sample, StereoFrame)
    ]

    def order(sample: Measurement) -> tuple[int, str]:
        return sample.stamp_ns, type(sample).__name__  # the order at one stamp is the reader's

    assert all(same(*pair) for pair in zip(sorted(read, key=order), sorted(trial.measurements, key=order), strict=True))


@pytest.mark.long
def test_calibrations_are_the_nominal_ones_not_the_true_ones(recorded) -> None:
    for name in ("walk.bag", "walk_folder"):
        path, trial = recorded(name)
        dataset = open_dataset(path, DAISY)
        stereo = dataset.stereo_calibration()
        np.testing.assert_allclose(stereo.T_body_left_camera, trial.stereo.T_body_left_camera, atol=1e-12)
        assert np.abs(stereo.T_body_left_camera - trial.truth.stereo.T_body_left_camera).max() > 1e-4
        for found, known in (
            (dataset.imu_calibration(), trial.imu),
            (dataset.camera_imu_calibration(), trial.camera_imu),
        ):
            np.testing.assert_allclose(found.T_body_imu, known.T_body_imu, atol=1e-12)
            assert found.gyroscope_noise_density == pytest.approx(known.gyroscope_noise_density)


@pytest.mark.long
def test_the_same_seed_makes_the_same_bytes(recorded, tmp_path) -> None:
    path, _ = recorded("walk.bag")
    again = tmp_path / "again.bag"
    simulate_recording(
        again, "stairs", CONFIG, SEED, until_s=UNTIL_S, execution=Execution(workers=1)
    )  # any number of processes
    assert again.read_bytes() == path.read_bytes()
    for file in truth_folder(path).iterdir():
        assert (truth_folder(again) / file.name).read_bytes() == file.read_bytes()


def test_the_truth_is_beside_the_recording_and_not_in_it(recorded) -> None:
    path, trial = recorded("walk_folder")
    truth = truth_folder(path)
    assert truth.parent == path.parent
    assert {file.name for file in truth.iterdir()} == {"config.yaml", "contacts.csv", "groundtruth.tum", "trial.yaml"}
    assert {file.name for file in path.iterdir()} == {"mav0"}
    exact = read_tum(truth / "groundtruth.tum")
    np.testing.assert_allclose(exact.positions, trial.truth.trajectory.positions, atol=1e-9)
    reference = open_dataset(path, DAISY).ground_truth()
    assert reference is not None
    np.testing.assert_allclose(reference.trajectory.T_world_body, trial.vicon.trajectory.T_world_body, atol=1e-12)
    assert reference.trajectory.stamps_ns[0] - exact.stamps_ns[0] == round(trial.truth.vicon_offset_s * NS_PER_S)


def test_the_record_of_the_trial_holds_the_drawn_robot(recorded) -> None:
    path, trial = recorded("walk_folder")
    record = yaml.safe_load((truth_folder(path) / "trial.yaml").read_text(encoding="utf-8"))
    assert (record["trial"], record["seed"]) == ("stairs", SEED)
    np.testing.assert_array_equal(record["robot"]["link_scale"], trial.truth.imperfection.link_scale)
    np.testing.assert_array_equal(record["stereo"]["body_left_camera"], trial.truth.stereo.T_body_left_camera)
    kept = yaml.safe_load((truth_folder(path) / "config.yaml").read_text(encoding="utf-8"))
    assert SimulationConfig.parse(kept, "config.yaml") == CONFIG


def test_contacts_are_kept_at_every_change(recorded) -> None:
    path, trial = recorded("walk_folder")
    with (truth_folder(path) / "contacts.csv").open(encoding="ascii") as file:
        rows = list(csv.DictReader(file))
    assert list(rows[0]) == ["stamp_ns", *DAISY.leg_names]
    stamps = np.array([int(row["stamp_ns"]) for row in rows])
    contact = np.array([[row[leg] == "1" for leg in DAISY.leg_names] for row in rows])
    assert len(rows) > 1
    assert (contact[1:] != contact[:-1]).any(axis=1).all()
    held = contact[np.searchsorted(stamps, trial.truth.contact_ns, side="right") - 1]
    np.testing.assert_array_equal(held, trial.truth.contact)


def test_progress_of_the_simulation_is_reported(tmp_path) -> None:
    reports: list[tuple[float, float]] = []
    execution = Execution(on_simulated=lambda *times_s: reports.append(times_s))
    simulate_recording(tmp_path / "walk", "flat", CONFIG, 1, images=False, until_s=2.5, execution=execution)
    assert [planned_s for _, planned_s in reports] == [2.5] * len(reports)
    assert len(reports) >= 2


@pytest.mark.long
def test_a_failed_rendering_leaves_no_file(tmp_path, monkeypatch) -> None:
    def dies(*_: object, **__: object) -> None:
        raise RenderingError("a rendering process died")

    monkeypatch.setattr("coclo_vio.simulation.simulated_recording.choose_backend", lambda: "egl")
    monkeypatch.setattr("coclo_vio.simulation.simulated_recording.render_stereo", dies)
    with pytest.raises(RenderingError):
        simulate_recording(tmp_path / "walk.mcap", "flat", CONFIG, 1, until_s=0.5)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("name", "choice", "found"),
    [
        ("a", None, RecordingFormat.EUROC),
        ("a.bag", None, RecordingFormat.ROS1),
        ("a.mcap", RecordingFormat.MCAP, RecordingFormat.MCAP),
        ("a.db3", None, RecordingFormat.ROS2),
        ("a", RecordingFormat.ROS2, RecordingFormat.ROS2),
    ],
)
def test_the_format_is_by_suffix_or_the_chosen_one(name, choice, found) -> None:
    assert RecordingFormat.of(Path(name), choice) is found


@pytest.mark.parametrize(("name", "choice"), [("a.zip", None), ("a.bag", RecordingFormat.EUROC)])
def test_a_suffix_that_does_not_fit_is_refused(name, choice) -> None:
    with pytest.raises(DatasetError, match=name):
        RecordingFormat.of(Path(name), choice)


def test_a_faster_gait_has_higher_speeds_and_a_shorter_period_within_bounds() -> None:
    gait, faster = CONFIG.trial.gait, at_gait_speed(CONFIG, 2.0).trial.gait
    assert (faster.speed_mps, faster.turn_rate_radps) == (2 * gait.speed_mps, 2 * gait.turn_rate_radps)
    assert faster.period_s == gait.period_s / 2
    assert faster.height_m == gait.height_m
    with pytest.raises(ConfigError, match=r"gait speed 9.0: trial.gait.turn_rate_radps = 1.3"):
        at_gait_speed(CONFIG, 9.0)


def test_sway_does_not_count_as_walked() -> None:
    """A body that moves 0.1 m/s along x and sways 2 cm each second walks 1 m in 10 s."""
    time_s = np.arange(0.0, 10.005, 0.01)
    poses = np.tile(np.eye(4), (len(time_s), 1, 1))
    poses[:, 0, 3], poses[:, 1, 3] = 0.1 * time_s, 0.02 * np.sin(2.0 * np.pi * time_s)
    trajectory = Trajectory(np.round(time_s * NS_PER_S).astype(np.int64), poses)
    assert trajectory.path_length_m() > 1.2
    assert walked_m(trajectory) == pytest.approx(1.0, abs=1e-6)
