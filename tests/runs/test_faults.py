# SPDX-License-Identifier: BSD-3-Clause
"""Faults applied to measurements made by hand: what is changed, what is left alone, and when."""

import json
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
import pytest

from coclo_vio.datasets.dataset import open_dataset
from coclo_vio.datasets.writer import write_leg_log
from coclo_vio.geometry import se3, so3
from coclo_vio.robot.description import load_robot
from coclo_vio.robot.model import RobotModel
from coclo_vio.runs.fault_spans import Span
from coclo_vio.runs.faults import Faults, FaultsConfig
from coclo_vio.runs.run_config import resolve
from coclo_vio.runs.running import run_modes
from coclo_vio.runs.sensor_faults import turned_cameras, turned_imu
from coclo_vio.simulation.analytic import AnalyticTrialConfig, generate
from coclo_vio.simulation.body_motion import BodyMotionConfig
from coclo_vio.values.calibration import CameraCalibration, ImuCalibration, StereoCalibration, matrix4
from coclo_vio.values.config import write_yaml
from coclo_vio.values.errors import ConfigError
from coclo_vio.values.measurements import (
    ALL_SENSORS,
    CameraImuSample,
    FootForceSample,
    ImuSample,
    JointSample,
    Measurement,
    StereoFrame,
    StereoTracks,
    TrackingQuality,
)
from coclo_vio.values.trajectory import GroundTruth

DAISY = load_robot("daisy")
JOINTS = len(DAISY.joint_names)
BEGIN_NS = 1_700_000_000_000_000_000
STEP_NS = 100_000_000
GRAY = np.full((4, 6), 90, dtype=np.uint8)
UP = np.array([0.0, 0.0, 9.81])


def at(step: int) -> int:
    return BEGIN_NS + step * STEP_NS


def recorded(steps: int = 40) -> list[Measurement]:
    """All sensors at 10 Hz; readings are numbered by step. The body IMU begins a step before the others."""
    rows: list[Measurement] = [ImuSample(BEGIN_NS, np.zeros(3), UP)]
    for step in range(1, steps + 1):
        stamp_ns = at(step)
        value = float(step)
        rows += [
            FootForceSample(stamp_ns, np.full(6, value)),
            ImuSample(stamp_ns, np.full(3, value), UP),
            JointSample(stamp_ns, np.full(JOINTS, value), np.full(JOINTS, value), np.full(JOINTS, value)),
            CameraImuSample(stamp_ns, np.full(3, value), UP),
            StereoFrame(stamp_ns, GRAY, GRAY),
            tracks(stamp_ns, step),
        ]
    return rows


def tracks(stamp_ns: int, age: int) -> StereoTracks:
    """Three points of this age, in frames."""
    left = np.array([[10.0, 10.0], [20.0, 10.0], [30.0, 10.0]])
    return StereoTracks(stamp_ns, np.array([3, 5, 9]), left, left - [4.0, 0.0], np.full(3, age))


def with_faults(
    rows: Sequence[Measurement], sensors: frozenset[type] = ALL_SENSORS, **values: object
) -> list[Measurement]:
    def read(wanted: frozenset[type]) -> Iterator[Measurement]:
        return (row for row in rows if type(row) in wanted)

    return list(Faults(FaultsConfig.parse(values, "test"), DAISY).measurements(read, sensors))


def of_kind(rows: Sequence[Measurement], kind: type) -> list[Measurement]:
    return [row for row in rows if type(row) is kind]


