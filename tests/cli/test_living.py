# SPDX-License-Identifier: BSD-3-Clause
"""``live`` from the command line: a finished file as a source, and what it answers to mistakes."""

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from console import Coclo, is_one_sentence

from coclo_vio.api.recording import open_recording
from coclo_vio.live.live_record import read_live_record
from coclo_vio.runs.run_folder import read_estimates
from coclo_vio.values.trajectory import write_tum


@pytest.mark.long
def test_a_file_that_is_complete_is_run_to_its_end(coclo: Coclo, short_recording: Path, tmp_path: Path) -> None:
    answer = coclo(
        "live", "-s", "file", "--endpoint", short_recording, "-m", "coclo", "-r", "daisy", "-o", "out",
        "--set", "live.first_messages_s=0.2", "--set", "live.most_messages=100000",
    )  # fmt: skip
    assert answer.status == 0, answer.err
    assert "/joint_states: 600 received, 0 lost" in answer.out
    record = read_live_record(tmp_path / "out")
    assert record.topics["/joint_states"].received == 600
    again = coclo("live", "-s", "file", "--endpoint", short_recording, "-m", "coclo", "-r", "daisy", "-o", "out")
    assert (again.status, again.out) == (1, "")
    assert "out holds the results of an earlier run (run.json)" in again.err
    assert "--resume" not in again.err
    assert coclo("run", short_recording, "-m", "coclo", "-r", "daisy", "-o", "ref").status == 0
    live, run = (read_estimates(tmp_path / name, "coclo").trajectory for name in ("out", "ref"))
    shared, of_live, of_run = np.intersect1d(live.stamps_ns, run.stamps_ns, return_indices=True)
    assert len(shared) > 540
    np.testing.assert_allclose(live.positions[of_live], run.positions[of_run], atol=2e-3)


def test_messages_that_are_left_out_before_the_start_are_counted_and_a_run_can_be_seen(
    coclo: Coclo, short_recording: Path, tmp_path: Path
) -> None:
    answer = coclo(
        "live", "-s", "file", "--endpoint", short_recording, "-m", "coclo", "-r", "daisy", "-o", "out",
        "--set", "live.first_messages_s=1", "--set", "live.most_messages=100",
        "--view", "foxglove", "--view-file", "live.mcap",
    )  # fmt: skip
    assert answer.status == 0, answer.err
    assert "view: live.mcap" in answer.out.splitlines()
    assert (tmp_path / "live.mcap").stat().st_size > 50_000, "the robot and its joints"
    topics = read_live_record(tmp_path / "out").topics
    assert topics["/joint_states"].dropped > 300
    taken = json.loads((tmp_path / "out" / "run.json").read_text())["estimators"]["coclo"]["measurements"]
    assert taken == sum(one.received - one.dropped for one in topics.values())


@pytest.mark.long
def test_what_a_kill_leaves_can_be_evaluated(coclo: Coclo, short_recording: Path, tmp_path: Path) -> None:
    data = short_recording.read_bytes()
    (tmp_path / "growing.mcap").write_bytes(data[: len(data) * 4 // 5])  # its writer goes on, as it seems
    live = ["-s", "file", "--endpoint", "growing.mcap", "-m", "coclo", "-r", "daisy", "--set"]
    live += ["live.first_messages_s=0.2"]
    process = subprocess.Popen([sys.executable, "-m", "coclo_vio", "live", *live], cwd=tmp_path)
    out, end_s = tmp_path / "out", time.monotonic() + 90.0
    while time.monotonic() < end_s and not (_lines(out / "coclo.tum") > 300 and (out / "live.json").is_file()):
        time.sleep(0.05)
    running = json.loads((out / "run.json").read_text())
    assert process.poll() is None
    os.kill(process.pid, signal.SIGKILL)
    process.wait()
    assert (running["status"], running["estimators"]["coclo"]["status"]) == ("running", "running")
    assert (out / "coclo_state.csv").read_bytes().endswith(b"\n")
    truth = open_recording(short_recording, "daisy").ground_truth()
    assert truth is not None
    write_tum(truth.trajectory, tmp_path / "truth.tum")
    answer = coclo("evaluate", "out", "--vicon", "truth.tum", "--json")
    assert answer.status == 0, answer.err
    measured = json.loads(answer.out)["coclo"]
    assert any("was killed, or is still going on" in note for note in measured["notes"])
    assert coclo("evaluate", "out").status == 1, "it has no ground truth of its own"
    assert "an earlier run (run.json)" in coclo("live", *live).err
    recorded = open_recording(out / "recording", "daisy", settings=["dataset.allow_partial=true"])
    assert sum(1 for _ in recorded.measurements()) > 300, "what came has been recorded"


def _lines(path: Path) -> int:
    return path.read_bytes().count(b"\n") if path.is_file() else 0


@pytest.mark.parametrize(
    ("arguments", "status", "words"),
    [
        (("-s", "mqtt", "-m", "coclo"), 2, "zenoh, dds, unitree, file"),
        (("-s", "file", "-m", "coclo", "-r", "daisy"), 2, "--endpoint"),
        (("-s", "file", "--endpoint", "walk.bag", "-m", "coclo", "-r", "daisy"), 2, ".mcap, .csv or .jsonl"),
        (("-s", "unitree", "-m", "coclo"), 2, "--robot"),
        (("-s", "file", "--endpoint", "a.mcap", "-m", "vins", "--view", "rviz"), 2, "foxglove, rerun"),
        (("-s", "file", "--endpoint", "a.mcap", "-m", "vins", "--view-port", "8765"), 2, "add --view foxglove"),
        (("-s", "zenoh", "-m", "no_such_mode"), 2, "no_such_mode"),
        (("-s", "file", "--endpoint", "none.mcap", "-m", "vins", "--set", "live.wait_s=0.3"), 1, "live.wait_s"),
    ],
)
def test_a_mistake_is_named_in_a_sentence(coclo: Coclo, arguments: tuple[str, ...], status: int, words: str) -> None:
    answer = coclo("live", *arguments)
    assert answer.status == status, answer.out
    assert is_one_sentence(answer)
    assert words in answer.err
