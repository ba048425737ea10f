# SPDX-License-Identifier: BSD-3-Clause
"""Keyframes, learnt calibrations and pictures on the disk."""

from collections.abc import Callable
from dataclasses import astuple
from pathlib import Path

import numpy as np
import pytest

from coclo_vio.datasets.images import decoded
from coclo_vio.runs.output_logs import (
    CalibrationWriter,
    KeyframeWriter,
    PictureWriter,
    keyframes_path,
    read_calibrations,
    read_health,
    read_keyframes,
)
from coclo_vio.values.errors import DatasetError
from coclo_vio.values.outputs import Calibration, KeyframeHealth, Picture

START_NS = 1_700_000_000_123_456_789  # no float of nanoseconds holds it


def keyframes(count: int = 21) -> list[KeyframeHealth]:
    return [
        KeyframeHealth(START_NS + n * 200_000_001, 10, 100 + n, 300, 1500, 0.1 * n, n % 4, 0.001 * n, 1e3)
        for n in range(count)
    ]


def written(folder: Path, healths: list[KeyframeHealth]) -> KeyframeWriter:
    writer = KeyframeWriter(folder, "vins")
    for health in healths:
        writer.write(health)
    writer.close()
    return writer


def test_keyframes_are_read_as_they_were_written(tmp_path: Path) -> None:
    written(tmp_path, keyframes())
    columns = read_keyframes(tmp_path, "vins")
    assert columns is not None
    assert list(columns) == list(KeyframeHealth.__slots__)
    table = np.array([astuple(health) for health in keyframes()], dtype=np.float64)
    np.testing.assert_allclose(np.stack(list(columns.values()), axis=1), table, rtol=1e-9)
    assert (tmp_path / "vins_keyframes.csv").read_text(encoding="ascii").splitlines()[1].startswith(f"{START_NS},")


def test_keyframes_have_every_nanosecond_of_their_stamps(tmp_path: Path) -> None:
    written(tmp_path, keyframes())
    back = read_health(tmp_path, "vins")
    assert [health.stamp_ns for health in back] == [health.stamp_ns for health in keyframes()]
    assert back[4] == keyframes()[4]
    assert read_health(tmp_path, "coclo") == ()


def test_keyframes_are_summed_up(tmp_path: Path) -> None:
    summary = written(tmp_path, keyframes()).summary()
    assert summary is not None
    assert summary.count == 21
    assert (summary.tracks_median, summary.tracks_p95) == (110.0, 119.0)
    assert summary.reprojection_px_median == pytest.approx(1.0)
    assert summary.compute_ms_p95 == pytest.approx(19.0)
    assert summary.iterations_median == 1.0


def test_a_figure_that_no_keyframe_has_is_none(tmp_path: Path) -> None:
    summary = written(tmp_path, [KeyframeHealth(0, 1, 0, 0, 3, float("nan"), 0, 0.001, float("inf"))]).summary()
    assert summary is not None
    assert summary.reprojection_px_median is None
    assert summary.compute_ms_median == pytest.approx(1.0)
    [health] = read_health(tmp_path, "vins")
    assert np.isnan(health.reprojection_px)
    assert health.condition == float("inf")


def test_without_keyframes_there_is_no_file(tmp_path: Path) -> None:
    assert written(tmp_path, []).summary() is None
    assert list(tmp_path.iterdir()) == []
    assert read_keyframes(tmp_path, "vins") is None


HEADER = ",".join(KeyframeHealth.__slots__)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("\n", "its columns are none, they must be stamp_ns,keyframes"),
        ("stamp_ns,tracks\n1,2\n", "its columns are stamp_ns,tracks, they must be stamp_ns,keyframes"),
        (f"{HEADER}\n1,2,3\n", "line 2 has 3 cells under a header of 9 columns"),
        (f"{HEADER}\n1,2,3,4,5,x,7,8,9\n", "could not convert string to float: 'x'"),
    ],
)
@pytest.mark.parametrize("read", [read_keyframes, read_health])
def test_a_malformed_file_of_keyframes_is_named_with_the_next_step(
    read: Callable[[Path, str], object], text: str, words: str, tmp_path: Path
) -> None:
    keyframes_path(tmp_path, "vins").write_text(text, encoding="ascii")
    with pytest.raises(DatasetError, match=rf"vins_keyframes\.csv: {words}.*; run again, or delete it to do without"):
        read(tmp_path, "vins")


