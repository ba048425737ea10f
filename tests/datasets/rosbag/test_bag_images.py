# SPDX-License-Identifier: BSD-3-Clause
"""Images of a bag: supported and refused encodings, and the pairing of left and right."""

from types import SimpleNamespace

import numpy as np
import pytest
from tiny_bags import KINDS, START_NS, STEP_NS, TinyBag

from coclo_vio.datasets import images
from coclo_vio.datasets.dataset import DatasetConfig, open_dataset
from coclo_vio.datasets.rosbag.stereo_pairing import RawImage, decoded_image
from coclo_vio.values.config import parse_settings
from coclo_vio.values.errors import DatasetError
from coclo_vio.values.measurements import StereoFrame

FRAMES = frozenset({StereoFrame})


@pytest.fixture(params=KINDS)
def bag(request, tmp_path):
    return TinyBag(tmp_path / request.param)


@pytest.fixture
def mcap(tmp_path):
    return TinyBag(tmp_path / "walk.mcap")


def test_images_in_several_encodings_become_the_same_grey(mcap, biped):
    grey = np.random.default_rng(5).integers(0, 256, (6, 8), dtype=np.uint8)
    colour = np.repeat(grey[:, :, None], 3, axis=2)
    padded = np.hstack((grey, np.full((6, 4), 77, dtype=np.uint8)))
    for i, (pixels, encoding, width) in enumerate(
        [(grey, "mono8", 8), (grey, "8UC1", 8), (colour, "bgr8", 8), (colour, "rgb8", 8), (padded, "mono8", 8)]
    ):
        for side in ("left", "right"):
            mcap.add_image(START_NS + i * STEP_NS, f"/cam/{side}/image", pixels, encoding, width=width)
    frames = list(open_dataset(mcap.write(), biped).measurements(FRAMES))
    assert len(frames) == 5
    for frame in frames:
        np.testing.assert_array_equal(frame.left, grey)
        np.testing.assert_array_equal(frame.right, grey)


def test_colours_are_weighted_by_their_encoding(mcap, biped):
    red = np.zeros((2, 2, 3), dtype=np.uint8)
    red[..., 0] = 255
    mcap.add_image(START_NS, "/left/image", red, "rgb8")
    mcap.add_image(START_NS, "/right/image", red, "bgr8")
    (frame,) = open_dataset(mcap.write(), biped).measurements(FRAMES)
    assert (frame.left[0, 0], frame.right[0, 0]) == (76, 29)  # 0.299 of red, 0.114 of blue


@pytest.mark.parametrize("encoding", ["mono16", "16UC1", "bayer_rggb8", "32FC1"])
def test_unsupported_encodings_are_refused_with_those_supported(bag, biped, encoding):
    for side in ("left", "right"):
        bag.add_image(START_NS, f"/{side}/image", np.zeros((2, 2), dtype=np.uint16), encoding)
    with pytest.raises(DatasetError, match=rf"/left/image .*{encoding}.*supported are mono8, 8UC1, bgr8, rgb8"):
        list(open_dataset(bag.write(), biped).measurements(FRAMES))


def test_compressed_images_are_decoded_and_16_bits_refused(mcap, biped):
    grey = np.random.default_rng(6).integers(0, 256, (6, 8), dtype=np.uint8)
    kind = "sensor_msgs/msg/CompressedImage"
    for i, pixels in enumerate((grey, grey.astype(np.uint16))):
        data = np.frombuffer(images.encoded(pixels, "png"), dtype=np.uint8)
        for side in ("left", "right"):
            mcap.add(f"/{side}/image/compressed", kind, START_NS + i * STEP_NS, format="png", data=data)
    stream = open_dataset(mcap.write(), biped).measurements(FRAMES)
    np.testing.assert_array_equal(next(stream).left, grey)
    with pytest.raises(DatasetError, match=r"/left/image/compressed.*uint16"):
        next(stream)


def test_a_message_without_the_fields_of_an_image_is_refused():
    bag = SimpleNamespace(origin="walk.mcap", decoded=lambda topic, data: SimpleNamespace(format="png"))
    with pytest.raises(DatasetError, match="/left/image at 5 ns has other fields than an image"):
        decoded_image(bag, RawImage(5, 5, "/left/image", b""))


def test_images_are_paired_by_stamp_and_the_others_counted(bag, biped):
    grey = np.zeros((2, 2), dtype=np.uint8)
    for i in range(6):
        stamp_ns = START_NS + i * 40_000_000
        if i != 2:
            bag.add_image(stamp_ns, "/left/image_raw", grey)
        if i != 4:
            bag.add_image(stamp_ns + 100_000, "/right/image_raw", grey)
    dataset = open_dataset(bag.write(), biped)
    frames = list(dataset.measurements(FRAMES))
    assert [(frame.stamp_ns - START_NS) // 40_000_000 for frame in frames] == [0, 1, 3, 5]
    assert sum(dataset.report().dropped.values()) == 2
    strict = open_dataset(bag.path, biped, DatasetConfig.parse(parse_settings(["rosbag.pair_tolerance_s=0"]), "test"))
    assert list(strict.measurements(FRAMES)) == []


def test_a_camera_that_stops_does_not_hold_the_images_of_the_other(mcap, biped):
    grey = np.zeros((2, 2), dtype=np.uint8)
    for i in range(200):
        mcap.add_image(START_NS + i * STEP_NS, "/left/image_raw", grey)
    mcap.add_image(START_NS + 199 * STEP_NS, "/right/image_raw", grey)
    report = open_dataset(mcap.write(), biped).report()
    assert report.stream("stereo").samples == 1
    assert report.dropped == {"/left/image_raw: no image of the other camera at this stamp": 199}


@pytest.mark.parametrize("apart_ms", [4, 16])
def test_stamps_that_never_meet_are_noted_with_their_difference_and_the_setting(tmp_path, apart_ms):
    bag = TinyBag(tmp_path / "walk.mcap")
    for i in range(20):
        for side, late_ns in (("left", 0), ("right", apart_ms * 1_000_000)):
            pixels = np.full((2, 2), i, dtype=np.uint8)
            bag.add_image(START_NS + i * 5 * STEP_NS + late_ns, f"/{side}/image", pixels)
    path = bag.write()
    sentence = (
        rf"left and right images: 0 of 40 have a partner; .* {apart_ms} ms apart .*dataset\.rosbag\.pair_tolerance_s"
    )
    with pytest.raises(DatasetError, match=sentence):
        open_dataset(path, None).report()
    config = DatasetConfig.parse(parse_settings(["rosbag.pair_tolerance_s=0.02"]), "test")
    report = open_dataset(path, None, config).report()
    assert report.stream("stereo").samples == 20
    assert not any("have a partner" in note for note in report.notes)
