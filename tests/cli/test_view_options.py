# SPDX-License-Identifier: BSD-3-Clause
"""``--view`` and ``view``: what they write and say, and what they refuse."""

import sys
from pathlib import Path

import pytest
from console import Coclo, is_one_sentence

pytest.importorskip("foxglove")
pytest.importorskip("rerun")


@pytest.mark.long
def test_run_and_compare_write_the_file_of_a_view(coclo: Coclo, leg_log: Path, tmp_path: Path) -> None:
    answer = coclo("run", leg_log, "--mode", "coclo", "-o", "out", "--view", "rerun", "--view-file", "walk.rrd")
    assert answer.status == 0
    assert "view: walk.rrd" in answer.out.splitlines()
    assert (tmp_path / "walk.rrd").stat().st_size > 100_000
    answer = coclo(
        "compare", leg_log, "--modes", "naive", "-o", "both", "--view", "foxglove", "--view-file", "walk.mcap"
    )
    assert answer.status == 0
    assert (tmp_path / "walk.mcap").read_bytes()[:5] == b"\x89MCAP"


def test_a_run_can_be_seen_afterwards(coclo: Coclo, leg_log: Path, tmp_path: Path) -> None:
    coclo("run", leg_log, "--mode", "naive", "-o", "out")
    answer = coclo("view", "out")
    assert (answer.status, answer.out) == (0, "view: out/view.mcap\n")
    assert (tmp_path / "out" / "view.mcap").stat().st_size > 10_000
    assert coclo("view", "out", "--to", "rerun", "--file", "other.rrd").status == 0
    assert (tmp_path / "other.rrd").stat().st_size > 10_000
    assert "is no run folder" in coclo("view", "nothing").err


def test_a_view_that_cannot_be_is_refused_before_anything_runs(
    coclo: Coclo, leg_log: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for options, words in (
        (("--view", "rviz"), "there is no view 'rviz'; the views are: animation, foxglove, rerun"),
        (("--view-file", "a.mcap"), "belong to a view; add --view foxglove, rerun or animation"),
        (("--view", "foxglove", "--view-file", "a.rrd"), "ends in .mcap, not 'a.rrd'"),
    ):
        answer = coclo("run", leg_log, "-o", "out", *options)
        assert answer.status == 2
        assert words in answer.err
        assert is_one_sentence(answer)
    monkeypatch.setitem(sys.modules, "foxglove", None)
    answer = coclo("run", leg_log, "-o", "out", "--view", "foxglove")
    assert answer.status == 2
    assert "needs foxglove-sdk, which is not installed: pip install 'coclo-vio[view]'" in answer.err
    assert is_one_sentence(answer)
    assert not (tmp_path / "out").exists()
    answer = coclo("compare", leg_log, leg_log, "--view", "rerun")
    assert answer.status == 2
    assert "--view shows one recording, not 2" in answer.err
