# SPDX-License-Identifier: BSD-3-Clause
"""A run on a wire can be seen: what a view was given is read back from its file."""

import json
from pathlib import Path

import numpy as np
import pytest
from played_source import messages_of, run_played
from view_rows import view_rows

from coclo_vio.api.viewing import open_view
from coclo_vio.robot.description import load_robot
from coclo_vio.runs.observers import Observers
from coclo_vio.runs.run_folder import read_estimates
from coclo_vio.values.units import NS_PER_S

pytest.importorskip("rerun")


@pytest.mark.long
def test_poses_joints_tracks_and_events_are_in_the_file_of_the_view(short_recording: Path, tmp_path: Path) -> None:
    messages = messages_of(short_recording)
    some = [m for m in messages if m.arrived_ns < messages[0].arrived_ns + 3 * NS_PER_S]
    view = open_view("rerun", load_robot("daisy"), file=tmp_path / "live.rrd")
    record, _ = run_played(some, tmp_path / "out", "combined", observers=Observers(view=view))
    view.close()
    read = view_rows(tmp_path / "live.rrd")
    for name in ("combined_coclo", "combined_vins"):
        expected = read_estimates(tmp_path / "out", name).trajectory
        poses = read[f"/world/{name}/pose"]
        assert [stamp_ns for stamp_ns, _ in poses] == expected.stamps_ns.tolist()
        positions = [row["Transform3D:translation"][0] for _, row in poses]  # type: ignore[index]
        np.testing.assert_allclose(positions, expected.positions, atol=1e-5)
    assert len(read["/world/feet"]) > 40, "the joints are shown, 25 times a second"
    frames = record.estimators["combined_coclo"].counts["frames"]
    assert len(read["/tracks"]) == pytest.approx(frames / 2, abs=1)
    assert not (tmp_path / "out" / "debug_images").exists(), "pictures are for the view alone"
    assert json.loads((tmp_path / "out" / "run.json").read_text(encoding="utf-8"))["status"] == "finished"
