# SPDX-License-Identifier: BSD-3-Clause
"""Each condition changes what it is about, and nothing else."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from coclo_vio.geometry import se3, so3
from coclo_vio.robot.description import load_robot
from coclo_vio.simulation.conditions import CONDITIONS, condition_changes
from coclo_vio.simulation.simulated_recording import SimulationConfig, simulation_config
from coclo_vio.simulation.trial.imperfection import IDEAL
from coclo_vio.simulation.trial.trial import Trial, simulate
from coclo_vio.values.errors import ConfigError
from coclo_vio.values.measurements import CameraImuSample, ImuSample, JointSample

DAISY = load_robot("daisy")
SOON = {"trial": {"stand_s": 1.0}}
UNTIL_S = 2.5
DEG = np.pi / 180.0


def configured(*conditions: str) -> SimulationConfig:
    return simulation_config("stairs", *condition_changes(conditions), SOON)


@pytest.fixture(scope="module")
def walk(tmp_path_factory: pytest.TempPathFactory) -> Callable[..., Trial]:
    """Walks the first seconds of the stairs under some conditions; the motion is simulated once a condition of legs."""
    motions: Path = tmp_path_factory.mktemp("motions")

    def make(*conditions: str, seed: int = 3) -> Trial:
        return simulate("stairs", DAISY, configured(*conditions).trial, seed, until_s=UNTIL_S, motions=motions)

    return make


def readings(trial: Trial, kind: type, name: str) -> np.ndarray:
    return np.array([getattr(sample, name) for sample in trial.measurements if type(sample) is kind])


def same(first: Trial, second: Trial, *kinds: type) -> bool:
    """Whether both trials have the same readings of these sensors."""
    names = {JointSample: ("position", "velocity", "effort")}
    return all(
        np.array_equal(readings(first, kind, name), readings(second, kind, name))
        for kind in kinds
        for name in names.get(kind, ("angular_velocity", "specific_force"))
    )


@pytest.mark.parametrize("name", CONDITIONS)
def test_every_condition_changes_the_configuration_of_its_kind_only(name: str) -> None:
    plain, changed = (simulation_config("flat", *condition_changes(each)).model_dump() for each in ([], [name]))
    kind = CONDITIONS[name].kind
    trial_fields = {key for key in plain["trial"] if plain["trial"][key] != changed["trial"][key]}
    parts = {part for part in ("scene", "camera") if plain[part] != changed[part]}
    allowed = {
        "legs": {"imperfection", "slip"},
        "vision": {"imperfection", "frame_delay_s"},
        "imu": {"imu", "camera_imu"},
    }
    assert trial_fields or parts
    assert trial_fields <= allowed[kind]
    assert not parts or kind == "vision"


def test_exact_legs_and_exact_vision_make_the_ideal_robot() -> None:
    assert configured("legs_exact", "vision_exact").trial.imperfection == IDEAL
    assert configured("legs_exact").trial.imperfection != IDEAL


@pytest.mark.long
def test_one_encoder_is_5_deg_off_in_all_samples(walk: Callable[..., Trial]) -> None:
    plain, off = walk(), walk("encoder_off")
    moved = readings(off, JointSample, "position") - readings(plain, JointSample, "position")
    wrong = np.abs(moved).max(axis=0) > 1e-9
    assert wrong.sum() == 1
    np.testing.assert_allclose(moved[:, wrong], 5.0 * DEG, atol=1e-12)
    assert same(plain, off, ImuSample, CameraImuSample)
    np.testing.assert_array_equal(off.frame_qpos, plain.frame_qpos)


def test_cameras_are_turned_by_3_deg_and_their_calibration_is_not(walk: Callable[..., Trial]) -> None:
    exact, turned = walk("vision_exact"), walk("vision_exact", "mounting_3_deg")
    between = se3.inverse(exact.truth.stereo.T_body_left_camera) @ turned.truth.stereo.T_body_left_camera
    assert np.linalg.norm(so3.log(between[:3, :3])) == pytest.approx(3.0 * DEG)
    np.testing.assert_allclose(between[:3, 3], 0.0, atol=1e-12)
    assert turned.stereo == exact.stereo
    assert same(exact, turned, ImuSample, JointSample)
    assert not same(exact, turned, CameraImuSample)  # it is inside the camera


def test_late_images_show_what_was_30_ms_before_their_stamps(walk: Callable[..., Trial], monkeypatch) -> None:
    plain, late = walk(), walk("images_late")
    np.testing.assert_array_equal(late.frame_ns, plain.frame_ns)
    after_s = (plain.frame_ns - plain.frame_ns[0]) * 1e-9
    walking = after_s > 1.5
    speed = plain.frame_qvel[walking, :3]
    behind = plain.frame_qpos[walking, :3] - late.frame_qpos[walking, :3]
    assert np.abs(speed).max() > 0.02
    assert np.abs(behind - 0.03 * speed).max() < 0.3 * np.abs(0.03 * speed).max()
    assert same(plain, late, ImuSample, CameraImuSample, JointSample)


@pytest.mark.parametrize(("name", "kind"), [("cheap_body_imu", ImuSample), ("cheap_camera_imu", CameraImuSample)])
def test_a_cheap_imu_has_larger_biases(walk: Callable[..., Trial], name: str, kind: type) -> None:
    other = {ImuSample: CameraImuSample, CameraImuSample: ImuSample}[kind]
    assert same(walk(), walk(name), other, JointSample)
    key = {ImuSample: "imu", CameraImuSample: "camera_imu"}[kind]
    plain = getattr(walk().truth, key)
    cheap = getattr(walk(name).truth, key)
    np.testing.assert_allclose(cheap.accelerometer_bias[0], plain.accelerometer_bias[0] * 5.0, atol=2e-3)
    np.testing.assert_allclose(cheap.gyroscope_bias[0], plain.gyroscope_bias[0] * 2.0, atol=2e-4)


@pytest.mark.long
def test_slippery_ground_moves_feet_that_touch_it(walk: Callable[..., Trial]) -> None:
    plain, slippery = walk("legs_exact"), walk("legs_exact", "legs_slippery")
    assert not np.array_equal(plain.frame_qpos, slippery.frame_qpos)
    np.testing.assert_array_equal(plain.frame_qpos[0], slippery.frame_qpos[0])
    assert slippery.truth.tile is None


def test_an_unknown_condition_is_refused_with_the_choices() -> None:
    with pytest.raises(ConfigError, match="no condition 'fog'; choose from bricks, "):
        list(condition_changes(["fog"]))
