# SPDX-License-Identifier: BSD-3-Clause
"""``play``: a table of times, latency.json in the run folder, errors in one sentence."""

import json
from pathlib import Path

import pytest
from console import Coclo, is_one_sentence


@pytest.mark.long
def test_play_prints_times_and_writes_them(coclo: Coclo, leg_log: Path, tmp_path: Path) -> None:
    answer = coclo("play", leg_log, "--mode", "coclo", "--rate", 20, "--seconds", 6, "-o", tmp_path / "out")
    assert answer.status == 0, answer.err
    assert "times of coclo at rate 20" in answer.out
    written = json.loads((tmp_path / "out" / "latency.json").read_text())
    assert written["measurements"]["joints"] > 100
    run = json.loads((tmp_path / "out" / "run.json").read_text())
    assert run["estimators"]["coclo"]["estimates"] > 100
    assert "process estimator: " in answer.err


@pytest.mark.long
def test_a_play_can_be_seen(coclo: Coclo, leg_log: Path, tmp_path: Path) -> None:
    shown = ("--view", "foxglove", "--view-file", "play.mcap")
    answer = coclo("play", leg_log, "-m", "naive", "--rate", 20, "--seconds", 2, *shown)
    assert answer.status == 0, answer.err
    assert "view: play.mcap" in answer.out.splitlines()
    assert (tmp_path / "play.mcap").stat().st_size > 50_000, "the robot and its joints"


@pytest.mark.long
def test_what_was_played_is_replaced_only_on_request(coclo: Coclo, leg_log: Path, tmp_path: Path) -> None:
    arguments = ("play", leg_log, "-m", "naive", "--rate", 20, "--seconds", 1)
    assert coclo(*arguments).status == 0
    recording_ns = json.loads((tmp_path / "out" / "run.json").read_text())["recording_ns"]
    assert recording_ns[1] - recording_ns[0] <= 1_000_000_000, "what was played, not what the recording has"
    refused = coclo(*arguments)
    assert refused.status == 1
    assert is_one_sentence(refused)
    assert "give --overwrite to replace them, or another folder with -o" in refused.err
    assert coclo(*arguments, "--overwrite").status == 0
    assert coclo("run", leg_log, "-m", "naive", "--overwrite").status == 0
    assert not (tmp_path / "out" / "latency.json").exists(), "it was that of another run"


def test_a_rate_that_is_not_positive_is_a_misuse(coclo: Coclo, leg_log: Path) -> None:
    answer = coclo("play", leg_log, "--rate", -1)
    assert answer.status == 2
    assert is_one_sentence(answer)
    assert "rate = -1" in answer.err