def steps_of(rows: Sequence[Measurement]) -> set[int]:
    return {(row.stamp_ns - BEGIN_NS) // STEP_NS for row in rows}


def test_without_faults_every_measurement_is_the_recorded_one() -> None:
    rows = recorded(5)
    assert all(one is other for one, other in zip(with_faults(rows), rows, strict=True))
    assert FaultsConfig().is_none


def test_in_a_blackout_images_are_black_and_everything_else_is_as_recorded() -> None:
    rows = recorded()
    faulty = with_faults(rows, blackouts=["1:0.5", "3:0.2"])
    black = [one for one in of_kind(faulty, StereoFrame) if not one.left.any() and not one.right.any()]
    assert steps_of(black) == {10, 11, 12, 13, 14, 30, 31}
    assert all(one.left.shape == GRAY.shape for one in black)
    assert [one.stamp_ns for one in faulty] == [one.stamp_ns for one in rows]
    rest = [
        (one, other) for one, other in zip(faulty, rows, strict=True) if type(one) not in {StereoFrame, StereoTracks}
    ]
    assert all(one is other for one, other in rest)


def test_points_are_lost_in_the_dark_and_have_new_identities_afterwards() -> None:
    faulty = of_kind(with_faults(recorded(), blackouts=["1:0.5", "3:0.2"]), StereoTracks)
    dark = [one for one in faulty if len(one) == 0]
    assert steps_of(dark) == {10, 11, 12, 13, 14, 30, 31}
    assert {one.quality for one in dark} == {TrackingQuality.LOST}
    ids = {step: set(faulty[step - 1].track_ids.tolist()) for step in (9, 15, 29, 32, 40)}
    assert ids[9] == {3, 5, 9}
    assert ids[15] == ids[29]
    assert ids[32] == ids[40]
    assert len(ids[9] | ids[15] | ids[32]) == 9
    ages = [int(one.ages.max(initial=0)) for one in faulty]
    assert ages[:9] == list(range(1, 10))
    assert ages[14:29] == list(range(1, 16))
    assert ages[31:] == list(range(1, 10))


def test_the_share_of_frames_that_is_lost_is_the_one_asked_for_and_repeats() -> None:
    rows = of_kind(recorded(2000), StereoFrame)
    kept = steps_of(with_faults(rows, frame_loss=0.3, seed=4))
    assert len(kept) / len(rows) == pytest.approx(0.7, abs=0.03)
    assert steps_of(with_faults(rows, frame_loss=0.3, seed=4)) == kept
    assert steps_of(with_faults(rows, frame_loss=0.3, seed=5)) != kept
    assert with_faults(rows, frame_loss=1.0) == []


def test_a_frozen_leg_repeats_its_last_reading_at_rest_and_the_others_walk_on() -> None:
    rows = recorded()
    faulty = of_kind(with_faults(rows, frozen_legs=["leg2:1:0.5"]), JointSample)
    leg = [DAISY.joint_names.index(joint) for joint in DAISY.legs[1].joints]
    others = np.setdiff1d(np.arange(JOINTS), leg)
    for step, sample in enumerate(faulty, start=1):
        is_frozen = 10 <= step < 15
        held = 9.0 if is_frozen else float(step)
        np.testing.assert_array_equal(sample.position[leg], held)
        np.testing.assert_array_equal(sample.effort[leg], held)
        np.testing.assert_array_equal(sample.velocity[leg], 0.0 if is_frozen else float(step))
        for part in (sample.position, sample.velocity, sample.effort):
            np.testing.assert_array_equal(part[others], float(step))
    np.testing.assert_array_equal(of_kind(rows, JointSample)[11].position, 12.0)


def test_a_leg_frozen_from_the_start_holds_its_first_reading() -> None:
    first, second, *_ = of_kind(with_faults(recorded(), frozen_legs=["leg1:0:3"]), JointSample)
    np.testing.assert_array_equal(first.position, 1.0)
    np.testing.assert_array_equal(second.position[:3], 1.0)
    np.testing.assert_array_equal(second.position[3:], 2.0)


def test_silent_joints_give_no_sample_and_the_imu_goes_on() -> None:
    faulty = with_faults(recorded(), silent_joints=["1:0.5"])
    assert steps_of(of_kind(faulty, JointSample)) == {*range(1, 10), *range(15, 41)}
    assert len(of_kind(faulty, ImuSample)) == 41


def test_a_gyroscope_has_its_offset_in_its_span_on_every_axis_and_nothing_else_changes() -> None:
    rows = recorded()
    faulty = with_faults(rows, gyroscope_offset=["1:0.5:0.05", "1.2:0.1:-0.01"])
    for one, other in zip(faulty, rows, strict=True):
        if type(other) is not ImuSample:
            assert one is other
            continue
        step = (other.stamp_ns - BEGIN_NS) // STEP_NS
        offset = 0.05 * (10 <= step < 15) - 0.01 * (step == 12)
        np.testing.assert_allclose(one.angular_velocity, other.angular_velocity + offset, atol=1e-12)  # type: ignore[union-attr]
        np.testing.assert_array_equal(one.specific_force, UP)  # type: ignore[union-attr]


def test_late_images_come_in_the_order_of_their_stamps() -> None:
    rows = recorded(10)
    faulty = with_faults(rows, image_delay_s=0.25)
    assert [one.stamp_ns for one in faulty] == sorted(one.stamp_ns for one in faulty)
    stamps = [one.stamp_ns for one in of_kind(faulty, StereoFrame)]
    assert stamps == [one.stamp_ns + 250_000_000 for one in of_kind(rows, StereoFrame)]
    assert [one for one in faulty if type(one) not in {StereoFrame, StereoTracks}] == [
        one for one in rows if type(one) not in {StereoFrame, StereoTracks}
    ]


def test_a_wrong_mounting_turns_cameras_and_their_imu_alike_about_the_left_camera() -> None:
    mounting = se3.transform(so3.exp(np.array([0.3, -0.2, 0.5])), np.array([0.2, 0.1, 0.05]))
    right = mounting @ se3.transform(np.eye(3), np.array([0.1, 0.0, 0.0]))
    camera = CameraCalibration(width_px=8, height_px=6, focal_px=(9.0, 9.0), principal_point_px=(3.5, 2.5))
    stereo = StereoCalibration(
        left=camera, right=camera, body_left_camera=matrix4(mounting), body_right_camera=matrix4(right)
    )
    imu = ImuCalibration(position_body_m=(0.3, 0.0, 0.1), rotation_body_imu_rpy_rad=(0.2, -0.4, 1.0))
    turn_deg, shift_m = (0.0, 3.0, 0.0), (0.01, 0.0, -0.02)
    turned = turned_cameras(stereo, turn_deg, shift_m)
    np.testing.assert_allclose(turned.T_body_left_camera[:3, 3], mounting[:3, 3] + shift_m, atol=1e-12)
    turn = so3.log(turned.T_body_left_camera[:3, :3] @ mounting[:3, :3].T)
    np.testing.assert_allclose(np.degrees(turn), turn_deg, atol=1e-9)
    assert turned.baseline_m == pytest.approx(stereo.baseline_m)
    moved = turned_imu(imu, stereo, turn_deg, shift_m).T_body_imu
    before = se3.inverse(mounting) @ imu.T_body_imu
    np.testing.assert_allclose(se3.inverse(turned.T_body_left_camera) @ moved, before, atol=1e-12)


@pytest.mark.parametrize("sensors", [ALL_SENSORS, frozenset({StereoFrame}), frozenset({JointSample, StereoFrame})])
def test_time_counts_from_the_recordings_first_measurement_whatever_is_read(sensors: frozenset[type]) -> None:
    frames = of_kind(with_faults(recorded(), sensors, blackouts="1:0.5"), StereoFrame)
    assert steps_of([one for one in frames if not one.left.any()]) == {10, 11, 12, 13, 14}


def test_a_recording_of_images_alone_counts_from_its_first() -> None:
    faulty = with_faults(of_kind(recorded(), StereoFrame), blackouts="1:0.5")
    assert steps_of([one for one in faulty if not one.left.any()]) == {11, 12, 13, 14, 15}


@pytest.mark.parametrize(
    ("setting", "words"),
    [
        ("faults.blackouts=[20:5]", "quote it, YAML takes 20:5 for a number of base 60"),
        ("faults.blackouts=['20']", "'20' is no START:SECONDS, such as 20:5"),
        ("faults.blackouts=['-1:5']", "START must be at least 0 and SECONDS above 0"),
        ("faults.silent_joints=['1:nan']", "START must be at least 0 and SECONDS above 0"),
        ("faults.blackouts=['1e300:5']", "neither above 1e+09"),
        ("faults.blackouts=['1:1e300']", "neither above 1e+09"),
        ("faults.frozen_legs=[leg1]", "'leg1' is no LEG:START:SECONDS, such as leg1:20:3"),
        ("faults.frozen_legs=[7]", "must be text LEG:START:SECONDS"),
        ("faults.gyroscope_offset=['20:5']", "'20:5' is no START:SECONDS:RADPS, such as 20:1000:0.05"),
        ("faults.gyroscope_offset=['20:5:99']", "RADPS within 10 rad/s"),
        ("faults.gyroscope_offset=[7]", "must be text START:SECONDS:RADPS"),
        ("faults.frame_loss=1.5", "less than or equal to 1"),
        ("faults.frameloss=0.5", "there is no faults.frameloss; the keys there are: accelerometer_offset, blackouts, "),
    ],
)
def test_a_malformed_fault_is_named_in_one_sentence(setting: str, words: str) -> None:
    with pytest.raises(ConfigError) as caught:
        resolve("daisy", settings=[setting])
    assert words in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_leg_that_the_robot_does_not_have_lists_those_it_has() -> None:
    config = FaultsConfig.parse({"frozen_legs": "front:20:3"}, "test")
    with pytest.raises(ConfigError, match=r"daisy has no leg front; its legs are: leg1, leg2, .*leg6$"):
        Faults(config, DAISY)
    with pytest.raises(ConfigError, match=r"no robot is given; name it with --robot$"):
        Faults(config, None)


def test_a_span_holds_its_start_and_not_its_end() -> None:
    span = Span.parse("1.5:0.25")
    assert (span.start_ns, span.end_ns) == (1_500_000_000, 1_750_000_000)
    assert span.start_ns in span
    assert span.end_ns not in span


def test_a_run_with_faults_is_repeated_by_its_own_configuration(tmp_path: Path) -> None:
    settings = ["faults.blackouts=['20:5']", "faults.frozen_legs=[leg1:20:3, leg2:1:1]", "faults.frame_loss=0.3"]
    config = resolve("daisy", settings=settings)
    write_yaml(config, tmp_path / "config.yaml")
    assert resolve(None, tmp_path / "config.yaml") == config


def test_a_run_applies_the_faults_records_them_and_leaves_the_ground_truth_alone(tmp_path: Path) -> None:
    body = BodyMotionConfig(rest_s=0.8, walk_s=1.0, stop_s=0.2, ramp_s=0.4)
    trial = generate(AnalyticTrialConfig(body=body), RobotModel(DAISY), seed=12)
    write_leg_log(tmp_path / "walk", DAISY, trial.measurements, GroundTruth(trial.truth, True, "truth"))
    folders = {}
    for name, settings in (("plain", []), ("faulty", ["faults.silent_joints=['1:0.5']"])):
        folders[name] = tmp_path / name
        run_modes(tmp_path / "walk", ["naive"], resolve("daisy", settings=settings), folders[name])
    runs = {name: json.loads((folder / "run.json").read_text(encoding="utf-8")) for name, folder in folders.items()}
    assert runs["plain"]["faults"] is None
    assert runs["faulty"]["faults"]["silent_joints"] == ["1:0.5"]
    lost = runs["plain"]["estimators"]["naive"]["measurements"] - runs["faulty"]["estimators"]["naive"]["measurements"]
    joints = of_kind(list(open_dataset(tmp_path / "walk", DAISY, resolve("daisy").dataset).measurements()), JointSample)
    begin_ns = trial.measurements[0].stamp_ns
    assert lost == sum(1_000_000_000 <= one.stamp_ns - begin_ns < 1_500_000_000 for one in joints) > 30
    truths = [(folder / "groundtruth.tum").read_bytes() for folder in folders.values()]
    assert truths[0] == truths[1]
