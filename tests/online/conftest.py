# SPDX-License-Identifier: BSD-3-Clause
from collections.abc import Sequence

import pytest
from damaged_streams import beginning

import coclo_vio as cv
from coclo_vio.values.measurements import ALL_SENSORS, IMAGE_SENSORS

LENGTH_S = 8.0  # two seconds of standing, then walking


@pytest.fixture(scope="session")
def sample() -> cv.Recording:
    """The bundled recording."""
    return cv.open(cv.sample_path(), robot="daisy")


@pytest.fixture(scope="session")
def walk(sample: cv.Recording) -> Sequence[cv.Measurement]:
    """The first seconds of the bundled recording without its images."""
    return beginning(sample, ALL_SENSORS - IMAGE_SENSORS, LENGTH_S)


@pytest.fixture(scope="session")
def walk_with_images(sample: cv.Recording) -> Sequence[cv.Measurement]:
    """The first five seconds of the bundled recording."""
    return beginning(sample, ALL_SENSORS, 4.0)
