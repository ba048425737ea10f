# SPDX-License-Identifier: BSD-3-Clause
"""The visual modes from the command line: a recording without any robot, its real front end and smoother."""

import json
import math
from collections.abc import Iterator
from pathlib import Path

import pytest
from console import Coclo, is_one_sentence

from coclo_vio.datasets.dataset import open_dataset
from coclo_vio.datasets.images import encoded
from coclo_vio.datasets.recording_contents import RecordingContents
from coclo_vio.datasets.writer import write_euroc_folder
from coclo_vio.robot.description import load_robot
from coclo_vio.values.measurements import CameraImuSample, EncodedStereoFrame, Measurement, StereoFrame
from coclo_vio.values.units import NS_PER_S

PART_S = (1.0, 4.0)  # it stands, and walks from 2 s on


@pytest.fixture(scope="module")
def camera_recording(short_recording: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Three seconds of the short recording as a camera alone would have recorded them, with Vicon."""
    walk = open_dataset(short_recording, None)

    def part(kind: type) -> Iterator[Measurement]:
        for measurement in walk.measurements(frozenset({kind})):
            if PART_S[0] <= measurement.stamp_ns / NS_PER_S - 1.7e9 < PART_S[1]:
                yield measurement

    def frames() -> Iterator[EncodedStereoFrame]:
        for frame in part(StereoFrame):
            assert isinstance(frame, StereoFrame)
            left, right = (encoded(image, "png") for image in (frame.left, frame.right))
            yield EncodedStereoFrame(frame.stamp_ns, left, right, "png")

    contents = RecordingContents(
        load_robot("daisy"),
        part(CameraImuSample),
        ground_truth=walk.ground_truth(),
        camera_imu=walk.camera_imu_calibration(),
        stereo=walk.stereo_calibration(),
        frames=frames(),
    )
    folder = tmp_path_factory.mktemp("data") / "flight"
    write_euroc_folder(folder, contents)
    return folder


def test_a_recording_without_a_robot_is_run_by_vins(coclo: Coclo, camera_recording: Path, tmp_path: Path) -> None:
    answer = coclo("run", camera_recording, "--debug-images", "--debug-images-every", 15, "--bag", "result.mcap")
    assert answer.status == 0
    assert "no robot; results in out" in answer.err
    assert "vins: reads camera_imu, stereo" in answer.err
    assert "keyframes, median of " in answer.err
    assert (tmp_path / "result.mcap").read_bytes().startswith(b"\x89MCAP")
    frames = len(list((camera_recording / "mav0" / "cam0" / "data").iterdir()))
    assert frames > 20
    run = json.loads((tmp_path / "out" / "run.json").read_text(encoding="utf-8"))
    assert (run["robot"], list(run["estimators"])) == (None, ["vins"])
    vins = run["estimators"]["vins"]
    assert vins["failure"] is None
    assert vins["estimates"] >= frames - 16  # rest is detected over a second
    assert vins["keyframes"]["tracks_median"] > 50
    assert len(list((tmp_path / "out" / "debug_images" / "vins").iterdir())) == math.ceil(frames / 15)
    assert (tmp_path / "out" / "vins_keyframes.csv").is_file()
    [values] = json.loads(coclo("evaluate", "out", "--json").out).values()
    assert values["ate_m"] < 0.02
    assert values["coverage"] > 0.6


@pytest.mark.long
def test_its_modes_are_compared_by_default(coclo: Coclo, camera_recording: Path, tmp_path: Path) -> None:
    pytest.importorskip("matplotlib")
    answer = coclo("compare", camera_recording, "-o", "both")
    assert answer.status == 0
    compared = json.loads((tmp_path / "both" / "compare.json").read_text(encoding="utf-8"))
    assert set(compared) == {"vins", "stereo"}
    assert max(values["ate_m"] for values in compared.values()) < 0.02
    assert (tmp_path / "both" / "figures" / "keyframes.png").is_file()
    assert answer.out.startswith("flight")


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("-m", "coclo"), "has no joint, so there is no leg odometry; coclo-vio inspect lists its contents"),
        (("-m", "stereo_twist"), "flight has no body twist; a mode of stereo alone needs none"),
    ],
)
def test_what_a_mode_lacks_is_one_sentence(
    arguments: tuple[str, ...], words: str, coclo: Coclo, camera_recording: Path
) -> None:
    answer = coclo("run", camera_recording, *arguments)
    assert (answer.status, answer.out) == (1, "")
    assert words in answer.err
    assert is_one_sentence(answer)


@pytest.mark.parametrize(
    ("absent", "words"),
    [
        ("cam1/sensor.yaml", "flight has no calibration of its cameras"),
        ("imu1/sensor.yaml", "flight has no mounting of its IMU"),
        ("imu1/data.csv", "flight has no IMU; a mode of stereo alone needs none"),
    ],
)
def test_a_calibration_that_is_absent_is_one_sentence(
    absent: str, words: str, coclo: Coclo, camera_recording: Path, tmp_path: Path
) -> None:
    for path in camera_recording.rglob("*"):
        if path.is_file() and not path.as_posix().endswith(absent):
            copy = tmp_path / "flight" / path.relative_to(camera_recording)
            copy.parent.mkdir(parents=True, exist_ok=True)
            copy.symlink_to(path)
    answer = coclo("run", "flight", "-m", "vins")
    assert (answer.status, answer.out) == (1, "")
    assert words in answer.err
    assert is_one_sentence(answer)
