# SPDX-License-Identifier: BSD-3-Clause
"""Images of two cameras by their stamps, also where one stamp cannot be."""

import pytest

from coclo_vio.datasets.read_report import ReadTally
from coclo_vio.datasets.rosbag.stereo_pairing import RawImage, StereoPairer


def _paired(*images: tuple[str, int]) -> tuple[list[tuple[int, int]], int]:
    """Stamps of the pairs, and how many images were dropped, of images that came in this order."""
    tally = ReadTally("bag", 0.1)
    pairer = StereoPairer("left", 2, tally)
    pairs = [pair for side, at_ns in images for pair in pairer.push(RawImage(at_ns, at_ns, side, b""))]
    return [(pair.left.stamp_ns, pair.right.stamp_ns) for pair in pairs], sum(tally.dropped.values())


def test_images_within_the_tolerance_are_a_pair_and_others_are_dropped() -> None:
    assert _paired(("left", 10), ("right", 12), ("right", 20), ("left", 30), ("right", 30)) == ([(10, 12), (30, 30)], 1)


@pytest.mark.parametrize("side", ["left", "right"])
def test_an_image_with_a_stamp_of_the_future_costs_no_other_frame(side: str) -> None:
    other = "right" if side == "left" else "left"
    images = [(side, 10**6), (other, 10)]
    for at_ns in range(20, 120, 10):
        images += [(side, at_ns), (other, at_ns)]
    pairs, dropped = _paired(*images)
    assert pairs == [(at_ns, at_ns) for at_ns in range(20, 120, 10)]
    assert dropped == 2


def test_a_clock_that_is_set_back_between_two_images_costs_one_frame() -> None:
    images = [("left", 1000), ("right", 1000), ("left", 1010), ("right", 10)]
    for at_ns in range(20, 80, 10):
        images += [("left", at_ns), ("right", at_ns)]
    pairs, _ = _paired(*images)
    assert pairs == [(1000, 1000), *((at_ns, at_ns) for at_ns in range(20, 80, 10))]
