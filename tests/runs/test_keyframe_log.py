# SPDX-License-Identifier: BSD-3-Clause
"""Keyframes and pictures on the disk."""

from dataclasses import astuple
from pathlib import Path

import numpy as np
import pytest

from coclo_vio.datasets.images import decoded
from coclo_vio.runs.keyframe_log import KeyframeWriter, PictureWriter, keyframes_path, read_keyframes
from coclo_vio.values.errors import DatasetError
from coclo_vio.values.outputs import KeyframeHealth

START_NS = 1_700_000_000_123_456_789


def keyframes(count: int = 21) -> list[KeyframeHealth]:
    return [
        KeyframeHealth(START_NS + n * 200_000_000, 10, 100 + n, 300, 1500, 0.1 * n, n % 4, 0.001 * n, 1e3)
        for n in range(count)
    ]


def test_keyframes_are_read_as_they_were_written(tmp_path: Path) -> None:
    with KeyframeWriter(tmp_path, "vins") as writer:
        for health in keyframes():
            writer.write(health)
    columns = read_keyframes(tmp_path, "vins")
    assert columns is not None
    assert list(columns) == list(KeyframeHealth.__slots__)
    table = np.array([astuple(health) for health in keyframes()], dtype=np.float64)
    np.testing.assert_allclose(np.stack(list(columns.values()), axis=1), table, rtol=1e-9)
    assert (tmp_path / "vins_keyframes.csv").read_text(encoding="ascii").splitlines()[1].startswith(f"{START_NS},")


def test_they_are_summed_up(tmp_path: Path) -> None:
    with KeyframeWriter(tmp_path, "vins") as writer:
        for health in keyframes():
            writer.write(health)
        told = writer.summary()
    assert told is not None
    assert told["count"] == 21
    assert (told["tracks_median"], told["tracks_p95"]) == (110.0, 119.0)
    assert told["reprojection_px_median"] == pytest.approx(1.0)
    assert told["compute_ms_p95"] == pytest.approx(19.0)
    assert told["iterations_median"] == 1.0


def test_what_no_keyframe_knew_is_unknown(tmp_path: Path) -> None:
    with KeyframeWriter(tmp_path, "vins") as writer:
        writer.write(KeyframeHealth(0, 1, 0, 0, 3, float("nan"), 0, 0.001, float("inf")))
        told = writer.summary()
    assert told is not None
    assert told["reprojection_px_median"] is None
    assert told["compute_ms_median"] == pytest.approx(1.0)


def test_without_keyframes_there_is_no_file(tmp_path: Path) -> None:
    with KeyframeWriter(tmp_path, "coclo") as writer:
        assert writer.summary() is None
    assert list(tmp_path.iterdir()) == []
    assert read_keyframes(tmp_path, "coclo") is None


@pytest.mark.parametrize("text", ["", "stamp_ns,tracks\n1,2\n", "not a number\nx\n"])
def test_a_spoilt_file_is_told(text: str, tmp_path: Path) -> None:
    keyframes_path(tmp_path, "vins").write_text(text, encoding="ascii")
    with pytest.raises(DatasetError, match=r"vins_keyframes\.csv.*run again, or delete it"):
        read_keyframes(tmp_path, "vins")


def test_pictures_are_called_by_their_stamps(tmp_path: Path) -> None:
    writer = PictureWriter(tmp_path, "vins")
    assert not (tmp_path / "debug_images").exists()
    writer.write(START_NS, np.full((12, 16, 3), 200, dtype=np.uint8))
    [path] = (tmp_path / "debug_images" / "vins").iterdir()
    assert path.name == f"{START_NS}.jpg"
    assert decoded(path.read_bytes(), "picture").shape == (12, 16)
    assert writer.written == 1
