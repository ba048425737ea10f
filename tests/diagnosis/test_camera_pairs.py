# SPDX-License-Identifier: BSD-3-Clause
"""A calibration of the right camera that is off, by the rows of the bundled recording's images."""

from itertools import islice
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from coclo_vio.datasets.dataset import open_dataset
from coclo_vio.datasets.sample import sample_path
from coclo_vio.diagnosis.checks.camera_pairs import find_pairs
from coclo_vio.diagnosis.evidence import Evidence
from coclo_vio.diagnosis.finding import Finding
from coclo_vio.geometry import se3, so3
from coclo_vio.robot.description import load_robot
from coclo_vio.values.arrays import Array
from coclo_vio.values.calibration import StereoCalibration
from coclo_vio.values.measurements import StereoFrame

Images = tuple[StereoCalibration, list[StereoFrame]]


@pytest.fixture(scope="module")
def images() -> Images:
    dataset = open_dataset(sample_path(), load_robot("daisy"))
    stereo = dataset.stereo_calibration()
    assert stereo is not None
    stream = dataset.measurements(frozenset({StereoFrame}))
    return stereo, [frame for frame in islice(stream, 4) if isinstance(frame, StereoFrame)]


def found(images: Images, turn: Array) -> list[Finding]:
    """The findings where the calibration has the right camera turned by so much against its images, rad."""
    stereo, frames = images
    turned = stereo.T_body_right_camera @ se3.transform(so3.exp(turn), np.zeros(3))
    calibration = stereo.model_copy(update={"body_right_camera": tuple(map(tuple, turned.tolist()))})
    evidence = SimpleNamespace(calibrations=SimpleNamespace(stereo=calibration), frames=lambda most, every: frames)
    return list(find_pairs(cast(Evidence, cast(Any, evidence))))


def test_a_good_calibration_is_not_blamed(images: Images) -> None:
    assert not found(images, np.zeros(3))


def test_a_right_camera_that_is_rolled_against_its_calibration_is_named_with_the_angle(images: Images) -> None:
    (finding,) = found(images, np.array([0.0, 0.0, 0.009]))
    assert (finding.kind, finding.is_error) == ("pair_calibration", False)
    words = finding.sentence.split()
    assert float(words[words.index("mrad") - 1]) == pytest.approx(9.0, abs=1.5)
