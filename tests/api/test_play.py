# SPDX-License-Identifier: BSD-3-Clause
"""A recording played by its stamps: all joints arrive, results as in a run, times in latency.json."""

import subprocess
import sys
from pathlib import Path

import pytest

import coclo_vio as cv
from coclo_vio.runs.latency import LatencyRecord
from coclo_vio.runs.paced_play import LATENCY_JSON, paced_feed


class Noting:
    """A sink that notes what it gets."""

    def __init__(self) -> None:
        self.outputs: list[cv.Output] = []
        self.is_closed = False

    def take(self, output: cv.Output) -> None:
        assert not self.is_closed
        self.outputs.append(output)

    def close(self) -> None:
        self.is_closed = True


@pytest.fixture(scope="module")
def played(go1_walk: Path, tmp_path_factory: pytest.TempPathFactory) -> tuple[cv.Play, Noting]:
    """The walk at half the speed, with vision beside the filter."""
    sink = Noting()
    folder = tmp_path_factory.mktemp("played")
    return cv.play(cv.open(go1_walk, robot="go1"), "combined", rate=0.5, folder=folder, sink=sink), sink


def test_no_joint_sample_is_lost_and_the_record_says_when_they_came(
    played: tuple[cv.Play, Noting], combined_run: cv.Run
) -> None:
    play, _ = played
    expected = combined_run.record.estimators["combined_coclo"]
    assert play.run.record.estimators["combined_coclo"].estimates == expected.estimates
    latency = play.latency
    assert latency == LatencyRecord.read(play.run.folder / LATENCY_JSON)
    assert (latency.mode, latency.vision, latency.rate) == ("combined", "beside", 0.5)
    assert sum(one.measurements for one in latency.intervals) == sum(latency.measurements.values())
    assert latency.measurements["joints"] >= expected.estimates
    assert latency.pushes["joints"].count > 100
    assert {"estimator", "source", "vision"} <= set(latency.intervals[-2].processes)


def test_outputs_go_to_the_sink_which_is_closed(played: tuple[cv.Play, Noting]) -> None:
    play, sink = played
    assert sink.is_closed
    estimates = [one for one in sink.outputs if isinstance(one, cv.Estimate) and one.name == "combined_coclo"]
    assert len(estimates) == play.run.record.estimators["combined_coclo"].estimates


def test_it_is_evaluated_like_a_run(played: tuple[cv.Play, Noting]) -> None:
    play, _ = played
    assert play.run.metrics()["combined_coclo"].ate_m < 0.05


@pytest.mark.long
def test_where_the_estimator_is_behind_images_go_and_one_joint_sample_of_some_stays(
    go1_walk: Path, tmp_path: Path
) -> None:
    recording = cv.open(go1_walk, robot="go1", settings=["bridge.vision=in_turn"])
    feed = paced_feed(50.0, max_lag_s=0.01)
    play = cv.play(recording, "combined", rate=feed, folder=tmp_path / "out")
    assert play.latency.left_out > 5
    run = play.run.record.estimators["combined_coclo"]
    assert run.counts["image_left_out"] == play.latency.left_out
    assert run.counts["joints_left_out"] == play.latency.joints_left_out > 5
    kinds = [event.kind for event in play.run.events]
    assert kinds.count("images_left_out") == kinds.count("joints_left_out") == 1
    whole = cv.run(recording, "coclo").record.estimators["coclo"].estimates
    assert run.estimates < whole < run.estimates + play.latency.joints_left_out + 10, "some come before the start"


@pytest.mark.long
def test_joint_samples_stay_where_only_images_are_behind(go1_walk: Path, tmp_path: Path) -> None:
    recording = cv.open(go1_walk, robot="go1", settings=["bridge.vision=in_turn"])
    play = cv.play(recording, "combined", rate=paced_feed(2.0, max_lag_s=10.0), folder=tmp_path / "out")
    whole = cv.run(recording, "coclo").record.estimators["coclo"].estimates
    assert play.run.record.estimators["combined_coclo"].estimates == whole
    assert play.latency.joints_left_out == 0


def test_a_rate_of_zero_is_refused(go1_walk: Path) -> None:
    with pytest.raises(cv.ConfigError, match="rate = 0"):
        cv.play(go1_walk, rate=0.0)


@pytest.mark.long
def test_a_script_without_a_main_guard_can_play(leg_log: Path, tmp_path: Path) -> None:
    script = tmp_path / "script.py"
    script.write_text(
        f"import coclo_vio as cv\nprint(cv.play({str(leg_log)!r}, 'coclo', rate=20.0).latency.measurements)\n"
    )
    done = subprocess.run([sys.executable, script], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert done.stdout.count("joints") == 1
