# SPDX-License-Identifier: BSD-3-Clause
"""The visual modes from the command line: a recording without any robot, its real front end and smoother."""

import json
from collections.abc import Iterator
from pathlib import Path

import pytest
from console import Coclo, is_one_sentence

from coclo_vio.datasets.recording_contents import RecordingContents
from coclo_vio.datasets.dataset import open_dataset
from coclo_vio.datasets.images import encoded
from coclo_vio.datasets.sample import sample_path
from coclo_vio.datasets.writer import write_euroc_folder
from coclo_vio.robot.description import load_robot
from coclo_vio.values.measurements import CameraImuSample, EncodedStereoFrame, Measurement, StereoFrame

PART_S = (4.5, 7.5)  # it stands, and walks
FRAMES = 45


@pytest.fixture(scope="module")
def film(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Three seconds of the bundled recording as a camera alone would have made it, with Vicon."""
    sample = open_dataset(sample_path(), None)

    def part(kind: type) -> Iterator[Measurement]:
        for measurement in sample.measurements(frozenset({kind})):
            if PART_S[0] <= measurement.stamp_ns * 1e-9 - 1.7e9 < PART_S[1]:
                yield measurement

    def frames() -> Iterator[EncodedStereoFrame]:
        for frame in part(StereoFrame):
            assert isinstance(frame, StereoFrame)
            left, right = (encoded(image, "png") for image in (frame.left, frame.right))
            yield EncodedStereoFrame(frame.stamp_ns, left, right, "png")

    contents = RecordingContents(
        load_robot("daisy"),
        part(CameraImuSample),
        ground_truth=sample.ground_truth(),
        camera_imu=sample.camera_imu_calibration(),
        stereo=sample.stereo_calibration(),
        frames=frames(),
    )
    folder = tmp_path_factory.mktemp("data") / "film"
    write_euroc_folder(folder, contents)
    return folder


def test_a_recording_without_a_robot_is_seen_through(coclo: Coclo, film: Path, tmp_path: Path) -> None:
    answer = coclo("run", film, "--debug-images", "--debug-images-every", 15, "--bag", "seen.mcap")
    assert answer.status == 0
    assert "no robot; results in out" in answer.err
    assert "vins: sees with camera_imu, stereo" in answer.err
    assert "keyframes, in the median" in answer.err
    assert (tmp_path / "seen.mcap").read_bytes().startswith(b"\x89MCAP")
    run = json.loads((tmp_path / "out" / "run.json").read_text(encoding="utf-8"))
    assert (run["robot"], list(run["estimators"])) == (None, ["vins"])
    vins = run["estimators"]["vins"]
    assert vins["failure"] is None
    assert vins["estimates"] >= FRAMES - 16  # a second for rest to be told
    assert vins["keyframes"]["tracks_median"] > 50
    assert len(list((tmp_path / "out" / "debug_images" / "vins").iterdir())) == FRAMES // 15
    assert (tmp_path / "out" / "vins_keyframes.csv").is_file()
    [values] = json.loads(coclo("evaluate", "out", "--json").out).values()
    assert values["ate_m"] < 0.02
    assert values["coverage"] > 0.6


def test_its_modes_are_compared_by_default(coclo: Coclo, film: Path, tmp_path: Path) -> None:
    pytest.importorskip("matplotlib")
    answer = coclo("compare", film, "-o", "both")
    assert answer.status == 0
    compared = json.loads((tmp_path / "both" / "compare.json").read_text(encoding="utf-8"))
    assert set(compared) == {"vins", "stereo"}
    assert max(values["ate_m"] for values in compared.values()) < 0.02
    assert (tmp_path / "both" / "figures" / "keyframes.png").is_file()
    assert answer.out.startswith("film")


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("-m", "coclo"), "has no joint, so no leg can be followed; coclo-vio inspect says what it has"),
        (("-m", "stereo_twist"), "film has no body twist; the mode stereo does without"),
    ],
)
def test_what_a_mode_lacks_is_one_sentence(arguments: tuple[str, ...], words: str, coclo: Coclo, film: Path) -> None:
    answer = coclo("run", film, *arguments)
    assert (answer.status, answer.out) == (1, "")
    assert words in answer.err
    assert is_one_sentence(answer)


@pytest.mark.parametrize(
    ("absent", "words"),
    [
        ("cam1/sensor.yaml", "film does not say how its cameras are made and mounted"),
        ("imu1/sensor.yaml", "film does not say how its IMU is mounted"),
        ("imu1/data.csv", "film has no IMU; the mode stereo does without"),
    ],
)
def test_a_calibration_that_is_absent_is_one_sentence(
    absent: str, words: str, coclo: Coclo, film: Path, tmp_path: Path
) -> None:
    for path in film.rglob("*"):
        if path.is_file() and not path.as_posix().endswith(absent):
            copy = tmp_path / "film" / path.relative_to(film)
            copy.parent.mkdir(parents=True, exist_ok=True)
            copy.symlink_to(path)
    answer = coclo("run", "film", "-m", "vins")
    assert (answer.status, answer.out) == (1, "")
    assert words in answer.err
    assert is_one_sentence(answer)
