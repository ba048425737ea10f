# SPDX-License-Identifier: BSD-3-Clause
import numpy as np
import pytest

from coclo_vio.datasets import images
from coclo_vio.values.errors import DatasetError


@pytest.fixture
def image():
    smooth = np.add.outer(np.arange(48.0), 2 * np.arange(64.0))
    return (smooth + np.random.default_rng(3).integers(0, 9, smooth.shape)).astype(np.uint8)


def test_png_keeps_every_pixel_and_jpeg_nearly(image):
    np.testing.assert_array_equal(images.decoded(images.encoded(image, "png"), "made"), image)
    jpeg = images.decoded(images.encoded(image, "jpeg"), "made")
    assert jpeg.shape == image.shape
    assert np.abs(jpeg.astype(int) - image).max() <= 16
    assert not np.array_equal(jpeg, image)


def test_the_same_image_is_the_same_file(image):
    assert images.encoded(image, "png") == images.encoded(image.copy(), "png")


def test_an_image_without_pixels_cannot_be_written():
    with pytest.raises(DatasetError, match="cannot write an image"):
        images.encoded(np.zeros((0, 4), dtype=np.uint8), "png")


def test_unsupported_channels_are_refused():
    with pytest.raises(DatasetError, match="2 channels"):
        images.grey(np.zeros((4, 4, 2), dtype=np.uint8), "odd.tif")
