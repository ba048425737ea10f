# SPDX-License-Identifier: BSD-3-Clause
"""Which poses of a run are read where its clock was set back."""

import pytest

from coclo_vio.runs.clock_stretches import longest_stretch


def _lines(*stamps: str) -> list[str]:
    return [f"{stamp} 0 0 0 0 0 0 1" for stamp in stamps]


@pytest.mark.parametrize(
    ("stamps", "expected"),
    [
        ((), slice(None)),
        (("5",), slice(None)),
        (("1.000000001", "1.000000002", "7"), slice(None)),
        (("1", "1"), slice(None)),
        (("1700000000.000000002", "1700000000.000000001", "1700000000.000000003"), slice(1, 3)),
        (("8", "9", "10", "1", "2", "7", "11", "3"), slice(3, 7)),
        (("1", "soon", "0"), slice(None)),
        (("1", "", "0"), slice(None)),
    ],
)
def test_the_longest_stretch_of_stamps_that_increase_is_read(stamps: tuple[str, ...], expected: slice) -> None:
    lines = [line if stamp else "" for stamp, line in zip(stamps, _lines(*stamps), strict=True)]
    kept, note = longest_stretch(lines)
    assert kept == expected
    assert (note is None) == (expected == slice(None))


def test_the_note_says_how_many_are_left_out() -> None:
    _, note = longest_stretch(_lines("8", "9", "1", "2", "3"))
    assert note is not None
    assert note.startswith("2 of 5 estimates are left out")