def test_a_file_of_keyframes_that_broke_off_after_its_header_has_none(tmp_path: Path) -> None:
    keyframes_path(tmp_path, "vins").write_text(HEADER + "\n", encoding="ascii")
    columns = read_keyframes(tmp_path, "vins")
    assert columns is not None
    assert {len(values) for values in columns.values()} == {0}
    assert read_health(tmp_path, "vins") == ()


@pytest.mark.parametrize("kept", [0, 1, 2])
def test_a_last_row_that_was_cut_short_is_left_out_and_logged(
    kept: int, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    rows = [HEADER, "1,2,3,4,5,6,7,8,9", "11,12,13,14,15,16,17,18,19"]
    keyframes_path(tmp_path, "vins").write_text("\n".join([*rows[:kept], rows[kept][:7]]), encoding="ascii")
    assert [health.stamp_ns for health in read_health(tmp_path, "vins")] == [1][: max(0, kept - 1)]
    assert f"the last line of vins_keyframes.csv, line {kept + 1}, was cut short and is left out" in caplog.text


def calibrations() -> list[Calibration]:
    return [
        Calibration(START_NS + n, np.array([0.01, -0.02, 0.03]) * n, np.full(3, 0.1 / (1 + n)), 1.0 + 0.001 * n, 0.01)
        for n in range(4)
    ]


def test_calibrations_are_read_as_they_were_written(tmp_path: Path) -> None:
    writer = CalibrationWriter(tmp_path, "combined_coclo")
    for calibration in calibrations():
        writer.write(calibration)
    writer.close()
    assert writer.last is not None
    assert writer.last.stamp_ns == START_NS + 3
    for back, calibration in zip(read_calibrations(tmp_path, "combined_coclo"), calibrations(), strict=True):
        assert back.stamp_ns == calibration.stamp_ns
        np.testing.assert_allclose(back.rotation_body, calibration.rotation_body, rtol=1e-8)
        np.testing.assert_allclose(back.rotation_sigma, calibration.rotation_sigma, rtol=1e-8)
        assert back.stereo_scale == pytest.approx(calibration.stereo_scale, rel=1e-8)
        assert back.stereo_scale_sigma == pytest.approx(calibration.stereo_scale_sigma, rel=1e-8)


def test_without_a_calibration_there_is_no_file(tmp_path: Path) -> None:
    writer = CalibrationWriter(tmp_path, "coclo")
    writer.close()
    assert writer.last is None
    assert list(tmp_path.iterdir()) == []
    assert read_calibrations(tmp_path, "coclo") == ()


@pytest.mark.parametrize(
    ("spoil", "words"),
    [
        (lambda text: "\n", "its columns are none"),
        (lambda text: text.replace("stereo_scale_sigma", "sigma"), "its columns are stamp_ns,.*, they must be"),
        (lambda text: text[: text.rindex(",")] + "\n", "line 5 has 8 cells under a header of 9 columns"),
        (lambda text: text.replace(",1.003,", ",much,"), "could not convert string to float: 'much'"),
        (lambda text: text.replace(",0.03,", ",0.03,nan,").replace("nan,0.1,", "nan,"), "cells|nan|finite"),
    ],
)
def test_a_malformed_file_of_calibrations_is_named_with_the_next_step(
    spoil: Callable[[str], str], words: str, tmp_path: Path
) -> None:
    writer = CalibrationWriter(tmp_path, "combined_coclo")
    for calibration in calibrations():
        writer.write(calibration)
    writer.close()
    path = tmp_path / "combined_coclo_calibration.csv"
    path.write_text(spoil(path.read_text(encoding="ascii")), encoding="ascii")
    with pytest.raises(DatasetError, match=rf"combined_coclo_calibration\.csv: .*({words}).*; run again, or delete it"):
        read_calibrations(tmp_path, "combined_coclo")


def test_pictures_are_named_by_their_stamps(tmp_path: Path) -> None:
    writer = PictureWriter(tmp_path, "vins")
    assert not (tmp_path / "debug_images").exists()
    writer.write(Picture(START_NS, np.full((12, 16, 3), 200, dtype=np.uint8)))
    [path] = (tmp_path / "debug_images" / "vins").iterdir()
    assert path.name == f"{START_NS}.jpg"
    assert decoded(path.read_bytes(), "picture").shape == (12, 16)
    assert writer.written == 1
