# SPDX-License-Identifier: BSD-3-Clause
"""Every member of every kind of contradiction is named, in an inspection and before a run; a sound recording is not."""

from pathlib import Path

import pytest

import coclo_vio as cv
from coclo_vio.experiments.contradictions.content import Form, sample_content
from coclo_vio.experiments.contradictions.members import MEMBERS, Member

_IDS = [f"{member.name}, {member.form}".replace(" ", "_").replace("/", "_") for member in MEMBERS]


@pytest.mark.parametrize("member", MEMBERS, ids=_IDS)
def test_a_contradiction_is_named_and_its_run_refused(member: Member, tmp_path: Path) -> None:
    content = sample_content(has_frames=member.needs_images)
    changed = member.change(content)
    recording = cv.open(changed.write(tmp_path / "recording", member.form), robot=changed.description or changed.robot)
    findings = recording.diagnose().findings if member.in_full else recording.inspect().findings
    named = [finding for finding in findings if finding.kind == member.finding]
    assert named, [finding.sentence for finding in findings]
    assert named[0].is_error == member.is_error
    if member.is_error and not member.in_full and not member.is_truth:
        mode = "vins" if named[0].streams <= {"stereo", "stereo_tracks"} else "coclo"
        with pytest.raises(cv.CocloError, match=r"allow-partial|doctor|rectif|calibrat"):
            cv.run(recording, mode, folder=tmp_path / "out")


@pytest.mark.parametrize("form", ["bag", "folder", "leg log"])
def test_a_sound_recording_is_good_in_every_form(form: Form, tmp_path: Path) -> None:
    content = sample_content()
    recording = cv.open(content.write(tmp_path / "recording", form), robot="daisy")
    assert recording.inspect().findings == ()


def test_what_is_certain_corrects_the_recording(tmp_path: Path) -> None:
    wrong = [member for member in MEMBERS if member.name in {"body accelerations in g", "camera axes turned by 90 deg"}]
    content = sample_content(has_frames=False)
    for member in wrong:
        content = member.change(content)
    path = content.write(tmp_path / "recording", "bag")
    examination = cv.open(path, robot="daisy").diagnose()
    assert set(examination.settings) >= {
        "dataset.corrections.imu.acceleration_unit=g",
        "dataset.corrections.camera_imu.axes=-y x z",
    }
    assert examination.corrected.errors == ()
