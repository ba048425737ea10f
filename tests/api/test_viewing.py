# SPDX-License-Identifier: BSD-3-Clause
"""Views of runs: while they run and afterwards, without a change to what they give."""

from collections import Counter
from pathlib import Path

import numpy as np
import pytest

import coclo_vio as cv
from coclo_vio.runs.observers import Observers
from coclo_vio.runs.paced_play import paced_feed, play_mode
from coclo_vio.runs.running import run_modes
from coclo_vio.values.errors import ConfigError
from coclo_vio.values.measurements import JointSample, Measurement
from coclo_vio.values.outputs import Estimate, Innovation, Output, Picture, WindowSnapshot


class Kept:
    """A view that keeps everything."""

    def __init__(self) -> None:
        self.measurements: list[Measurement] = []
        self.outputs: list[Output] = []
        self.is_closed = False

    def measurement(self, measurement: Measurement) -> None:
        self.measurements.append(measurement)

    def take(self, output: Output) -> None:
        self.outputs.append(output)

    def close(self) -> None:
        self.is_closed = True


def poses(path: Path, entity: str) -> tuple[list[int], np.ndarray]:
    """Stamps, ns, and positions of an entity of a file."""
    chunk = pytest.importorskip("rerun.chunk")
    reader, timeline, component = (
        (chunk.McapReader, "message_log_time", "InstancePoses3D:translations")
        if path.suffix == ".mcap"
        else (chunk.RrdReader, "time", "Transform3D:translation")
    )
    rows = []
    for one in reader(str(path)).stream().to_chunks():
        if one.entity_path == entity and timeline in one.timeline_names:
            table = one.to_record_batch()
            stamps = table.column(timeline).cast("int64").to_pylist()
            rows += list(zip(stamps, (each[0] for each in table.column(component).to_pylist()), strict=True))
    rows.sort(key=lambda row: row[0])
    return [row[0] for row in rows], np.array([row[1] for row in rows])


@pytest.mark.long
def test_a_view_is_shown_all_that_goes_in_and_comes_out_and_changes_nothing(leg_log: Path, tmp_path: Path) -> None:
    view = Kept()
    seen = cv.run(leg_log, "coclo", folder=tmp_path / "seen", view=view)
    plain = cv.run(leg_log, "coclo", folder=tmp_path / "plain")
    for name in ("coclo.tum", "coclo_state.csv"):
        assert (tmp_path / "seen" / name).read_bytes() == (tmp_path / "plain" / name).read_bytes()
    states = [output.state for output in view.outputs if isinstance(output, Estimate)]
    assert [state.stamp_ns for state in states] == seen.trajectories["coclo"].stamps_ns.tolist()
    assert len(view.measurements) == plain.record.estimators["coclo"].measurements
    assert any(isinstance(measurement, JointSample) for measurement in view.measurements)
    innovations = [output for output in view.outputs if isinstance(output, Innovation)]
    assert 20 < len(innovations) <= 1 + 25 * (states[-1].stamp_ns - states[0].stamp_ns) / 1e9
    assert all(each.source == "legs" and each.rows >= 6 and each.squared > 0.0 for each in innovations)
    assert not view.is_closed, "whoever opened it closes it"


@pytest.mark.long
@pytest.mark.parametrize(
    ("kind", "suffix", "entity"), [("foxglove", "mcap", "/{}/pose"), ("rerun", "rrd", "/world/{}/pose")]
)
def test_a_run_is_seen_while_it_runs_and_afterwards(
    kind: str, suffix: str, entity: str, leg_log: Path, tmp_path: Path
) -> None:
    pytest.importorskip(kind)
    recording, file = cv.open(leg_log), tmp_path / f"live.{suffix}"
    view = cv.open_view(kind, recording, file=file)
    comparison = cv.compare(recording, ["coclo", "naive"], output=tmp_path / "out", view=view)
    view.close()
    again = cv.view_run(tmp_path / "out", kind, file=tmp_path / f"again.{suffix}")
    for name, trajectory in comparison.recordings[recording.name].run.trajectories.items():
        for path in (file, again):
            stamps_ns, positions = poses(path, entity.format(name))
            assert stamps_ns == trajectory.stamps_ns.tolist()
            assert np.allclose(positions, trajectory.positions, atol=1e-5)
    feet = "/feet" if kind == "foxglove" else "/world/feet"
    assert rows_of(again, feet) == rows_of(file, feet) > 20, "of one mode, by the joints of the recording"


def rows_of(path: Path, entity: str) -> int:
    chunk = pytest.importorskip("rerun.chunk")
    reader = chunk.McapReader if path.suffix == ".mcap" else chunk.RrdReader
    return sum(one.num_rows for one in reader(str(path)).stream().to_chunks() if one.entity_path == entity)


def test_one_view_shows_one_recording(leg_log: Path) -> None:
    with pytest.raises(ConfigError, match="a view shows one recording, not 2"):
        cv.compare([leg_log, leg_log], ["coclo"], view=Kept())


@pytest.mark.slow
@pytest.mark.parametrize("vision", ["in_turn", "beside"])
def test_the_window_is_among_the_outputs_where_pictures_are(vision: str, short_recording: Path, tmp_path: Path) -> None:
    view = Kept()
    if vision == "beside":
        run = _played(short_recording, tmp_path, view)
    else:
        run = cv.run(short_recording, "combined", folder=tmp_path, view=view)
    count = Counter(type(output) for output in view.outputs)
    snapshots = [output for output in view.outputs if isinstance(output, WindowSnapshot)]
    assert len(snapshots) >= 5
    vision = run.trajectories["combined_vins"]
    for snapshot in snapshots:
        row = vision.stamps_ns.tolist().index(snapshot.stamp_ns)
        assert np.allclose(snapshot.T_world_keyframes[-1], vision.T_world_body[row], atol=1e-6), "in the filter's world"
    ahead = snapshots[-1].landmarks_world - vision.positions[-1]
    assert len(ahead) > 30
    assert np.median(np.linalg.norm(ahead, axis=1)) < 20.0
    assert {output.source for output in view.outputs if isinstance(output, Innovation)} == {"legs", "vision"}
    assert count[Picture] > 10
    assert not (tmp_path / "debug_images").exists(), "the view's pictures are not the run's"


def _played(recording: Path, folder: Path, view: Kept) -> cv.Run:
    """The recording played at half the speed, with vision beside the filter, and shown to a view."""
    opened = cv.open(recording)
    record, _ = play_mode(
        opened.path, "combined", opened.config, folder, paced_feed(0.5), observers=Observers(view=view)
    )
    return cv.Run(folder, record)


def test_without_a_view_nothing_is_among_the_outputs_that_was_not_requested(leg_log: Path, tmp_path: Path) -> None:
    outputs: list[Output] = []
    recording = cv.open(leg_log)
    observers = Observers(watch=lambda _, output: outputs.append(output))
    run_modes(recording.path, ["coclo"], recording.config, tmp_path, observers=observers)
    assert {type(output) for output in outputs} <= {Estimate, cv.Event, cv.Status}
